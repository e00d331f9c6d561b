"""What the samples of a record suggest where the motion misleads, and whether chains agree, as ArviZ has it."""

import numpy as np
import pytest

from pdssjax.metrics import effective_size, effective_size_of_tails, gain_of, guess_record, rhat


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_an_end_effector_that_fast_flanks_throw_on_is_not_turned(direction: str, sign: float) -> None:
    """It rides 9 um up with the voltage, then a platform that rings throws it 7 um further, or as far with its fall."""
    time = np.arange(-0.01, 1.0, 1e-3)
    cycle, part = np.divmod(time / 0.1, 1.0)
    volts = np.where(time < 0, 0.0, 60.0 * (part if direction == "forward" else 1.0 - part))
    way = 1.0 if direction == "forward" else -1.0
    motion = np.where(time < 0, 0.0, way * (9e-6 * part + 16e-6 * cycle))
    noise = np.random.default_rng(0).normal(0.0, 5e-9, time.size)
    guess = guess_record(time, sign * motion + noise, volts, measures="effector")
    assert guess.waveform.direction == direction
    assert guess.turned == (sign < 0)
    np.testing.assert_allclose(guess.motion, motion + sign * noise, atol=1e-12)


def test_the_noise_of_a_long_way_is_that_of_its_samples():
    """An interferometer of 1.5 nm that looks at a walk of 2 mm: a part of the way is no noise."""
    time = np.arange(-0.1, 1.2, 2e-4)
    cycle, part = np.divmod(np.maximum(time, 0.0) / 0.1, 1.0)
    volts, noise = 100.0 * part, np.random.default_rng(5).normal(0.0, 1.5e-9, time.size)
    guess = guess_record(time, 170e-6 * cycle + 15e-6 * part + noise, volts)
    assert guess.measures == "effector" and np.ptp(guess.motion) > 1.8e-3
    assert guess.noise == pytest.approx(1.5e-9, rel=0.05)


@pytest.mark.parametrize("low", [0.0, -20.0])
def test_an_end_effector_is_told_under_any_voltage_that_repeats(low: float) -> None:
    """No waveform explains a sawtooth between -20 and 100 V, and yet a motion that walks is no platform's."""
    time = np.arange(-0.01, 0.16, 2e-5)
    cycle, part = np.divmod(np.maximum(time, 0.0) * 50.0, 1.0)
    volts = low + (100.0 - low) * part
    guess = guess_record(time, 6e-6 * cycle + 12e-6 * part, volts)
    assert guess.measures == "effector"
    assert gain_of(guess) == pytest.approx(12e-6 / (100.0 - low), rel=0.05)


def test_plateaus_tell_no_gain():
    """Of an end-effector under a square most samples have as much voltage as those a quarter of a cycle later."""
    time = np.arange(0.0, 8e-3, 1e-6)
    random = np.random.default_rng(1)
    high = np.mod(time * 500.0, 1.0) < 0.5
    volts = 80.0 * high + 0.01 * random.normal(size=time.size)
    guess = guess_record(time, 1.6e-6 * high + 1e-8 * random.normal(size=time.size), volts, measures="effector")
    assert guess.waveform.name == "trapezoid"
    assert gain_of(guess) == pytest.approx(0.02e-6, rel=0.05)


@pytest.mark.parametrize("power", [2, 3, 5])
def test_a_drive_starts_before_its_voltage_is_seen_to(power: int) -> None:
    """Samples that begin like t^n are under way long before they leave their noise."""
    time = np.arange(-3e-4, 6e-3, 1e-6)
    part = np.mod(np.maximum(time, 0.0) * 1500.0, 1.0)
    shape = np.where(part < 0.5, 0.5 * (2.0 * part) ** power, 1.0 - 0.5 * (2.0 - 2.0 * part) ** power)
    volts = 80.0 * shape + 0.01 * np.random.default_rng(2).normal(size=time.size)
    guess = guess_record(time, 2e-8 * 80.0 * shape, volts, measures="platform")
    assert (guess.waveform.name, guess.waveform.begins) == ("sampled", "seen")
    assert -1.5e-4 <= guess.start <= 2e-6


def autoregressive(phi, draws, seed=0, chains=4):
    """Chains whose draws depend on the one before by `phi`."""
    random = np.random.default_rng(seed)
    noise = random.normal(size=(chains, draws))
    out = np.zeros_like(noise)
    for t in range(1, draws):
        out[:, t] = phi * out[:, t - 1] + noise[:, t]
    out[:, ::7] = np.roll(out, 1, 1)[:, ::7]  # a rejected proposal repeats the draw before
    return out


# From arviz_stats.base.array_stats: rhat(x), ess(x, method="bulk"), ess(x, method="tail", prob=(0.05, 0.95)).
OF_ARVIZ = [
    (0.0, 1000, (1.0014299813209624, 3136.6662456584118, 3061.7936933177407)),
    (0.5, 101, (1.0082636658745665, 140.51503405129807, 189.75752516458437)),
    (0.95, 1000, (1.057492207332304, 92.82939924746108, 185.70207041765389)),
    (-0.5, 1000, (1.0006135055888052, 5647.421644429538, 2346.7437560486246)),
]


@pytest.mark.parametrize(("phi", "draws", "expected"), OF_ARVIZ)
def test_they_are_those_of_arviz(phi, draws, expected):
    chains = autoregressive(phi, draws)
    found = rhat(chains), effective_size(chains), effective_size_of_tails(chains)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_independent_draws_are_worth_themselves_and_a_chain_apart_is_seen():
    draws = np.random.default_rng(1).normal(size=(4, 1000))
    assert effective_size(draws) == pytest.approx(4000, rel=0.1)
    assert rhat(draws) < 1.005
    assert rhat(draws + np.array([[0.0], [0.0], [0.0], [2.0]])) > 1.1
    assert rhat(draws * np.array([[1.0], [1.0], [1.0], [3.0]])) > 1.1, "a chain of another spread"
    assert effective_size(np.repeat(draws[:, :100], 10, axis=1)) == pytest.approx(400, rel=0.2)


@pytest.mark.parametrize("draws", [np.zeros((4, 100)), np.zeros((4, 3)), np.arange(6.0).reshape(2, 3)])
def test_too_few_or_equal_draws_say_nothing(draws):
    assert np.isnan([rhat(draws), effective_size(draws), effective_size_of_tails(draws)]).all()
