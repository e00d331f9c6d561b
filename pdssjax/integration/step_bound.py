"""The bound on steps over which derivatives do not grow: a span of the quickest transient, read off the field itself.

See docs/numerics.md, "Steps that derivatives can bear".
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar
from .system import SETTLED
from .taylor_series import Field, constant

_FORCED = 1.5
"""So many times longer a step may be for what is known in closed form, and only enters the rest as a forcing."""


def longest_step(
    field: Field,
    t_local: Scalar,
    x: Sequence[Scalar],
    mode: Scalar,
    closed: Sequence[int],
    span: float,
    remaining: Scalar,
) -> Scalar:
    """How long a step [s] from `x` at `t_local` [s] may be: what is `remaining` [s], or less where derivatives grow.

    **Arguments:** the numbers of the components that are known in closed form; the `span` of the method in time
    constants.  What has settled does not move, and has no bound.
    """
    rate = _quickest_rate(field, t_local, x, closed)
    too_far = (mode != SETTLED) & (remaining * rate > span)
    return jnp.where(too_far, span / rate, remaining)


def _quickest_rate(field: Field, t_local: Scalar, x: Sequence[Scalar], closed: Sequence[int]) -> Scalar:
    """About the largest modulus [1/s] of the eigenvalues of the field's Jacobian at `x`; see `span` of the methods.

    A transient that has decayed has coefficients that vanish and allow any step.  What the same step
    does to derivatives is not seen there: beyond the method's region of stability they grow, and with them
    what is left of rounding, from step to step.  Two components a, b that feel each other turn or decay at
    the rate sqrt|J_ab J_ba|, whatever their units; what only one of them feels changes no eigenvalue.
    """

    def flow(x: Float[Array, " components"]) -> Float[Array, " components"]:
        return jnp.stack([jnp.asarray(constant(rate), float) for rate in field(t_local, list(x))])

    jacobian = jax.jacfwd(flow)(jnp.stack(x))
    known = np.isin(np.arange(len(x)), closed)
    weight = np.where(known, 1.0 / _FORCED**2, 1.0)
    mutual = jnp.abs(jacobian * jacobian.T) * weight
    return jnp.sqrt(jnp.max(jnp.sum(jnp.where(jnp.isfinite(mutual), mutual, 0.0), axis=1)))
