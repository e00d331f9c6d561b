"""A model's numbers are arrays of double precision, legal ones, as soon as it is made; they are shown with units."""

import pickle
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import BlimanSorine, Coulomb, Sampled, Sawtooth, SecondOrder, SimplifiedLuGre, Sine

import pdssjax
from pdssjax.core import as_single


def actuator(mass):
    return pdssjax.Actuator(SecondOrder(), Coulomb(), pdssjax.Effector(mass))


KINDS = (1.0, 1, np.float32(1.0), np.int64(1), np.array(1.0), jnp.asarray(1.0), jnp.asarray(1), jnp.float32(1.0))


@pytest.mark.parametrize("given", KINDS, ids=lambda given: f"{type(given).__name__}-{np.asarray(given).dtype}")
def test_every_kind_of_number_is_an_array_of_double_precision(given):
    mass = pdssjax.Effector(given).mass
    assert eqx.is_inexact_array(mass) and mass.dtype == np.float64 and np.shape(mass) == () and mass == 1.0


def test_what_is_left_out_and_what_is_chosen_are_arrays_too():
    for model in (actuator(0.1), Sawtooth(direction="backward"), Sine(), pdssjax.Sensor(), pdssjax.Stop()):
        assert all(eqx.is_inexact_array(leaf) for leaf in jax.tree.leaves(model))


def test_one_compilation_serves_all_numbers():
    traced = []

    @eqx.filter_jit
    def pull(actuator):
        traced.append(actuator)
        return actuator.effector.pull()

    for k, given in enumerate((*KINDS, *np.linspace(0.05, 0.2, 10))):
        pull(actuator(given))
        pull(eqx.tree_at(lambda a: a.effector.load, actuator(given), np.float64(k)))
    assert len(traced) == 1


def test_derivatives_by_all_leaves_are_there():
    gradient = eqx.filter_grad(lambda effector: effector.pull())(pdssjax.Effector(0.1, 0.2, 0.3))
    np.testing.assert_allclose(gradient.mass, 9.80665 * np.sin(0.3), rtol=1e-14)
    np.testing.assert_allclose(gradient.tilt, 0.1 * 9.80665 * np.cos(0.3), rtol=1e-14)
    assert gradient.load == 1.0


def test_models_are_parted_kept_and_compared_as_any_module_is(tmp_path):
    made = actuator(0.1)
    arrays, rest = eqx.partition(made, eqx.is_array)
    assert len(jax.tree.leaves(arrays)) == 8 and not jax.tree.leaves(rest)
    assert eqx.combine(arrays, rest) == made
    eqx.tree_serialise_leaves(tmp_path / "actuator.eqx", made)
    assert eqx.tree_deserialise_leaves(tmp_path / "actuator.eqx", actuator(0.2)) == made
    assert pickle.loads(pickle.dumps(made)) == made
    assert hash(made) == hash(actuator(0.1)) and made != actuator(0.2)


def test_models_made_in_single_precision_keep_their_digits():
    with jax.enable_x64(False):
        mass = pdssjax.Effector(0.1).mass
    assert mass.dtype == np.float64 and mass == 0.1


def test_models_are_made_without_starting_jax():
    # So that `prepare_jax` may follow: XLA reads its flags only once.
    code = (
        "import pdssjax; from pdssjax.drive.sawtooth import Sawtooth; from pdssjax.friction.lugre import LuGre\n"
        "from pdssjax.piezo.second_order import SecondOrder\n"
        "repr(pdssjax.Actuator(SecondOrder(), LuGre())), repr(Sawtooth(voltage=-40.0))\n"
        "from jax._src.xla_bridge import backends_are_initialized\n"
        "assert not backends_are_initialized()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: pdssjax.Effector(-1.0), r"Effector.mass: found -1 kg, expected a value above 0 kg\."),
        (lambda: pdssjax.Effector(0), r"Effector.mass: found 0 kg, expected a value above 0 kg\."),
        (lambda: pdssjax.Effector(jnp.asarray(-2.0)), r"Effector.mass: found -2 kg"),
        (lambda: pdssjax.Effector(np.nan), r"Effector.mass: found nan kg, expected a value that is finite and above 0"),
        (lambda: pdssjax.Effector(load=np.inf), r"Effector.load: found inf N, expected a value that is finite\."),
        (lambda: pdssjax.Effector(tilt=2.0), r"Effector.tilt: found 2 rad, expected a value of at least -1.5 rad and"),
        (lambda: Sawtooth(duty=1.2), r"Sawtooth.duty: found 1.2, expected a value above 0 and at most 1\."),
        (lambda: Sawtooth(frequency=np.array([5.0, -5.0])), r"Sawtooth.frequency: found -5 Hz"),
        (lambda: Sawtooth(voltage="64 V"), r"Sawtooth.voltage: found '64 V', expected a number in V\."),
        (lambda: Sawtooth(voltage=[64.0, 32.0]), r"Sawtooth.voltage: found \[64.0, 32.0\], expected a number in V\."),
        (lambda: Sawtooth(voltage=True), r"Sawtooth.voltage: found True, expected a number in V\."),
        (
            lambda: Sawtooth(direction=0.5),
            r'Sawtooth.direction: found 0.5, expected one of "forward" \(1\), "backward"',
        ),
        (lambda: pdssjax.Actuator(Coulomb(), SecondOrder()), r"Actuator.piezo: found Coulomb\(.*expected an AbstractP"),
    ],
)
def test_what_is_illegal_is_refused_by_name_value_unit_and_range(make, says):
    with pytest.raises(pdssjax.InputError, match=says):
        make()


def test_traced_numbers_and_several_at_once_pass():
    assert jax.jit(lambda mass: pdssjax.Effector(mass).mass)(-1.0) == -1.0
    several = jax.vmap(lambda mass: pdssjax.Effector(mass, load=1.0))(jnp.array([0.1, 0.2]))
    np.testing.assert_array_equal(several.mass, [0.1, 0.2])
    assert Sawtooth(voltage=np.array([64.0, 32.0])).voltage.shape == (2,)


def test_numbers_put_in_later_are_converted_and_checked():
    later = eqx.tree_at(lambda a: (a.effector.mass, a.piezo.gain), actuator(0.1), (1, jnp.float32(0.5)))
    single = as_single(later, "actuator")
    assert all(eqx.is_inexact_array(leaf) and leaf.dtype == np.float64 for leaf in jax.tree.leaves(single))
    assert single.effector.mass == 1.0 and single.piezo.gain == 0.5
    assert as_single(single, "actuator") is single
    with pytest.raises(pdssjax.InputError, match=r"actuator.effector.mass: found -1 kg, expected a value above 0 kg"):
        as_single(eqx.tree_at(lambda a: a.effector.mass, later, -1.0), "actuator")
    with pytest.raises(pdssjax.InputError, match=r"drive.voltage: found an array of shape \(2,\), expected one number"):
        as_single(Sawtooth(voltage=np.array([64.0, 32.0])), "drive")


def test_a_limit_of_a_law_is_legal_where_it_is_declared_so():
    assert SimplifiedLuGre(sigma1=0.0).sigma1 == 0.0 and BlimanSorine(eta=1.0).eta == 1.0
    with pytest.raises(
        pdssjax.InputError, match=r"SimplifiedLuGre.sigma1: found -1 N s/m, expected .* at least 0 N s/m"
    ):
        SimplifiedLuGre(sigma1=-1.0)
    with pytest.raises(pdssjax.InputError, match=r"BlimanSorine.eta: found 1.1, expected a value .* at most 1\."):
        BlimanSorine(eta=1.1)


def test_models_show_values_and_units():
    assert repr(pdssjax.Effector(0.1)) == "Effector(mass=0.1 kg, load=0 N, tilt=0 rad)"
    assert "gain=1.007e-07 m/V, natural_frequency=6736 rad/s" in repr(SecondOrder())
    assert "direction=backward" in repr(Sawtooth(direction="backward"))
    shown = repr(pdssjax.Actuator(SecondOrder(), SimplifiedLuGre(), pdssjax.Effector(0.086)))
    assert "friction=SimplifiedLuGre(sigma0=" in shown and "effector=Effector(mass=0.086 kg" in shown
    assert "amplifier=None" in shown


def test_arrays_and_traced_numbers_show_their_shapes():
    assert "times=f64[2]" in repr(Sampled(np.array([0.0, 1.0]), np.array([0.0, 1.0])))
    shown = []
    jax.jit(lambda drive: shown.append(repr(drive)))(Sawtooth())
    assert shown[0].startswith("Sawtooth(voltage=")
