"""Draws of a posterior by the No-U-Turn sampler of NumPyro, of the model itself.

A sampler of this kind (M. D. Hoffman and A. Gelman, J. Machine Learning Research 15, 2014) wants a density that is as
wide in every direction and not bent, and that of a fit is a narrow bent valley.  So it moves in
coordinates e in which a few steps lead from one end of the posterior to the other.

Where the polynomial behind these folds over trajectories end, and beside a fold, where the density of the coordinates
has a spike, their steps are too long to leave it.  So two moves come before each trajectory, which the model accepts
or not: a proposal of `randomize_then_optimize`, which reaches beyond folds and alone leads back from there; and a short
step along the gradient (G. O. Roberts and R. L. Tweedie, Bernoulli 2(4), 1996), of a length drawn anew every time.
Each move leaves the posterior as it is, and so does one after the other.

The coordinates e, in which the posterior is nearly a standard normal distribution:

    Q' r^(x0 + A w) = sqrt(v) e,        density of e:    p(x) exp(-|r(x)|^2 / (2 v)) |det dx/de|

r^ is the polynomial that stands for the residuals, r the model, p the prior, Q as in `randomize_then_optimize`:
whatever the polynomial is, the density is the model's (M. D. Parno and Y. M. Marzouk, SIAM/ASA J. Uncertainty
Quantification 6(2), 2018, for a map in front of a sampler).  Where the polynomial folds over there is no e.
"""

import functools
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...core import Document, Scalar
from ..draws import CHAINS, DRAWS, Drawing, each_done, refuse_wrong_entries, stream
from ..least_squares import Progress
from .posterior import BLOCK, PROPOSAL_WIDTHS, Chains, Model, learn, task_of
from .profile_likelihood import Evaluate
from .randomize_then_optimize import NothingToDraw, RandomizedResiduals, Widths, log_proposed


class Place(NamedTuple):
    """A point of the posterior, in both kinds of coordinates."""

    w: Float[Array, " q"]
    volume: Scalar
    """log |det du/dw| of the polynomial."""
    volume_slope: Float[Array, " q"]
    """The derivatives of `volume` by w."""
    slopes: Float[Array, "q q"]
    """du/dw."""
    solved: Bool[Array, ""]


class TransportMap(RandomizedResiduals):
    """The map from e to w, and its inverse, by the equation whose u is sqrt(v) e."""

    @eqx.filter_jit
    def place(self, e: Float[Array, " q"]) -> Place:
        equation = self.equation()
        w, volume, solved = equation.solve(jnp.sqrt(self.variance) * e)
        volume_slope = jax.grad(lambda w: jnp.linalg.slogdet(equation.slopes(w))[1])(w)
        return Place(w, volume, volume_slope, equation.slopes(w), solved)

    @eqx.filter_jit
    def back(self, w: Float[Array | np.ndarray, " q"]) -> tuple[Float[Array, " q"], Bool[Array, ""]]:
        """The e of a point, and whether it leads there again: not so beyond a fold."""
        u, _, solved = self.equation().back(jnp.asarray(w))
        return u / jnp.sqrt(self.variance), solved


class TransportedDensity(eqx.Module):
    """The posterior's density of e."""

    map: TransportMap
    evaluate: Evaluate
    slopes: Float[np.ndarray, " p"]
    """Gradient of the logarithm of the prior."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]

    def potential(self, e: Float[Array, " q"]) -> tuple[Scalar, Float[Array, " q"]]:
        """-log density but for a constant, and its derivatives; infinite where there is nothing."""
        place, variance = self.map.place(e), self.map.variance
        x = self.map.at(place.w)
        residual, jacobian = self.evaluate(x)
        value = 0.5 * jnp.sum(residual**2) / variance + place.volume - self.slopes @ (x - self.map.polynomial.centre)
        by_w = self.map.axes.T @ (jacobian.T @ residual / variance - self.slopes) + place.volume_slope
        slope = jnp.sqrt(variance) * jnp.linalg.solve(place.slopes.T, by_w)
        there = place.solved & jnp.all((x >= self.low) & (x <= self.high)) & jnp.isfinite(value)
        there &= jnp.all(jnp.isfinite(slope))
        return jnp.where(there, value, jnp.inf), jnp.where(there, slope, 0.0)


WARM_UP = 150
"""Trajectories from which the length of a step is learned; they are no draws."""

_WARM_UP_BLOCK = -1
"""Number of the block of draws that is the warm-up, whose draws are dropped."""

_START_WIDTHS = Widths(solved=(1.2,), linear=1.0, share=0.0)
"""Widths of the mixture that chains begin in."""

_CANDIDATES = 20
"""Candidates for a chain's start: the first one that the model can be simulated at is taken."""

_STEP_LENGTHS = (0.02, 0.5)
"""Lengths of the short steps, in standard deviations."""


class _Sampler(NamedTuple):
    begin: Callable[..., Any]
    """NumPyro's state at an e, for the key of random numbers and the length of a step."""
    go_on: Callable[[Any], Any]
    """One trajectory on; compiled."""


def sample_by_trajectories(
    model: Model, drawing: Drawing, executor: Executor | None, report: Progress, chains: int = CHAINS
) -> Chains:
    """Draws of several chains; what the store has kept is not drawn again.

    Chains run side by side in the threads of the `executor`.  Each block of a chain begins with the numbers that the
    one before has kept, so that a run that was broken off ends as if it had not been.

    **Raises:** `InputError` where what was kept is not what a run writes; `NothingToDraw` where chains find nowhere to
    begin.
    """
    wanted = drawing.count or DRAWS
    blocks = range(_WARM_UP_BLOCK, -(-wanted // BLOCK))
    with refuse_wrong_entries(drawing.store, "draws of the chains"):
        p, q = model.axes.shape
        each = dict.fromkeys(("log_posterior", "steps", "acceptance", "diverging"), (BLOCK,))
        first, later = {"end": (q,), "step_size": ()}, {"end": (q,), "free": (BLOCK, p), **each}
        entries = drawing.store.kept()
        kept = {task_of(entry, first if entry["block"] == _WARM_UP_BLOCK else later): entry for entry in entries}
    if any((chain, block) not in kept for chain in range(chains) for block in blocks):
        learned = TransportMap(learn(model, drawing.seed, executor, report), model.axes, model.held, model.factor)
        target = TransportedDensity(learned, model.evaluate, model.prior_slopes, *model.bounds)
        report("posterior: compiling the sampler")
        sampler = _sampler(target)
        done = 0
        for block in blocks:
            due = [chain for chain in range(chains) if (chain, block) not in kept]
            work = functools.partial(_block, target, sampler, model, drawing.seed, block, kept)
            for chain, entry in each_done(work, due, executor):
                drawing.store.keep(entry)
                kept[chain, block] = entry
                done += 1
                report(f"posterior: {done} of {chains * len(blocks)} blocks of {BLOCK} draws")
    each = [[kept[chain, block] for block in blocks if block != _WARM_UP_BLOCK] for chain in range(chains)]
    # The density is None where the model cannot be simulated.
    numbers = lambda block, name: np.array(block[name], float if name == "log_posterior" else None)
    whole = lambda name: np.stack([np.concatenate([numbers(b, name) for b in part])[:wanted] for part in each])
    diverging, density = np.asarray(whole("diverging"), bool), whole("log_posterior")
    return Chains(
        free=whole("free"),
        failed=int(np.sum(diverging)),
        statistics={
            "lp": np.where(np.isnan(density), -np.inf, density),
            "acceptance_rate": whole("acceptance"),
            "n_steps": whole("steps"),
            "diverging": diverging,
        },
    )


def _sampler(target: TransportedDensity) -> _Sampler:
    from numpyro.infer.hmc import hmc
    from numpyro.infer.util import ParamInfo

    arrays, rest = eqx.partition(target, eqx.is_array)

    def potential_of(arrays: Any) -> Callable[[Float[Array, " q"]], Scalar]:
        both = eqx.combine(arrays, rest).potential

        @jax.custom_vjp
        def potential(e: Float[Array, " q"]) -> Scalar:
            return both(e)[0]

        # The model's forward derivatives cost less than its reverse ones.
        potential.defvjp(both, lambda slope, seed: (seed * slope,))
        return potential

    init, sample = hmc(potential_fn_gen=potential_of)

    def begin(e: Float[Array, " q"], key: Int[Array, "..."], step_size: float = 0.5) -> Any:
        info = ParamInfo(e, *target.potential(e))
        return init(
            info,
            WARM_UP,
            step_size,
            adapt_mass_matrix=False,
            target_accept_prob=0.8,
            max_tree_depth=8,
            rng_key=key,
            model_args=(arrays,),
        )

    trajectory = jax.jit(lambda state, arrays: sample(state, (arrays,)))
    state = begin(jnp.zeros(target.map.axes.shape[1]), jax.random.key(0))
    compiled = trajectory.lower(state, arrays).compile()
    return _Sampler(begin, lambda state: compiled(state, arrays))


def _block(
    target: TransportedDensity,
    sampler: _Sampler,
    model: Model,
    seed: int,
    block: int,
    kept: Mapping[tuple[int, int], Document],
    chain: int,
) -> Document:
    """A block of draws of a chain, or what is learned before the first of them, as plain data."""
    task = {"chain": chain, "block": block}
    if block == _WARM_UP_BLOCK:
        return task | _warmed_up(target, sampler, model, seed, chain)
    random = stream(seed, "move", chain, block)
    begin, step_size = kept[chain, block - 1]["end"], kept[chain, _WARM_UP_BLOCK]["step_size"]
    going = _Chain(target, sampler, model, step_size, random, np.array(begin, float))
    proposals = model.proposals(target.map.polynomial, PROPOSAL_WIDTHS, BLOCK, stream(seed, "propose", chain, block))
    draws = [going.next(*proposed) for proposed in zip(proposals.free, proposals.log_proposed, strict=True)]
    return task | {name: [draw[name] for draw in draws] for name in draws[0]} | {"end": going.w.tolist()}


def _warmed_up(target: TransportedDensity, sampler: _Sampler, model: Model, seed: int, chain: int) -> Document:
    """The start of a chain, and the length of its steps."""
    random = stream(seed, "warm up", chain)
    places = model.proposals(target.map.polynomial, _START_WIDTHS, _CANDIDATES, random).free
    key = _key(random)
    states = (sampler.begin(target.map.back(w)[0], key) for w in model.along_axes(places))
    state = next((state for state in states if np.isfinite(state.potential_energy)), None)
    if state is None:
        raise NothingToDraw(
            f"posterior: found none of {_CANDIDATES} draws of the polynomial where the model can be simulated, "
            "expected one for a chain to begin at."
        )
    for _ in range(WARM_UP):
        state = sampler.go_on(state)
    end = np.asarray(target.map.place(state.z).w).tolist()
    return {"end": end, "step_size": float(state.adapt_state.step_size)}


def _key(random: np.random.Generator) -> Any:
    return jax.random.key(int(random.integers(2**31)))


class _Chain:
    """A chain, which moves by a proposal, a short step and a trajectory in turn."""

    def __init__(
        self,
        target: TransportedDensity,
        sampler: _Sampler,
        model: Model,
        step_size: float,
        random: np.random.Generator,
        w: Float[np.ndarray, " q"],
    ):
        self._target, self._sampler, self._model = target, sampler, model
        self._random, self._mixture = random, model.mixture(target.map.polynomial, PROPOSAL_WIDTHS)
        state = sampler.begin(jnp.zeros(w.size), _key(random), step_size)
        # What is learned of the length of a step ends with the warm-up.
        self._state = state._replace(i=jnp.full_like(state.i, WARM_UP))
        self._be_at(w, self._log_density(w))

    def next(self, proposed: Float[np.ndarray, " p"], log_proposed: float) -> Document:
        """The next draw, with the statistics of its trajectory; there is none where the chain is beyond a fold.

        **Arguments:** a draw that the polynomial proposes, and the logarithm of its density there.
        """
        self._judge(self._model.along_axes(proposed), log_proposed)
        steps, acceptance, diverging = 0, 0.0, False
        if self._inside:
            self._step_along_gradient()
            self._state = state = self._sampler.go_on(self._state)
            place = self._target.map.place(state.z)
            self.w = np.asarray(place.w)
            self._density = float(place.volume - state.potential_energy)
            steps, acceptance, diverging = int(state.num_steps), float(state.accept_prob), bool(state.diverging)
        free = np.asarray(self._target.map.at(self.w)).tolist()
        course = {"steps": steps, "acceptance": acceptance, "diverging": diverging}
        density = self._density if np.isfinite(self._density) else None  # JSON has no infinity
        return {"free": free, "log_posterior": density} | course

    def _judge(self, proposed: Float[np.ndarray, " q"], log_there: float) -> None:
        density, log_here = self._log_density(proposed), log_proposed(self._mixture, self.w)
        # Of the model's density over that of the proposals.
        if np.log(self._random.random()) < density - log_there - self._density + float(log_here):
            self._be_at(proposed, density)

    def _step_along_gradient(self) -> None:
        length = np.exp(self._random.uniform(*np.log(_STEP_LENGTHS)))
        noise = self._random.standard_normal(self.w.size)
        begin, energy, slope = self._state.z, self._state.potential_energy, self._state.z_grad
        end = begin - 0.5 * length**2 * slope + length * noise
        energy_then, slope_then = self._target.potential(end)
        back = (begin - end + 0.5 * length**2 * slope_then) / length
        if np.log(self._random.random()) < energy - energy_then + 0.5 * (noise @ noise - back @ back):
            self._state = self._state._replace(z=end, potential_energy=energy_then, z_grad=slope_then)

    def _be_at(self, w: Float[np.ndarray, " q"], density: float) -> None:
        self.w, self._density = w, density
        e, self._inside = self._target.map.back(w)
        if self._inside:
            energy, slope = self._target.potential(e)
            self._state = self._state._replace(z=e, potential_energy=energy, z_grad=slope)

    def _log_density(self, w: Float[np.ndarray, " q"]) -> float:
        """The logarithm of the model's density, up to a constant."""
        x, (low, high) = np.asarray(self._target.map.at(w)), self._model.bounds
        if np.any(x < low) or np.any(x > high):
            return -np.inf
        value = -0.5 * float(np.sum(np.asarray(self._model.residuals(x)) ** 2)) / self._model.factor
        value += float(self._model.log_prior(x))
        return value if np.isfinite(value) else -np.inf
