"""A sum of squares with many minima, fitted by SciPy: what races of starts and restarts are tried on."""

from types import SimpleNamespace

import numpy as np
from scipy.optimize import least_squares

from pdssjax.inference import Ending, Fit
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.prior import Prior

PATHS = ("piezo.gain", "friction.f_c")


def at(a, b):
    """Values of the two parameters, by path."""
    return dict(zip(PATHS, (float(a), float(b)), strict=True))


class Waves:
    """Residuals 1.7 (x - 1) and a ripple of them: minima every 4 pi / frequency, the lowest at (1, 1).

    So large that the other minima leave more than chance does of two degrees of freedom.
    """

    bounds = np.full(2, -10.0), np.full(2, 10.0)
    noise = np.ones(1)

    def __init__(self, frequency: float, ripple: float, platform_alone: bool = False):
        self.frequency, self.ripple = frequency, ripple
        shows = SimpleNamespace(platform_alone=platform_alone, effector_moves=not platform_alone)
        names = dict(name="waves", measures="effector", role="fit")
        self.records = (
            SimpleNamespace(**names, measurement=shows, noise=1.0, offset=0.0, drive=None, time=np.arange(4.0)),
        )
        self.records[0].measured = np.zeros(4)
        transform = SimpleNamespace(paths=PATHS, at_bound=self.at_bound)
        self.residual = SimpleNamespace(transform=transform, loss=Squares(), prior=Prior())

    def at_bound(self, free):
        return (free <= self.bounds[0]) | (free >= self.bounds[1])

    @property
    def rows(self):
        return [slice(0, record.time.size) for record in self.records]

    def whitened(self, free):
        beside = np.asarray(free) - 1.0
        return 1.7 * np.concatenate([beside, self.ripple * np.sin(0.5 * self.frequency * beside)])

    def lowered(self, free):
        return SimpleNamespace(compile=lambda: None)

    def encode(self, values):
        return np.array([values[path] for path in PATHS])

    def decode(self, free):
        return at(*free)


def run(problem, starts, report, limit=200):
    """A fit by SciPy; its evaluations are its iterations: nothing was rejected."""
    begun = np.clip(problem.encode(starts), *problem.bounds)
    found = least_squares(problem.whitened, begun, bounds=problem.bounds, max_nfev=limit)
    ended = Ending.CONVERGED if found.success else Ending.RUNNING
    state = SimpleNamespace(residual=found.fun, jacobian=found.jac, iterations=found.nfev, evaluations=found.nfev)
    # SciPy stays within the bounds by a hair.
    free = np.select([found.active_mask < 0, found.active_mask > 0], problem.bounds, found.x)
    return Fit(free, state, found.success, found.message, found.nfev, found.nfev, ended)  # pyright: ignore
