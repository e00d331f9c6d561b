"""A call that JAX differentiates by a rule of its own, and maps one lane after the other.

`jax.custom_jvp` is not enough for a rule whose derivative is wanted, too: where JAX takes a loop apart to transpose it,
it drops the rule and differentiates what the function does (`lax.map` in forward over reverse mode).  A primitive
keeps its rule.  Under `vmap` lanes run one after the other: side by side every lane of an adaptive loop waits for the
one with most steps, and each `lax.cond` computes both of its sides.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

Result = TypeVar("Result")

Argument: TypeAlias = Any
"""A pytree, whatever its leaves; those that are arrays may move."""

Rule: TypeAlias = Callable[[tuple[Any, ...], tuple[Any, ...]], tuple[Any, Any]]
"""From arguments and their tangents (None: nothing moves) to the result and its tangents (None: it does not move)."""

_FlatRule: TypeAlias = Callable[
    [Sequence[Array], Sequence[Array | None]], tuple[Sequence[Array], Sequence[Array | None]]
]


def ruled_call(function: Callable[..., Result], rule: Rule, *args: Argument) -> Result:
    """`function(*args)`, a pytree of arrays, whose derivatives follow from `rule`.

    **Arguments:** neither `function` nor `rule` may hold traced arrays that are not among `args`.
    """
    arrays, static = eqx.partition(args, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    whole = lambda leaves: eqx.combine(jax.tree.unflatten(structure, leaves), static)
    types = [jax.ShapeDtypeStruct(t.shape, t.dtype, weak_type=t.weak_type) for t in map(jax.typeof, leaves)]
    call, result = jax.make_jaxpr(lambda *leaves: function(*whole(leaves)), return_shape=True)(*types)

    def flat_rule(
        primals: Sequence[Array], tangents: Sequence[Array | None]
    ) -> tuple[Sequence[Array], Sequence[Array | None]]:
        out, out_dot = rule(whole(primals), jax.tree.unflatten(structure, tangents))
        return jax.tree.leaves(out), jax.tree.leaves(out_dot, is_leaf=lambda leaf: leaf is None)

    found = _CALL.bind(*leaves, call=call, rule=flat_rule)
    return jax.tree.unflatten(jax.tree.structure(result), found)


_CALL = Primitive("pdssjax_run")
_CALL.multiple_results = True


def _computed(*leaves: Array, call: ClosedJaxpr, rule: _FlatRule) -> list[Array]:
    return jaxpr_as_fun(call)(*leaves)


def _differentiated(
    primals: Sequence[Array], tangents: Sequence[Any], *, call: ClosedJaxpr, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[Any]]:
    moves = [None if type(tangent) is ad.Zero else tangent for tangent in tangents]
    out, out_dot = rule(primals, moves)
    none = [ad.Zero(jax.typeof(leaf).to_tangent_aval()) for leaf in out]
    return out, [zero if dot is None else dot for zero, dot in zip(none, out_dot, strict=True)]


def _lane_by_lane(
    leaves: Sequence[Array], axes: Sequence[int | None], *, call: ClosedJaxpr, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[int]]:
    mapped = [jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True) if axis is not None]

    def lane(mapped: list[Array]) -> list[Array]:
        these = iter(mapped)
        whole = [leaf if axis is None else next(these) for leaf, axis in zip(leaves, axes, strict=True)]
        return _CALL.bind(*whole, call=call, rule=rule)

    found = lax.map(lane, mapped)
    return found, [0] * len(found)


_CALL.def_impl(lambda *leaves, call, rule: jax.jit(jaxpr_as_fun(call))(*leaves))
_CALL.def_abstract_eval(lambda *leaves, call, rule: call.out_avals)
ad.primitive_jvps[_CALL] = _differentiated
batching.primitive_batchers[_CALL] = _lane_by_lane
mlir.register_lowering(_CALL, mlir.lower_fun(_computed, multiple_results=True))
