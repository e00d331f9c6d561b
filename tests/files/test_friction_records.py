"""Records of a contact alone: what `pdssjax new` makes of them, without a clock, against the velocity; refusals."""

from pathlib import Path

import numpy as np
import pytest

from pdssjax import InputError, load_study
from pdssjax.cli.main import main
from pdssjax.core import member, quantities

pytestmark = pytest.mark.usefixtures("undrawn")

TIME = np.arange(0.0, 2.0, 0.01)
MOTION = 5.0 * np.sin(2.0 * np.pi * TIME)
FORCE = np.clip(np.cumsum(np.diff(MOTION, prepend=0.0)), -1.0, 1.0)
SPEED = np.linspace(0.1, 5.0, 40)
CURVE = 0.5 + 0.2 * np.exp(-(SPEED**2))


def written(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "run.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return file


def made(file: Path, *options: str):
    """The study that `pdssjax new` makes of a file."""
    folder = file.parent / "made"
    assert main(["new", str(folder), "--files", str(file), *options]) == 0
    assert list((folder / "check").iterdir())
    return load_study(folder / "study.toml")


@pytest.mark.parametrize(
    "header", ["time (s),displacement (um),force (N)", "Time [s],Position [um],Friction [N]", "t_s,x_um,F_N"]
)
def test_a_tribometers_file_makes_a_study(tmp_path, header):
    study = made(written(tmp_path, header, TIME, MOTION, FORCE))
    (record,) = study.records
    assert (record.measures, record.has_clock) == ("friction", True)
    np.testing.assert_allclose(record.motion, 1e-6 * MOTION, atol=1e-14)
    assert {path for path, p in study.parameters.items() if p.free} == {"friction.sigma0", "friction.f_c"}


def test_a_force_across_the_contact_is_left_out_and_one_against_the_motion_turned(tmp_path):
    normal = 5.0 + 0.01 * np.sin(TIME)
    header = "Time [s],Normal [uN],Position [um],Friction [uN]"
    (record,) = made(written(tmp_path, header, TIME, 1e6 * normal, MOTION, -1e6 * FORCE)).records
    np.testing.assert_allclose(record.measured, FORCE, atol=1e-8)


def test_a_loop_without_times_needs_a_law_that_knows_no_rate(tmp_path):
    study = made(written(tmp_path, "displacement_um,force_N", MOTION, FORCE))
    (record,) = study.records
    assert not record.has_clock
    text = study.path.read_text()
    for law, listed in (("simplified-lugre", "sigma0 sigma1 f_ss"), ("lugre", "sigma0 sigma1 f_c f_s v_s")):
        lines = "\n".join(f'"friction.{field}" = {{}}' for field in listed.split())
        other = text.replace('"dahl"', f'"{law}"').replace('"friction.sigma0" = {}\n"friction.f_c" = {}', lines)
        study.path.write_text(other)
        with pytest.raises(InputError, match=rf'record "run": found no times, which the law "{law}" needs.*dahl'):
            load_study(study.path)


@pytest.mark.parametrize("weakened, fine", [("{ value = 1 }", True), ("{ value = 0.9 }", False), ("{}", False)])
def test_maxwell_slip_without_times_must_not_weaken(tmp_path, weakened, fine):
    written(tmp_path, "displacement_um,force_N", MOTION, FORCE)
    numbered = [f'"friction.{field}_{i}" = {{}}' for field in ("stiffness", "strength") for i in range(1, 5)]
    (tmp_path / "study.toml").write_text(
        'format = "pdssjax-study/1"\nactuator = { piezo = "static", friction = "generalized-maxwell-slip" }\n'
        "[parameters]\n" + "\n".join(numbered) + f'\n"friction.weakened" = {weakened}\n'
        '"friction.v_s" = { value = 1e-3 }\n"friction.attraction" = { value = 3000 }\n'
        '[[record]]\nname = "run"\nfile = "run.csv"\nmeasures = "friction"\n'
        'columns = { motion = "displacement_um", force = "force_N" }\n'
    )
    if fine:
        assert not load_study(tmp_path / "study.toml").records[0].has_clock
        return
    with pytest.raises(InputError, match=r'expected them.*"friction.weakened" = { value = 1 }'):
        load_study(tmp_path / "study.toml")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("timed", [False, True])
def test_a_friction_curve_makes_a_study_of_steady_sliding(tmp_path, sign, timed):
    columns = [TIME[: SPEED.size]] * timed + [SPEED, sign * CURVE]
    study = made(written(tmp_path, "time_s," * timed + "velocity_mm/s,friction_N", *columns))
    (record,) = study.records
    assert record.measures == "steady-friction"
    np.testing.assert_allclose(record.motion, 1e-3 * SPEED)
    np.testing.assert_allclose(record.measured, CURVE)
    assert record.offset == 0.0


@pytest.mark.parametrize("law", ["elastoplastic", "bristle"])
def test_a_friction_curve_refuses_laws_without_steady_sliding_in_closed_form(tmp_path, law):
    study = made(written(tmp_path, "velocity_mm/s,force_N", SPEED, CURVE))
    text = study.path.read_text()
    listed = [f for f, q in quantities(member("friction", law)).items() if not q.optional]
    head, _, tail = text.partition('"friction.f_c"')
    lines = "".join(f'"friction.{field}" = {{}}\n' for field in listed)
    study.path.write_text(
        head.replace('"stribeck"', f'"{law}"') + lines + "\n[[record]]" + tail.partition("[[record]]")[2]
    )
    with pytest.raises(InputError, match=f'"{law}", whose steady sliding is not known'):
        load_study(study.path)


def test_a_friction_curve_refuses_rest(tmp_path):
    study = made(written(tmp_path, "velocity_mm/s,force_N", SPEED, CURVE))
    written(tmp_path, "velocity_mm/s,force_N", np.append(SPEED, 0.0), np.append(CURVE, 0.0))
    with pytest.raises(InputError, match='record "run": found a velocity of 0 in sample 41'):
        load_study(study.path)


def test_files_of_both_kinds_are_refused(tmp_path, capsys):
    loop = written(tmp_path, "displacement_um,force_N", MOTION, FORCE).rename(tmp_path / "loop.csv")
    curve = written(tmp_path, "velocity_mm/s,force_N", SPEED, CURVE)
    assert main(["new", str(tmp_path / "made"), "--files", str(loop), str(curve)]) == 2
    assert "expected files of one kind" in capsys.readouterr().err


@pytest.mark.parametrize("piezo", ["static", "second-order", "creep"])
def test_a_contact_alone_needs_no_particular_stack(tmp_path, piezo):
    study = made(written(tmp_path, "time_s,displacement_um,force_N", TIME, MOTION, FORCE))
    study.path.write_text(study.path.read_text().replace('"static"', f'"{piezo}"'))
    assert load_study(study.path).records[0].measures == "friction"
