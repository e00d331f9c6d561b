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
from jax.extend.core import Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

from ..core import Tree

Result = TypeVar("Result")

Rule: TypeAlias = Callable[[tuple[Any, ...], tuple[Any, ...]], tuple[Any, Any]]
"""From arguments and their tangents (None: nothing moves) to the result and its tangents (None: it does not move)."""

_FlatRule: TypeAlias = Callable[
    [Sequence[Array], Sequence[Array | None]], tuple[Sequence[Array], Sequence[Array | None]]
]


def ruled_call(function: Callable[..., Result], rule: Rule, *args: Tree) -> Result:
    """`function(*args)`, a pytree of arrays, whose derivatives follow from `rule`.

    **Arguments:** `args` are pytrees, of which the arrays may move.  Neither `function` nor `rule` may hold traced
    arrays that are not among them.
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

    found = _CALL.bind(*leaves, call=jaxpr_as_fun(call), types=tuple(call.out_avals), rule=flat_rule)
    return jax.tree.unflatten(jax.tree.structure(result), found)


_CALL = Primitive("pdssjax_run")
_CALL.multiple_results = True


# What is called is a function, not the traced program itself: newer versions of JAX want rules of their own for
# primitives that hold one.
_Call: TypeAlias = Callable[..., list[Array]]
_Types: TypeAlias = tuple[Any, ...]
"""What JAX knows of each result, in a class of its own."""


def _computed(*leaves: Array, call: _Call, types: _Types, rule: _FlatRule) -> list[Array]:
    return call(*leaves)


def _differentiated(
    primals: Sequence[Array], tangents: Sequence[Any], *, call: _Call, types: _Types, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[Any]]:
    moves = [None if type(tangent) is ad.Zero else tangent for tangent in tangents]
    out, out_dot = rule(primals, moves)
    none = [ad.Zero(jax.typeof(leaf).to_tangent_aval()) for leaf in out]
    return out, [zero if dot is None else dot for zero, dot in zip(none, out_dot, strict=True)]


def _lane_by_lane(
    leaves: Sequence[Array], axes: Sequence[int | None], *, call: _Call, types: _Types, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[int]]:
    mapped = [jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True) if axis is not None]

    def lane(mapped: list[Array]) -> list[Array]:
        these = iter(mapped)
        whole = [leaf if axis is None else next(these) for leaf, axis in zip(leaves, axes, strict=True)]
        return _CALL.bind(*whole, call=call, types=types, rule=rule)

    found = lax.map(lane, mapped)
    return found, [0] * len(found)


_CALL.def_impl(lambda *leaves, call, types, rule: jax.jit(call)(*leaves))
_CALL.def_abstract_eval(lambda *leaves, call, types, rule: list(types))
ad.primitive_jvps[_CALL] = _differentiated
batching.primitive_batchers[_CALL] = _lane_by_lane
mlir.register_lowering(_CALL, mlir.lower_fun(_computed, multiple_results=True))
