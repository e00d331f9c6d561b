"""Variable projection ends where a plain least-squares fit of all parameters does, with the covariance of all."""

import itertools

import numpy as np
import pytest
from record_tables import loaded, write_columns
from scipy.optimize import least_squares, lsq_linear
from scipy.signal import lfilter

import pdssjax
from pdssjax import InputError, pose_problem
from pdssjax.inference.variable_projection import _box_step, linear_parameters, project

TRUTH = {
    "piezo.gain": 1e-7,
    "piezo.time_constant": 12e-3,
    "piezo.play_1": 2e-8,
    "piezo.play_2": 3e-8,
    "piezo.play_range": 15.0,
    "piezo.asymmetry_2": 2e-10,
    "piezo.creep_1": 6e-9,
    "piezo.creep_time": 0.3,
}
STUDY = """\
format = "pdssjax-study/1"
title = "Loops"

[actuator]
piezo = {dynamics = "first-order", hysteresis = { law = "play", elements = 2, asymmetry = 2 }, creep = { elements = 1 }}

[parameters]
"piezo.gain" = {}
"piezo.time_constant" = {}
"piezo.play_1" = {}
"piezo.play_2" = {}
"piezo.play_range" = {}
"piezo.asymmetry_2" = {}
"piezo.creep_1" = {}
"piezo.creep_time" = {}

[[record]]
name = "loops"
file = "loops.csv"
columns = { time = "time_s", displacement = "y_um" }
measures = "platform"
noise = "20 nm"
drive = { waveform = "sampled", column = "u_V" }
"""


def loops(folder, text=STUDY):
    """A study of a record made with NumPy, of play operators, a square, creep and a lag; its path."""
    time = np.arange(300) * 5e-3
    volts = 20.0 - (20.0 - 4.0 * time) * np.cos(2 * np.pi * 2.1 * time)
    thresholds, z, c, aims = np.array([7.5, 15.0]), np.zeros(2), 0.0, []
    for k, v in enumerate(volts):
        if k:
            slope, fade = (v - volts[k - 1]) / 5e-3, np.exp(-5e-3 / 0.3)
            c = v - 0.3 * slope + (c - volts[k - 1] + 0.3 * slope) * fade
        z = np.maximum(v - thresholds, np.minimum(v + thresholds, z))
        aims.append(1e-7 * v + z @ [2e-8, 3e-8] + 2e-10 * v**2 + 6e-9 * c)
    rows = [0.0]
    for before, now in itertools.pairwise(aims):
        slope, fade = (now - before) / 5e-3, np.exp(-5e-3 / 12e-3)
        rows.append(now - 12e-3 * slope + (rows[-1] - before + 12e-3 * slope) * fade)
    motion = 1e6 * np.array(rows) + np.random.default_rng(2).normal(0.0, 0.02, time.size)
    write_columns(folder / "loops.csv", "time_s,u_V,y_um", time, volts, motion, digits="%.9f")
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def posed(tmp_path_factory):
    return pose_problem(pdssjax.load_study(loops(tmp_path_factory.mktemp("loops"))))


@pytest.fixture(scope="module")
def plain(posed):
    """A fit of all parameters at once by SciPy, polished from the truth."""
    problem, _ = posed
    start = problem.encode(TRUTH)
    whitened, jacobian = (lambda x, f=f: np.asarray(f(x)) for f in (problem.whitened, problem.jacobian))
    fit = lambda start: least_squares(whitened, start, jacobian, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return fit(fit(fit(start).x).x)


def searched(problem, free):
    everything = np.ones(free.size, bool)
    used = np.ones(len(problem.records), bool)
    return project(problem, free, 1.0 / problem.noise, everything, linear_parameters(problem, used))


def test_what_is_linear_is_told_by_the_model(posed):
    problem, free = posed
    linear = linear_parameters(problem, np.ones(1, bool))
    paths = [path for path, is_linear in zip(problem.residual.transform.paths, linear, strict=True) if is_linear]
    assert paths == ["piezo.gain", "piezo.play_1", "piezo.play_2", "piezo.asymmetry_2", "piezo.creep_1"]
    # The residuals are affine in all of them together.
    step = 0.3 * linear * np.sign(free)
    ends = [np.asarray(problem.whitened(free + way * step)) for way in (0.0, 1.0, 2.0)]
    np.testing.assert_allclose(ends[2] - ends[1], ends[1] - ends[0], atol=1e-9 * np.abs(ends[1] - ends[0]).max())


def test_it_ends_where_a_plain_fit_does(posed, plain):
    problem, free = posed
    found = searched(problem, free)
    assert found.chi2 == pytest.approx(2.0 * plain.cost, rel=1e-8)
    # In standard errors: where records tell little, rounding moves a parameter along with another.
    jacobian = np.asarray(problem.jacobian(plain.x))
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose((found.free - plain.x) / errors, 0.0, atol=1e-4)


def test_the_linear_ones_alone_are_an_ordinary_linear_fit(posed):
    problem, _ = posed
    at = problem.encode(TRUTH)
    linear = linear_parameters(problem, np.ones(1, bool))
    found = project(problem, at, 1.0 / problem.noise, linear, linear)
    residual, jacobian = (np.asarray(x) for x in problem.linearised(at))
    expected = at.copy()
    expected[linear] -= np.linalg.lstsq(jacobian[:, linear], residual, rcond=None)[0]
    np.testing.assert_allclose(found.free, expected, rtol=1e-8)


def test_a_weight_that_would_be_negative_stays_at_zero():
    random = np.random.default_rng(4)
    columns = random.normal(size=(60, 6)) * [1.0, 1e3, 1e-3, 1.0, 1.0, 0.0]
    residual = -columns @ [1.0, -1e-3, 500.0, -2.0, 0.5, 0.0] + 0.1 * random.normal(size=60)
    low, high = np.array([0.0, 0.0, 0.0, 0.0, -np.inf, 0.0]), np.full(6, np.inf)
    found = np.asarray(_box_step(columns, residual, low, high))
    expected = lsq_linear(columns[:, :5], -residual, (low[:5], high[:5]), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(found[:5], expected, rtol=1e-8, atol=1e-12)
    assert found[5] == 0.0  # nothing depends on it
    assert (found == 0.0).sum() == 3


def test_nothing_is_projected_where_friction_acts_back(tmp_path):
    text = (
        STUDY.replace('"first-order"', '"second-order"')
        .replace('"piezo.time_constant" = {}\n', "")
        .replace("[parameters]", "[parameters]\n" + CONTACT)
    )
    text = text.replace("creep = { elements = 1 }}", 'creep = { elements = 1 }}\nfriction = "coulomb"\nfeedback = true')
    problem, _ = pose_problem(pdssjax.load_study(loops(tmp_path, text)))
    assert not linear_parameters(problem, np.ones(1, bool)).any()


CONTACT = """\
"effector.mass" = { value = 0.1 }
"friction.f_c" = { value = 0.5 }
"piezo.mass" = { value = 0.5 }
"piezo.natural_frequency" = { value = 6000 }
"piezo.damping_ratio" = { value = 0.2 }
"""

BAD = {
    '"piezo.play_1" = {}': ('"piezo.plays_*" = {}', 'found "piezo.plays_*", but no numbered parameter'),
    'dynamics = "first-order"': ('dynamics = "elastic"', 'found "elastic"'),
    'law = "play"': ('law = "paly"', 'found "paly"; did you mean "play"'),
    "elements = 2": ("elements = 0", "found 0, expected a whole number from 1 to 64"),
    "asymmetry = 2": ("asymmetry = 2.5", "found 2.5, expected a whole number from 1 to 9"),
    "creep = { elements = 1 }": ("creep = { element = 1 }", 'found the unknown key "element"'),
    "{dynamics": ("{modes = 2, dynamics", 'found modes of "first-order" dynamics'),
    'piezo = {dynamics = "first-order", ': ("piezo = { ", 'the key "dynamics" is missing'),
    'hysteresis = { law = "play", elements = 2, asymmetry = 2 }': (
        'hysteresis = { law = "bouc-wen", elements = 2 }',
        'found elements of "bouc-wen"',
    ),
    '"piezo.play_2" = {}': ("", 'the parameter "piezo.play_2" is missing'),
    '"piezo.creep_time" = {}': ('"piezo.creep_time" = {}\n"piezo.creep_2" = {}', 'unknown parameter "piezo.creep_2"'),
}


@pytest.mark.parametrize("old", BAD)
def test_a_stack_that_cannot_be_is_refused_with_its_place(tmp_path, old):
    new, told = BAD[old]
    assert old in STUDY
    path = loops(tmp_path, STUDY.replace(old, new))
    with pytest.raises(InputError) as refused:
        pdssjax.load_study(path)
    assert str(path) in str(refused.value)
    assert told in str(refused.value)


def test_numbered_parameters_are_listed_at_once(tmp_path):
    text = STUDY.replace(
        '"piezo.play_1" = {}\n"piezo.play_2" = {}', '"piezo.play_2" = { value = 3e-8 }\n"piezo.play_*" = {}'
    )
    parameters = pdssjax.load_study(loops(tmp_path, text)).parameters
    assert parameters["piezo.play_1"].free
    assert parameters["piezo.play_2"].value == 3e-8
    assert list(parameters).count("piezo.play_range") == 1


def test_the_platform_alone_needs_no_friction_law(tmp_path):
    path = loops(tmp_path)
    assert "friction" not in path.read_text()
    assert pdssjax.load_study(path).friction.__name__ == "Coulomb"
    path.write_text(path.read_text().replace('measures = "platform"', 'measures = "effector"'))
    with pytest.raises(InputError, match='the key "friction" is missing'):
        pdssjax.load_study(path)


LADDER = """\
format = "pdssjax-study/1"
title = "A ladder of creep that a search begins decades off"

[actuator]
piezo = { dynamics = "first-order", hysteresis = { law = "play", elements = 2 }, creep = { elements = 2 } }

[parameters]
"piezo.gain" = {}
"piezo.time_constant" = {}
"piezo.play_*" = {}
"piezo.play_range" = {}
"piezo.creep_*" = {}
"piezo.creep_time" = {}

[[record]]
name = "sine"
file = "sine.csv"
columns = { time = "time_s", displacement = "y_um" }
measures = "platform"
noise = "1 nm"
drive = { waveform = "sine", voltage = "80 V", frequency = "1 Hz" }
"""


@pytest.mark.slow
def test_a_ladder_of_creep_a_decade_off_is_left(tmp_path):
    interval, fine, taus = 0.002, 4, (0.05, 0.5)
    times = np.arange(5000 * fine) * interval / fine
    volts = 40.0 * (1.0 - np.cos(2 * np.pi * times))
    low_pass = lambda signal, tau: lfilter(
        [0.0, 1.0 - np.exp(-interval / fine / tau)], [1.0, -np.exp(-interval / fine / tau)], signal
    )
    z, thresholds, aim = np.zeros(2), np.array([15.0, 30.0]), 8e-8 * volts
    for k, volt in enumerate(volts):
        z = np.clip(z, volt - thresholds, volt + thresholds)
        aim[k] += z @ [1e-8, 0.8e-8]
    aim += sum(share * low_pass(volts, tau) for share, tau in zip((1.5e-9, 2e-9), taus, strict=True))
    motion = 1e6 * low_pass(aim, 1e-3)[::fine] + np.random.default_rng(0).normal(0.0, 1e-3, 5000)
    write_columns(tmp_path / "sine.csv", "time_s,y_um", times[::fine], motion, digits="%.7g")
    found = pdssjax.identify(loaded(tmp_path, LADDER)).parameters["piezo.creep_time"]
    # The other valley, where the first element takes the place of the second and that is unused, is 10 higher.
    assert abs(found.value - taus[0]) < 4.0 * found.standard_error < 0.01
