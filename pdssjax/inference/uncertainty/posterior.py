"""Draws from the posterior by the No-U-Turn sampler of NumPyro, in blocks, so that a run that is broken off goes on.

The density is exp(-chi-square / (2 factor)) on the scale of the fit, flat priors between the bounds: the zeros of the
sensors are marginalised (they are linear, and the residual leaves their projection out); the noise is taken as known,
that given or found, its variance enlarged by `factor` as those of the standard errors are.  The gradient is J'r, from
the residual and the Jacobian that forward derivatives give at once.

M. D. Hoffman and A. Gelman, Journal of Machine Learning Research 15, 2014; D. Phan, N. Pradhan and M. Jankowiak,
arXiv:1912.11554.  The only home of NumPyro.
"""

import functools
import importlib.util
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ...core import Document, InputError, Scalar
from ..draws import CHAINS, DRAWS, Drawing, each_done
from ..least_squares import Progress
from .preconditioner import Preconditioner

WARM_UP = 300
"""Draws of each chain in which the sampler finds its step and its metric; not kept."""

BLOCK = 50
"""Draws between two moments at which the state is kept."""

DEPTH = 8
"""Doublings of a trajectory at most."""

_SPREAD = 0.5
"""Of the starts of the chains, in standard errors."""

_TRIES = 20
"""Starts that are tried for a chain."""

Linearisation: TypeAlias = Callable[[Float[Array, " p"]], tuple[Float[Array, " n"], Float[Array, "n p"]]]
"""A traceable function, itself a pytree, from a point to residual and Jacobian."""

State: TypeAlias = Any
"""NumPyro's `HMCState`."""


class Chains(NamedTuple):
    """Draws after the warm-up."""

    free: Float[np.ndarray, "chains draws p"]
    """On the scale of the fit."""
    diverging: Bool[np.ndarray, "chains draws"]
    energy: Float[np.ndarray, "chains draws"]
    steps: Int[np.ndarray, "chains draws"]
    """Evaluations of each draw's trajectory."""
    acceptance: Float[np.ndarray, "chains draws"]


class Density(eqx.Module):
    """The potential, minus the log-density, as a function of the preconditioned coordinates."""

    linearise: Linearisation
    preconditioner: Preconditioner
    factor: Float[np.ndarray, ""]

    def __call__(self, u: Float[Array, " q"]) -> Scalar:
        x = self.preconditioner(u)
        stopped = lax.stop_gradient(x)
        residual, jacobian = self.linearise(stopped)
        value = 0.5 * jnp.sum(residual**2) / self.factor
        slope = jacobian.T @ residual / self.factor
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope))
        # What cannot be simulated is never accepted.
        value, slope = jnp.where(finite, value, jnp.inf), jnp.where(finite, slope, 0.0)
        # The value, and J'r as its derivative.
        return lax.stop_gradient(value) + lax.stop_gradient(slope) @ (x - stopped)


def need_numpyro() -> None:
    """**Raises** `InputError` where NumPyro is not installed."""
    if importlib.util.find_spec("numpyro") is None:
        raise InputError(
            'intervals: found "posterior", which needs NumPyro; expected it to be installed: '
            'pip install "pdssjax[posterior]".'
        )


def sample_posterior(
    density: Density, drawing: Drawing, executor: Executor | None, report: Progress, chains: int = CHAINS
) -> Chains:
    """Draws of several chains, each from a start of its own; blocks that the store has kept are not drawn again.

    Chains run side by side in the threads of the `executor`.

    **Raises:** `InputError` where no start of a chain can be simulated.
    """
    wanted = drawing.count or DRAWS
    blocks = -(-(WARM_UP + wanted) // BLOCK)
    kept = {(entry["chain"], entry["block"]): entry for entry in drawing.store.kept()}
    states: dict[int, State] = {}
    for chain in range(chains):
        template = _begin(density, drawing.seed, chain)
        done = [block for block in range(blocks) if (chain, block) in kept]
        states[chain] = _restored(kept[chain, done[-1]]["state"], template) if done else template
    for block in range(blocks):
        due = [chain for chain in range(chains) if (chain, block) not in kept]
        work = functools.partial(_drawn, density, states)
        for chain, (state, trace) in each_done(work, due, executor):
            states[chain] = state
            entry = _document(chain, block, state, trace)
            drawing.store.keep(entry)
            kept[chain, block] = entry
        report(f"posterior: {min((block + 1) * BLOCK, WARM_UP + wanted)} of {WARM_UP + wanted} draws a chain")
    return _joined(kept, chains, blocks, wanted)


def _drawn(density: Density, states: dict[int, State], chain: int) -> tuple[State, "_Trace"]:
    return _block(states[chain], density)


class _Trace(NamedTuple):
    """Of the draws of a block."""

    free: Float[Array, "draws p"]
    diverging: Bool[Array, " draws"]
    energy: Float[Array, " draws"]
    steps: Int[Array, " draws"]
    acceptance: Float[Array, " draws"]


@eqx.filter_jit
def _block(state: State, density: Density) -> tuple[State, _Trace]:
    """`BLOCK` transitions."""
    init, sample = _kernels()
    # Tells the kernel the settings that it keeps beside its state; the state itself is that from before.
    init(_info(state.z, state.potential_energy, state.z_grad), model_args=(density,), **_SETTINGS)

    def advance(state: State, _: None) -> tuple[State, _Trace]:
        state = sample(state, (density,))
        free = density.preconditioner(state.z)
        return state, _Trace(free, state.diverging, state.energy, state.num_steps, state.accept_prob)

    return lax.scan(advance, state, None, BLOCK)


def _kernels() -> tuple[Callable[..., State], Callable[..., State]]:
    """How NumPyro begins and how it goes on."""
    from numpyro.infer.hmc import hmc

    return hmc(potential_fn_gen=lambda density: density, algo="NUTS")


def _info(u: Float[Array, " q"], potential: Scalar, gradient: Float[Array, " q"]) -> State:
    from numpyro.infer.util import ParamInfo

    return ParamInfo(u, potential, gradient)


def _begin(density: Density, seed: int, chain: int) -> State:
    """The state in which a chain begins."""
    random = np.random.default_rng([seed, chain])
    for _ in range(_TRIES):
        u = jnp.asarray(_SPREAD * random.standard_normal(density.preconditioner.axes.shape[1]))
        # By what is compiled for the fit already.
        residual, jacobian = density.linearise(density.preconditioner(u))
        value = 0.5 * jnp.sum(residual**2) / density.factor
        if np.isfinite(value) and np.isfinite(jacobian).all():
            slope = jacobian.T @ residual / density.factor
            gradient = slope @ jax.jacfwd(density.preconditioner)(u)
            key = jax.random.fold_in(jax.random.PRNGKey(seed), chain)
            init, _ = _kernels()
            return init(_info(u, value, gradient), rng_key=key, model_args=(density,), **_SETTINGS)
    raise InputError(
        f"posterior: found none of {_TRIES} starts of chain {chain + 1} that can be simulated; expected a fit that "
        "stays within the model's reach."
    )


_SETTINGS = dict(num_warmup=WARM_UP, step_size=0.5, dense_mass=True, max_tree_depth=DEPTH)


def _document(chain: int, block: int, state: State, trace: _Trace) -> Document:
    return {
        "chain": chain,
        "block": block,
        **{name: np.asarray(values).tolist() for name, values in trace._asdict().items()},
        "state": [np.asarray(leaf).tolist() for leaf in jax.tree.leaves(state)],
    }


def _restored(leaves: list[object], template: State) -> State:
    """The state that was kept, with the types of the `template`."""
    types, structure = jax.tree.flatten(template)
    return structure.unflatten(jnp.asarray(leaf, like.dtype) for leaf, like in zip(leaves, types, strict=True))


def _joined(kept: dict[tuple[int, int], Document], chains: int, blocks: int, wanted: int) -> Chains:
    """All blocks of each chain, without the warm-up."""

    def values(name: str) -> np.ndarray:
        whole = [
            np.concatenate([np.array(kept[chain, block][name]) for block in range(blocks)]) for chain in range(chains)
        ]
        return np.stack(whole)[:, WARM_UP : WARM_UP + wanted]

    return Chains(*(values(name) for name in Chains._fields))
