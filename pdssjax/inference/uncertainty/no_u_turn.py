"""Draws by the No-U-Turn sampler of NumPyro, of a density that costs nothing.

M. D. Hoffman and A. Gelman, Journal of Machine Learning Research 15, 2014; D. Phan, N. Pradhan and M. Jankowiak,
arXiv:1912.11554.  The only home of NumPyro.
"""

import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ...core import InputError, Scalar
from .preconditioner import Preconditioner
from .residual_polynomial import ResidualPolynomial

WARM_UP = 500
"""Draws of each chain in which the sampler finds its step and its metric; not kept."""

_BLOCK = 50
"""Draws in one call of what is compiled."""

_SPREAD = 0.5
"""Of the starts of the chains, in standard errors."""

_SETTINGS = dict(num_warmup=WARM_UP, step_size=0.5, dense_mass=True, max_tree_depth=10)

_ACCEPTANCES = 0.97, 0.99
"""With which trajectories go on, at first and where too many diverge: the higher, the smaller the steps."""

_DIVERGING = 1e-2
"""Share of trajectories that may diverge; more, and ends of the density are left out: steps must be smaller."""

State: TypeAlias = Any
"""NumPyro's `HMCState`."""


class Density(eqx.Module):
    """The potential, minus the log-density, as a function of the preconditioned coordinates."""

    polynomial: ResidualPolynomial
    preconditioner: Preconditioner
    factor: Float[np.ndarray, ""]
    """By which variances exceed those of the noise given."""

    def __call__(self, u: Float[Array, " q"]) -> Scalar:
        return 0.5 * jnp.sum(self.polynomial(self.preconditioner(u)) ** 2) / self.factor


class Trace(NamedTuple):
    """Draws of one chain after the warm-up."""

    free: Float[np.ndarray, "draws p"]
    """On the scale of the fit."""
    potential: Float[np.ndarray, " draws"]
    diverging: Bool[np.ndarray, " draws"]
    energy: Float[np.ndarray, " draws"]
    steps: Int[np.ndarray, " draws"]
    """Evaluations of each draw's trajectory."""
    acceptance: Float[np.ndarray, " draws"]


def need_numpyro() -> None:
    """**Raises** `InputError` where NumPyro is not installed."""
    if importlib.util.find_spec("numpyro") is None:
        raise InputError(
            'intervals: found "posterior", which needs NumPyro; expected it to be installed: '
            'pip install "pdssjax[posterior]".'
        )


def draw(density: Density, count: int, seed: tuple[int, ...], thinning: int = 1) -> Trace:
    """`count` draws of one chain, every `thinning`-th, in steps as small as it takes."""
    whole = _chain(density, WARM_UP + count * thinning, seed, _ACCEPTANCES[0])
    if np.mean(whole.diverging[WARM_UP:]) > _DIVERGING:
        whole = _chain(density, WARM_UP + count * thinning, seed, _ACCEPTANCES[1])
    kept = slice(WARM_UP + thinning - 1, WARM_UP + count * thinning, thinning)
    return Trace(*(values[kept] for values in whole))


def _chain(density: Density, count: int, seed: tuple[int, ...], acceptance: float) -> Trace:
    """At least `count` draws, those of the warm-up too."""
    state, blocks = _begin(density, seed, acceptance), []
    for _ in range(-(-count // _BLOCK)):
        state, block = _block(state, density, acceptance)
        blocks.append(jax.tree.map(np.asarray, block))
    return Trace(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))


@eqx.filter_jit
def _block(state: State, density: Density, acceptance: float) -> tuple[State, tuple[Array, ...]]:
    """`_BLOCK` transitions."""
    init, sample = _kernels()
    # Tells the kernel the settings that it keeps beside its state; the state itself is that from before.
    here = _info(state.z, state.potential_energy, state.z_grad)
    init(here, model_args=(density,), target_accept_prob=acceptance, **_SETTINGS)

    def advance(state: State, _: None) -> tuple[State, tuple[Array, ...]]:
        state = sample(state, (density,))
        free = density.preconditioner(state.z)
        told = state.potential_energy, state.diverging, state.energy, state.num_steps, state.accept_prob
        return state, (free, *told)

    return lax.scan(advance, state, None, _BLOCK)


def _kernels() -> tuple[Callable[..., State], Callable[..., State]]:
    """How NumPyro begins and how it goes on."""
    from numpyro.infer.hmc import hmc

    return hmc(potential_fn_gen=lambda density: density, algo="NUTS")


def _info(u: Float[Array, " q"], potential: Scalar, gradient: Float[Array, " q"]) -> State:
    from numpyro.infer.util import ParamInfo

    return ParamInfo(u, potential, gradient)


def _begin(density: Density, seed: tuple[int, ...], acceptance: float) -> State:
    """The state in which a chain begins."""
    directions = density.preconditioner.axes.shape[1]
    u = jnp.asarray(_SPREAD * np.random.default_rng(seed).standard_normal(directions))
    key = jax.random.PRNGKey(seed[0])
    for number in seed[1:]:
        key = jax.random.fold_in(key, number)
    init, _ = _kernels()
    start = _info(u, *jax.value_and_grad(density)(u))
    return init(start, rng_key=key, model_args=(density,), target_accept_prob=acceptance, **_SETTINGS)
