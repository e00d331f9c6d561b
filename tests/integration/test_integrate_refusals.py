"""What `integrate` says of runs that end early and of what it cannot integrate, and the page that explains it."""

import re
from pathlib import Path

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bouncing_ball import BouncingBall

import pdssjax
from pdssjax import InputError, Taylor
from pdssjax.integration import HybridSystem, integrate

ARGS = {"gravity": 9.81, "restitution": 0.5}


class Stays(BouncingBall):
    """Does not say what follows."""

    def after_event(self, t, y, args, mode, which):
        return None


class Bent(HybridSystem):
    """A field that no series can pass."""

    def vector_field(self, t, y, args, mode):
        return jnp.abs(y)


@pytest.mark.parametrize("mode", [-1, 1.0, True])
def test_a_mode_is_a_whole_number_from_0_on(mode):
    with pytest.raises(InputError, match=r"found `mode` = .*, expected a whole number from 0 on"):
        integrate(BouncingBall(), 0.0, 1.0, (0.8, 0.0), ARGS, mode=mode)


@pytest.mark.parametrize(
    ("given", "told"),
    [(lambda y: y > 0.0, "found bool"), (lambda y: None, "NoneType"), (lambda y: (y, jnp.ones(2)), "2,")],
)
def test_guards_that_are_no_real_numbers_are_refused(given, told):
    class Falling(HybridSystem):
        def vector_field(self, t, y, args, mode):
            return -1.0

        def guards(self, t, y, args, mode):
            return given(y)

    with pytest.raises(InputError, match=told) as raised:
        integrate(Falling(), 0.0, 1.0, 0.5)
    assert "Falling.guards: found" in str(raised.value) and "expected real numbers" in str(raised.value)


def test_a_run_that_ends_early_says_why_and_raises_where_it_is_asked_to():
    """A ball whose bounces accumulate runs out of steps; what it did not reach is not a number."""
    run = lambda throw, height: integrate(
        BouncingBall(), 0.0, 3.0, (height, 0.0), ARGS, saveat=[0.2, 2.9], max_steps=32, throw=throw
    )
    lanes = jax.vmap(lambda height: run(False, height))(jnp.array([100.0, 0.8]))
    assert lanes.result.tolist() == [0, 1]
    early = jax.tree.map(lambda lane: lane[1], lanes)
    assert lanes.message == early.message
    assert "events that accumulate" in early.message
    assert float(early.ys[0][0]) == pytest.approx(0.8 - 0.5 * 9.81 * 0.2**2, abs=1e-12)
    assert np.isnan(early.ys[0][1])
    # Its bounces end there: the sum of a geometric series.
    assert float(early.stopped) == pytest.approx(3.0 * np.sqrt(2.0 * 0.8 / 9.81), rel=1e-3)
    with pytest.raises(RuntimeError, match=r"at the time 1.21\d*, after \d+ events, it ran out of steps"):
        run(True, 0.8)


@pytest.mark.parametrize(("height", "until"), [(-0.8, 0.0), (0.8, np.sqrt(2.0 * 0.8 / 9.81))])
def test_what_follows_on_a_negative_guard_is_not_told(height, until):
    """A ball that begins below the floor, or that its bounce leaves there."""

    class Falling(BouncingBall):
        def after_event(self, t, y, args, mode, which):
            return (y[0] - 0.1, y[1]), mode

    times = jnp.array([0.1, 0.2, 0.3, 0.5, 0.6])
    run = integrate(Falling(), 0.0, 0.6, (height, 0.0), ARGS, saveat=times, max_steps=32, throw=False)
    assert int(run.result) == 3
    assert "guard was negative" in run.message
    known = times < until
    np.testing.assert_array_equal(np.isfinite(run.ys[0]), known)
    np.testing.assert_array_equal(run.modes >= 0, known)
    assert float(run.stopped) == pytest.approx(until, abs=1e-9)
    listed = run.events.ts[np.isfinite(run.events.ts)]
    np.testing.assert_allclose(listed, until, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t1": 0.0}, "expected a finite time after `t0`"),
        ({"saveat": [0.5, 1.5]}, r"found 1.5 in `saveat`, expected times from 0 to 1"),
        ({"saveat": 0.5}, "expected two numbers and an array with one axis"),
        ({"y0": ()}, "without a number"),
        ({"y0": (1.0, 1j)}, "expected real numbers"),
        ({"y0": jnp.ones(2), "method": Taylor()}, r"shape \(2,\), expected scalars"),
        ({"atol": (1e-9,)}, "expected one number or a pytree like `y0`"),
        ({"rtol": -1e-9}, "expected positive numbers"),
        ({"max_steps": 1e3}, "`max_steps`: found 1000.0, expected an integer"),
        ({"max_events": 0}, "`max_events`: found 0, expected at least 1"),
        ({"method": diffrax.Tsit5()}, r"found `method` Tsit5\(\), expected Picard\(\), Taylor\(\), or"),
        ({"system": Stays()}, r"Stays.after_event: found None, expected the pair \(state, mode\)"),
        ({"system": "ball"}, "expected a pdssjax.integration.HybridSystem"),
        ({"y0": (1.0, 0.0, 0.0)}, "vector_field: found a PyTreeDef"),
        ({"system": Bent(), "y0": 20.0, "method": Taylor()}, "found what a Taylor series cannot pass"),
    ],
)
def test_what_cannot_be_integrated_is_refused(change, message):
    given = {"system": BouncingBall(), "t0": 0.0, "t1": 1.0, "y0": (0.8, 0.0), "args": ARGS}
    with pytest.raises(InputError, match=message):
        integrate(**(given | change))


PAGE = Path(__file__).parents[2] / "docs/integration.md"


@pytest.mark.slow
def test_the_page_gives_what_it_says():
    given = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S):
        exec(block, given)
        if "Room(" in block:
            assert set(np.asarray(given["solution"].modes).tolist()) == {0, 1}
            assert np.asarray(given["solution"].ys).max() <= 22.0 + 1e-9
        elif "Ball(" in block:
            np.testing.assert_allclose(given["solution"].events.ts[:3], [0.404, 0.969, 1.365], atol=5e-4)
    np.testing.assert_allclose(given["slopes"], [0.14, -126.0, -12.7, -3.5], rtol=0.02)
    motion, times = given["motion"], np.linspace(0.0, 0.02, 21)
    system = given["system"]
    usual = pdssjax.simulate(system.actuator, system.drive, times)
    np.testing.assert_allclose(motion.ys.d, usual.platform - usual.effector, rtol=0.0, atol=1e-12)
    assert int(motion.events.count) > 2
