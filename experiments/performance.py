"""The performance that chapter 3 measured, as a function of what is not known of the rig, and its fit.

Published are 10 numbers: four step efficiencies, two speeds, four forces.  Each is divided by a stated
uncertainty; and so is each parameter for which the thesis gives a value (`PARAMETERS`), less that value,
as if it had been measured once more.  What is left is fitted by least squares.

In the steady cycle S of (3.1) is C V, the platform's own stroke, and the efficiency is the net step over
it: a smooth function of the parameters, in which nothing has to be read off.  The force is that on the
sensor at the end of the last slow flank.
"""

import dataclasses
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from experiments.published import ANISOTROPIC, PUSHES, VOLTAGE, WALKS, Reading, law, stacked
from pdssjax import Accuracy, Actuator, Effector, Stop
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import STOP_FORCE, StickSlip, displacements, sensor_samples

CYCLES = 6
"""Of pushing, until the force has settled."""
WALKING, PUSHING = Accuracy(), Accuracy(tolerance=1e-10, max_steps=3000)
STEP = 2e-3
"""Of the differences, in what is fitted."""


class Unknown(NamedTuple):
    """A parameter of the rig, in the unit in which it is shown."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    spread: float | None
    """Standard deviation with which the thesis's value counts as measured; None where it gives none."""
    si: float
    """What one `unit` is in SI."""
    logarithmic: bool = True
    """Fitted by its logarithm."""

    def inside(self, value: float) -> float:
        """The number that is fitted."""
        return float(np.log(value / self.nominal)) if self.logarithmic else value


_ISOTROPIC = 1e3 * 0.5 * (0.7964 + 0.5458)
PARAMETERS = (
    # Nothing is said of the drive's edge: an amplifier charges the stack in some tenths of a millisecond.
    Unknown("fall time", "ms", 0.0, 0.0, 1.5, None, 1e-3, logarithmic=False),
    # "Horizontal" was adjusted until both directions were alike (section 3.4).
    Unknown("tilt", "deg", 0.0, -5.0, 5.0, 0.5, np.pi / 180.0, logarithmic=False),
    # 86 g, to which the aluminium plate for the sensor adds some grams.
    Unknown("moving mass", "g", 86.0, 40.0, 300.0, 10.0, 1e-3),
    # The spread between the thesis's two identifications of its piezo (chapters 4 and 5).
    Unknown("gain", "um/V", 0.1007, 0.05, 0.2, 0.003, 1e-6),
    Unknown("natural frequency", "rad/s", 6736.0, 4000.0, 10000.0, 200.0, 1.0),
    Unknown("damping ratio", "1", 0.1772, 0.02, 0.6, 0.03, 1.0),
    # Least squares on such records knows them to some per cent; the rest is for a day's wear.
    Unknown("F_SSa", "mN", 796.4, 100.0, 3000.0, 80.0, 1e-3),
    Unknown("F_SSb", "mN", 545.8, 100.0, 3000.0, 55.0, 1e-3),
    Unknown("F_SS isotropic", "mN", _ISOTROPIC, 100.0, 3000.0, None, 1e-3),
    Unknown("sensor stiffness", "N/mm", 100.0, 20.0, 3000.0, None, 1e3),
)
FALL, TILT, MASS, GAIN, FREQUENCY, DAMPING, F_A, F_B, F_ISOTROPIC, STIFFNESS = range(len(PARAMETERS))


class Published(NamedTuple):
    """One of the numbers to be explained."""

    name: str
    unit: str
    value: float
    spread: float
    """Its standard deviation, our estimate: the thesis states none."""


PUBLISHED = (
    # S and S_0 to 0.1 um of 6.4 um each; AF were taped on anew, too.
    *(Published(f"efficiency, {walk.name}", "%", 100.0 * walk.efficiency, 1.5) for walk in WALKS),
    # v = eta f S misses by 2 and by 5 %.
    *(Published(f"speed, {walk.name}", "um/s", 1e6 * walk.speed, 0.3) for walk in WALKS if walk.speed),
    # Single highest samples of a sawtooth.
    *(Published(f"force, {push.name}", "mN", 1e3 * push.force, 20.0) for push in PUSHES),
)
MEASURED = np.array([number.value for number in PUBLISHED])
SPREAD = np.array([number.spread for number in PUBLISHED])
FORCES = np.array([number.name.startswith("force") for number in PUBLISHED])
"""Which of them are forces."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """One least-squares fit; the parameters in their shown units."""

    values: Float[np.ndarray, " p"]
    errors: Float[np.ndarray, " p"]
    """One standard error each, from the Jacobian; 0 where held, NaN where a parameter sits on a bound."""
    predicted: Float[np.ndarray, " n"]
    """The published numbers as the fit has them."""
    chi2: float
    degrees: int
    """Of freedom."""
    inside: Float[np.ndarray, " p"]
    """The numbers that were fitted."""
    free: np.ndarray
    """Places of the parameters that were fitted."""
    used: np.ndarray
    """Places, among published numbers and then pseudo-measurements (`known`), of those that were used."""
    jacobian: Float[np.ndarray, "m f"]
    """Of what was used, each in its standard deviations, in what was fitted."""
    covariance: Float[np.ndarray, "f f"]
    """Of what was fitted; zeros for a parameter on its bound."""


def shown(inside: Any) -> list:
    """The parameters in their shown units."""
    return [
        p.nominal * jnp.exp(inside[i]) if p.logarithmic else inside[i] * jnp.ones(()) for i, p in enumerate(PARAMETERS)
    ]


def _parts(inside, reading) -> tuple[Any, ...]:
    """Piezo, effector and sensor of a rig, the friction of a surface, and the drive."""
    si: list[Any] = [value * p.si for value, p in zip(shown(inside), PARAMETERS, strict=True)]
    stop = Stop(si[STIFFNESS])

    def friction(surface):
        other = law(surface, reading)
        a, b = (si[F_A], si[F_B]) if surface == ANISOTROPIC else (si[F_ISOTROPIC],) * 2
        return AnisotropicLuGre(other.sigma0_a, other.sigma0_b, other.sigma1_a, other.sigma1_b, a, b, state=reading)

    def sawtooth(frequency, direction):
        return Sawtooth(voltage=VOLTAGE, frequency=frequency, fall_time=si[FALL], direction=direction)

    piezo = SecondOrder(si[GAIN], si[FREQUENCY], si[DAMPING])
    return piezo, Effector(si[MASS], tilt=si[TILT]), stop, friction, sawtooth


def walks(inside: Float[Array, " p"], reading: Reading) -> Float[Array, " 6"]:
    """Efficiencies [%] and speeds [um/s], in the order of `PUBLISHED`."""
    piezo, effector, _, friction, sawtooth = _parts(inside, reading)
    cases = [(Actuator(piezo, friction(w.surface), effector), sawtooth(5.0, w.direction)) for w in WALKS]
    steps = lax.map(_net_step, stacked(cases))
    timed = np.array([walk.speed is not None for walk in WALKS])
    return jnp.concatenate([100.0 * steps / (piezo.gain * VOLTAGE), 5e6 * steps[timed]])


def _net_step(case):
    """From the middle of the third slow flank to that of the fourth [m], positive along the walk."""
    actuator, drive = case
    _, x = displacements(actuator, drive, jnp.array([2.5, 3.5]) / drive.frequency, WALKING)
    return drive.direction * (x[1] - x[0])


def forces(inside: Float[Array, " p"], reading: Reading) -> Float[Array, " 4"]:
    """Forces [mN] in the order of `PUBLISHED`; NaN where a run does not finish."""
    piezo, effector, stop, friction, sawtooth = _parts(inside, reading)
    drive = sawtooth(20.0, 1.0)
    cases = [StickSlip(Actuator(piezo, friction(p.surface), effector, stop=stop), drive) for p in PUSHES[:2]]
    time = jnp.array([CYCLES * (1.0 - 1e-9)]) / drive.frequency
    two = jax.vmap(lambda system: sensor_samples(system, time, PUSHING, STOP_FORCE)[0])(stacked(cases))
    return 1e3 * jnp.concatenate([two, two])


@partial(jax.jit, static_argnums=1)
def _walks(inside, reading):
    """Walks and their derivatives."""

    def both(inside):
        found = walks(inside, reading)
        return found, found

    jacobian, found = jax.jacfwd(both, has_aux=True)(inside)
    return found, jacobian


@partial(jax.jit, static_argnums=1)
def _forces(many, reading):
    """Forces at each of many sets of parameters."""
    return jax.vmap(lambda inside: forces(inside, reading))(many)


class Model:
    """What is published as a function of what is fitted, with its derivatives; keeps its last answer."""

    def __init__(self, reading: Reading, pushes: bool = True):
        self.reading: Reading = reading
        self.pushes = pushes
        self._at: bytes = b""
        self._answer: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros((0, 0)))

    def __call__(self, inside: np.ndarray) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n p"]]:
        """The published numbers in their units, and their derivatives; forces are NaN without `pushes`."""
        if inside.tobytes() != self._at:
            walked, slopes = (np.asarray(part) for part in _walks(jnp.asarray(inside), self.reading))
            pushed, changes = self._pushed(inside) if self.pushes else (np.full(4, np.nan), np.zeros((4, inside.size)))
            self._at = inside.tobytes()
            self._answer = np.concatenate([walked, pushed]), np.concatenate([slopes, changes])
        return self._answer

    def _pushed(self, inside):
        here, *moved = np.asarray(
            _forces(jnp.asarray(inside + STEP * np.eye(1 + inside.size, inside.size, -1)), self.reading)
        )
        # A run that does not finish says nothing.
        return here, np.nan_to_num((np.array(moved) - here) / STEP).T


def known() -> np.ndarray:
    """Places of the parameters that have a pseudo-measurement."""
    return np.flatnonzero([p.spread is not None for p in PARAMETERS])


def fit(
    reading: Reading, start: dict[int, float], free: tuple[int, ...], pushes: bool = True, unknown: tuple[int, ...] = ()
) -> Fit:
    """Least squares over the `free` parameters; the others keep `start` or else their nominal value.

    **Arguments:** `start` by a parameter's place, in its shown unit; without `pushes` the forces are left
    out; of the `unknown` parameters nothing is held to be known before.
    """
    model = Model(reading, pushes)
    begin = np.array([p.inside(start.get(i, p.nominal)) for i, p in enumerate(PARAMETERS)])
    moving = np.isin(np.arange(len(PARAMETERS)), free)
    low, high = (np.array([p.inside(getattr(p, end)) for p in PARAMETERS]) for end in ("low", "high"))
    told = moving & ~np.isin(np.arange(len(PARAMETERS)), unknown)
    used = np.concatenate([pushes | ~FORCES, told[known()]])

    def whole(part):
        inside = begin.copy()
        inside[moving] = part
        return inside

    def linearised(part):
        inside = whole(part)
        values, slopes = model(inside)
        missed, change = (values - MEASURED) / SPREAD, slopes / SPREAD[:, None]
        spread = np.array([PARAMETERS[i].spread for i in known()], float)
        values = np.array([float(value) for value in shown(inside)])
        unit = np.array([v if p.logarithmic else 1.0 for v, p in zip(values, PARAMETERS, strict=True)])
        pseudo = (values - [p.nominal for p in PARAMETERS])[known()] / spread
        slope = np.diag(unit)[known()] / spread[:, None]
        return np.concatenate([missed, pseudo])[used], np.concatenate([change, slope])[used]

    found = least_squares(
        lambda part: linearised(part)[0],
        np.clip(begin[moving], low[moving] + 1e-9, high[moving] - 1e-9),
        jac=lambda part: linearised(part)[1][:, moving],  # pyright: ignore[reportArgumentType]
        bounds=(low[moving], high[moving]),
        x_scale="jac",
        xtol=1e-6,
        ftol=1e-4,
        max_nfev=60,
    )
    return _fit(whole(found.x), found, model, moving, used)


def _fit(inside, found, model, moving, used) -> Fit:
    values = np.array([float(value) for value in shown(inside)])
    unit = np.array([v if p.logarithmic else 1.0 for v, p in zip(values, PARAMETERS, strict=True)])
    # A parameter on its bound has no error of its own, and counts as known for the others.
    fitted = found.active_mask == 0
    covariance = np.zeros((fitted.size, fitted.size))
    covariance[np.ix_(fitted, fitted)] = np.linalg.pinv(found.jac[:, fitted].T @ found.jac[:, fitted])
    errors = np.zeros(len(PARAMETERS))
    errors[moving] = np.where(fitted, np.sqrt(np.diag(covariance)), np.nan)
    return Fit(
        values=values,
        errors=errors * unit,
        predicted=model(inside)[0],
        chi2=2.0 * float(found.cost),
        degrees=int(used.sum() - moving.sum()),
        inside=inside,
        free=np.flatnonzero(moving),
        used=np.flatnonzero(used),
        jacobian=found.jac,
        covariance=covariance,
    )
