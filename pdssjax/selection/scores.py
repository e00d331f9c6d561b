"""How well models predict held-out samples under noise that is the same for all, and which is worse beyond chance.

A part of n samples whose residuals are e scores, with C the covariance of the noise of its record,

    log p = - (e' C^-1 e + log det C + n log 2 pi) / 2.

C is found once, from the residuals of the model that fits best: what does not repeat from cycle to cycle of them, with
its correlation in time; a standard deviation that the study tells stands unless they exceed it.  Neither AIC nor
leave-one-out holds under such noise: both count neighbouring samples as independent, and prefer the model that follows
the noise.

With w = L^-1 e, L L' = C, two models differ by d = (|w_b|^2 - |w_a|^2) / 2 in a part.  By noise alone d varies by
|w_a - w_b|^2.  Where the better one leaves more than noise, too, and the parts of a record differ more than that, their
scatter counts (Q. H. Vuong, Econometrica 57(2), 1989).  A difference is significant from two standard errors on, and
matters where it exceeds both `MIN_SCORE_DIFFERENCE` and half of what the better model itself leaves beyond noise: where
no model is right, differences below their common error are no reason to choose.  On blocks of time it does not matter,
either, where the model behind explains what is fitted as well (`Fitness`); and what a model leaves beyond noise there
does not count where it explains all that is fitted, and the one behind does not by far.

A record that alone tells some parameters of a right model cannot be predicted from the others.  So one that explains
all that is fitted, where the other does not by far, is not refused for fitted records held out, only for those that no
fit has seen.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..metrics import NoiseInTime, StationaryNoise, grid_positions, outliers, split_residuals
from ..study import Record, cycles_a_second
from .comparison import Difference, RecordNoise
from .held_out import Part

MIN_SCORE_DIFFERENCE = 3.0
"""Difference of log scores below which none matters: odds of twenty to one."""

WHITENING_BLOCK = 256
"""Samples between which covariances are computed at once; longer parts are cut, and the pieces taken for
independent."""

EXCESS_SIGMAS = 4.0
"""Standard deviations by which |w|^2 has to exceed the number of samples for a model to leave more than noise."""


class CommonNoise(NamedTuple):
    """The noise of one record, the same for every model."""

    size: RecordNoise
    process: StationaryNoise | NoiseInTime
    used: Bool[np.ndarray, " samples"]
    """Which samples are compared: those that do not stand out of the best fit's residuals."""


def common_noise(record: Record, predicted: Float[np.ndarray, " samples"], freedom: float) -> CommonNoise:
    """The noise of a `record` by the residuals of the best fit, which has left `freedom` degrees of freedom."""
    frequency, residual = cycles_a_second(record), record.measured - predicted
    used = np.ones(record.time.size, bool)
    used[outliers(record.measured, predicted, record.time, frequency)] = False
    rest = np.where(used, residual - (np.mean(residual[used]) if record.offset is None else 0.0), np.nan)
    found = split_residuals(rest, record.time, frequency, freedom).noise
    share = min(max(found.independent_share(record.time), 1.0 / record.time.size), 1.0)
    variance = found.variance if isinstance(found, NoiseInTime) else float(found.autocovariance(1)[0])
    by_chance = 1.0 + EXCESS_SIGMAS * float(np.sqrt(2.0 / (share * record.time.size)))
    given = 0.0 if record.noise is None else record.noise**2
    is_given = given > 0.0 and variance <= by_chance * given
    wanted = given if is_given else variance or 1.0
    if variance == 0.0:
        found = StationaryNoise(np.zeros(0), wanted)
    elif isinstance(found, NoiseInTime):
        found = found._replace(variance=wanted)
    else:
        found = found._replace(innovation=found.innovation * wanted / variance)
    interval = float(np.median(np.diff(record.time)))
    correlated, independent = interval * (0.5 / share - 0.5), share * float(np.sum(used))
    return CommonNoise(RecordNoise(float(np.sqrt(wanted)), is_given, correlated, independent), found, used)


class Whitener(NamedTuple):
    """Makes residuals of some samples of a record white."""

    pieces: tuple[tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]], ...]
    """Places among the samples, and the inverse of the root of their covariance."""
    log_volume: float
    """log det C + n log 2 pi."""

    @property
    def samples(self) -> int:
        """The number of samples that are compared."""
        return sum(places.size for places, _ in self.pieces)

    def __call__(self, residual: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        """w of a `residual`, NaN where the simulation failed."""
        return np.concatenate([np.zeros(0), *(inverse @ residual[places] for places, inverse in self.pieces)])


def whitener(record: Record, noise: CommonNoise, rows: Bool[np.ndarray, " samples"]) -> Whitener:
    """The whitener of residuals of the `rows` of a record; samples that stand out are left out."""
    places = np.flatnonzero(rows)
    compared = np.flatnonzero(noise.used[places])
    cuts = np.flatnonzero(np.diff(places[compared]) > 1) + 1
    pieces, volume = [], 0.0
    for run in np.split(compared, cuts):
        for piece in np.array_split(run, -(-run.size // WHITENING_BLOCK)) if run.size else ():
            root = np.linalg.cholesky(_covariance(record, noise.process, places[piece]))
            pieces.append((piece, np.linalg.inv(root)))
            volume += 2.0 * float(np.sum(np.log(np.diag(root)))) + piece.size * np.log(2.0 * np.pi)
    return Whitener(tuple(pieces), volume)


def _covariance(record: Record, noise: StationaryNoise | NoiseInTime, places: np.ndarray) -> Float[np.ndarray, "k k"]:
    if isinstance(noise, NoiseInTime):
        out = noise.covariance_at(record.time[places, None] - record.time[places])
    else:
        grid = grid_positions(record.time)
        at = (np.arange(record.time.size) if grid is None else grid)[places]
        out = noise.autocovariance(int(at[-1] - at[0]) + 1)[np.abs(at[:, None] - at)]
    # A part that is white, so that the covariance of very slow noise can be inverted.
    return out + 1e-6 * out[0, 0] * np.eye(places.size)


class Fitness(NamedTuple):
    """How well a model explains the samples that it was fitted to."""

    free: int
    """Its free parameters."""
    deviance: float
    """Minus twice the logarithm of its likelihood."""
    criterion: float
    """Schwarz's: the deviance and, of each parameter, the logarithm of the number of independent samples."""
    explains: bool = False
    """It leaves no more than the common noise of what was fitted."""

    def is_no_worse(self, other: "Fitness") -> bool:
        """Whether the model explains as much as the `other`: by the criterion with fewer parameters, by the likelihood
        with more."""
        if self.free < other.free:
            return self.criterion <= other.criterion
        return self.free > other.free and self.deviance <= other.deviance + 2.0 * MIN_SCORE_DIFFERENCE

    def outdoes(self, other: "Fitness") -> bool:
        """Whether the model explains what was fitted, and the `other` is beyond doubt no match by the criterion."""
        return self.explains and self.criterion + 2.0 * MIN_SCORE_DIFFERENCE < other.criterion


class Scores(NamedTuple):
    """Scores of several models on the same parts."""

    parts: tuple[Part, ...]
    whitened: Mapping[str, tuple[Float[np.ndarray, " m"], ...]]
    """Whitened residuals of each part, by model."""
    log_volumes: tuple[float, ...]
    fits: Mapping[str, Fitness] = MappingProxyType({})
    """How well each model explains the fitted samples, by its name."""

    def only(self, *kinds: str) -> "Scores":
        """The scores on parts of some `kinds`."""
        kept = [k for k, part in enumerate(self.parts) if part.kind in kinds]
        take = lambda values: tuple(values[k] for k in kept)
        whitened = {name: take(w) for name, w in self.whitened.items()}
        fits = self.fits if "time" in kinds else {}
        return Scores(take(self.parts), whitened, take(self.log_volumes), fits)

    def total(self, name: str) -> float:
        """The log score of a model on all parts."""
        squares = sum(float(w @ w) for w in self.whitened[name])
        return -0.5 * (squares + sum(self.log_volumes))

    def excess(self, name: str) -> float:
        """By how much |w|^2 of a model exceeds the number of samples, where that is beyond chance; else 0."""
        w = np.concatenate([np.zeros(0), *self.whitened[name]])
        over = float(w @ w) - w.size
        return over if over > EXCESS_SIGMAS * np.sqrt(2.0 * max(w.size, 1)) else 0.0

    def difference(self, first: str, second: str) -> Difference:
        """By how much the `first` model is better than the `second` one."""
        better, worse = self.whitened[first], self.whitened[second]
        values = np.array([0.5 * float(b @ b - a @ a) for a, b in zip(better, worse, strict=True)])
        chance = np.array([float(np.sum((a - b) ** 2)) for a, b in zip(better, worse, strict=True)])
        total = float(np.sum(values))
        ahead, behind = (first, second) if total >= 0.0 else (second, first)
        # What one that outdoes the other leaves beyond noise is due to its parameters by fewer samples, not to its law.
        outdoes = bool(self.fits) and self.fits[ahead].outdoes(self.fits[behind])
        left = 0.0 if outdoes else self.excess(ahead)
        # A block may hold nearly all that tells a parameter, and what is predicted of it be off for the right law: of
        # one that explains as much of the fit, blocks show how little the records tell, not that it is wrong.
        is_no_worse = bool(self.fits) and self.fits[behind].is_no_worse(self.fits[ahead])
        matters = abs(total) >= max(MIN_SCORE_DIFFERENCE, 0.5 * left) and not is_no_worse
        variance = 0.0
        records = np.array([part.record for part in self.parts])
        for here in (records == record for record in {*records}):
            scatter = here.sum() * float(np.var(values[here], ddof=1)) if here.sum() > 1 and left else 0.0
            variance += max(scatter, float(np.sum(chance[here])))
        return Difference(total, float(np.sqrt(variance)), matters)

    def best(self, among: Sequence[str]) -> str:
        """The model of the highest score; of equal ones the first."""
        return max(among, key=self.total)


def scores_of(
    records: Sequence[Record],
    noises: Sequence[CommonNoise],
    parts: Sequence[Part],
    residuals: Mapping[str, Sequence[Float[np.ndarray, " n"]]],
    fits: Mapping[str, Fitness] = MappingProxyType({}),
) -> Scores:
    """The scores of models from their `residuals`, by model one array a part; a part that any model fails is dropped.

    So is one without samples that are compared.

    **Arguments:** the `fits` of `Scores`.
    """
    kept, whitened = [], {name: [] for name in residuals}
    volumes = []
    for number, part in enumerate(parts):
        white = whitener(records[part.record], noises[part.record], part.rows)
        found = {name: white(np.asarray(of[number])) for name, of in residuals.items()}
        if not white.samples or not all(np.isfinite(w).all() for w in found.values()):
            continue
        kept.append(part)
        volumes.append(white.log_volume)
        for name, w in found.items():
            whitened[name].append(w)
    return Scores(tuple(kept), {name: tuple(w) for name, w in whitened.items()}, tuple(volumes), fits)


def choose(order: Sequence[str], scores: Scores) -> tuple[str, str]:
    """The simplest model that predicts held-out samples no worse than any, and the one that predicts them best.

    Whole records go first: a model that predicts those to validate significantly worse is never chosen, however well it
    follows blocks of the records fitted; one that so predicts fitted records held out only where it outdoes the other
    by all that was fitted.

    **Arguments:** models from the simplest on.
    """
    records = scores.only("record", "validation")
    best = records.best(order)
    unseen = scores.only("validation")

    def is_eligible(name: str) -> bool:
        if not records.difference(best, name).is_significant:
            return True
        outdoes = bool(scores.fits) and scores.fits[name].outdoes(scores.fits[best])
        return outdoes and not unseen.difference(best, name).is_significant

    eligible = [name for name in order if is_eligible(name)]
    time = scores.only("time", "validation")
    reference = time.best(eligible)
    for name in eligible:
        if not time.difference(reference, name).is_significant:
            return name, reference
    return reference, reference


def groups_of(order: Sequence[str], chosen: str, reference: str, scores: Scores) -> list[list[str]]:
    """Models that the held-out samples do not tell apart, the best group first, each from the simplest on.

    A group has those that are not significantly worse than its best member; the first one is the group of the
    `reference`, and holds the `chosen` model.
    """
    time, records = scores.only("time", "validation"), scores.only("record", "validation")
    alike = lambda best, name: not any(s.difference(best, name).is_significant for s in (time, records))
    left, out, best = list(order), [], reference
    while left:
        group = [name for name in left if name in (best, chosen if not out else best) or alike(best, name)]
        out.append(group)
        left = [name for name in left if name not in group]
        best = time.best(left) if left else ""
    return out


def fitness(
    records: Sequence[Record],
    noises: Sequence[CommonNoise],
    residuals: Sequence[Float[np.ndarray, " samples"]],
    free: int,
) -> Fitness:
    """How well a model of `free` parameters explains what it was fitted to, under the common noise.

    **Arguments:** of each record that is fitted, its noise and the residuals of the fit.
    """
    deviance, independent, squares, samples = 0.0, 0.0, 0.0, 0
    for record, noise, residual in zip(records, noises, residuals, strict=True):
        white = whitener(record, noise, np.ones(residual.size, bool))
        w = white(residual)
        squares, samples = squares + float(w @ w), samples + w.size
        deviance += float(w @ w) + white.log_volume
        independent += noise.size.independent
    explains = squares <= samples + EXCESS_SIGMAS * np.sqrt(2.0 * max(samples, 1))
    return Fitness(free, deviance, deviance + free * float(np.log(max(independent, 1.0))), bool(explains))
