"""The recurrence of `taylor_series` as a loop over the order, for many expansions at once.

Unrolled, the code of a recurrence grows with the square of the order, and takes most of a prediction's
time to compile.  Here a field is evaluated once, on series, and its operations on them are
recorded as a tape; a loop over the order then replays it.  Arrays have the expansions along their
last axis, and the order along their first, so that every operation runs along the expansions.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, ScalarLike
from . import taylor_series as series
from .taylor_series import Field, Order, Rule, Series, Weight, is_zero
from .tracing import computed_once

_CONVOLVED: dict[Rule, tuple[int | None, int | None]] = {
    series.product_rule: (0, 1),
    series.quotient_rule: (None, 1),
    series.exp_rule: (0, None),
    series.power_rule: (0, None),
    series.cosine_rule: (0, 1),
    series.sine_rule: (0, 1),
}
"""Rules that sum over all lower coefficients of two series: of those operands, or None for the rule's own series."""

Carry: TypeAlias = tuple[
    dict[int, Float[Array, "orders m"]], dict[int, Float[Array, " m"]], dict[int, Float[Array, " m"]]
]
"""Coefficients: of the stored nodes those up to order k - 2, then those of order k - 1; of the components of the state
that vary those of order k."""


class Node(NamedTuple):
    """A recorded series."""

    rule: Rule
    operands: tuple[int, ...]
    """Their places in the tape."""
    literals: tuple[ScalarLike | None, ...]
    """The numbers in the node, None for those that are arrays."""


class Tape(eqx.Module):
    """The operations of a field on the series of a state: first the state, then the rest, operands first."""

    nodes: tuple[Node, ...] = eqx.field(static=True)
    rates: tuple[int | None, ...] = eqx.field(static=True)
    """The place of each component's rate; None for the integer 0."""
    numbers: list[list[Float[Array, " m"]]]
    """The numbers of each node that are arrays."""
    starts: list[Float[Array, " m"] | None]
    """Coefficient 0 of each node; None for what is known to vanish."""


def trace_field(field: Field, time: ScalarLike, state: Sequence[ScalarLike]) -> Tape:
    """The tape of what `field(t, x)` does to the series of `time` and `state`, all of them scalars.

    **Arguments:** as of `taylor_series.taylor_coefficients`.
    """
    unknowns = [series.unknown(jnp.asarray(x, float)) for x in state]
    rates = field(series.polynomial([time, 1.0]), list(unknowns))
    rates = [x if isinstance(x, Series) or is_zero(x) else series.polynomial([x]) for x in rates]
    order: dict[int, Series] = {}
    seen: set[int] = set()

    def visit(node: Series) -> None:
        if id(node) not in seen:
            seen.add(id(node))
            for operand in node.operands:
                visit(operand)
            order[id(node)] = node

    for node in [*unknowns, *(rate for rate in rates if isinstance(rate, Series))]:
        visit(node)
    place = {identity: i for i, identity in enumerate(order)}
    is_literal = lambda number: isinstance(number, int | float)
    nodes = tuple(
        Node(
            node.rule,
            tuple(place[id(x)] for x in node.operands),
            tuple(_literal(number) if is_literal(number) else None for number in node.numbers),  # pyright: ignore[reportArgumentType]
        )
        for node in order.values()
    )
    return Tape(
        nodes,
        tuple(None if is_zero(rate) else place[id(rate)] for rate in rates),
        [[jnp.asarray(n, float) for n in node.numbers if not is_literal(n)] for node in order.values()],
        [None if is_zero(node[0]) else jnp.asarray(node[0], float) for node in order.values()],
    )


def _literal(number: float) -> float:
    """The number as a Python float, or an integer as it is: NumPy's floats must not be in a static field."""
    return number if isinstance(number, int) else float(number)


def looped_coefficients(tape: Tape, order: int, opaque_one: Float[Array, " m"]) -> list[Float[Array, "coefficients m"]]:
    """Taylor coefficients of many solutions side by side, those of `taylor_series.taylor_coefficients`.

    **Arguments:** the arrays of `tape` and `opaque_one` have shape (m,).

    **Returns:** for each component the coefficients, shape (order + 1, m).
    """
    constant = _constants(tape)
    components = range(len(tape.rates))
    start = lambda i: 0 if tape.starts[i] is None else tape.starts[i]
    row = lambda x: jnp.broadcast_to(jnp.asarray(x, float), opaque_one.shape)
    rate_of = lambda i, rates, k: rates(tape.rates[i]) * (1.0 / (k * opaque_one))
    varying = [i for i in components if not constant[i]]
    stored = sorted(_looking_back(tape, constant) | set(varying))
    # Coefficient i stands at order - i, followed by zeros, so that a shifted slice never runs over the end.
    blank = jnp.zeros((2 * order, *opaque_one.shape))

    def next_order(k: Count, carry: Carry) -> Carry:
        buffers, before, now = carry
        # Written first and only read afterwards, the buffers are not copied.
        buffers = {i: lax.dynamic_update_index_in_dim(buffers[i], before[i], order - k + 1, 0) for i in stored}
        entries = [
            _TapeEntry(start(i), constant[i], buffers.get(i), order, now.get(i, 0)) for i in range(len(tape.nodes))
        ]
        for i in range(len(components), len(tape.nodes)):
            entries[i].compute_coefficient(tape, i, entries, k, opaque_one)
        after = {i: row(rate_of(i, lambda j: entries[j][k], k + 1)) for i in varying}
        return buffers, {i: row(entries[i][k]) for i in stored}, after

    first = {i: row(rate_of(i, start, 1)) for i in varying}
    carry = dict.fromkeys(stored, blank), {i: row(start(i)) for i in stored}, first
    buffers, before, last = lax.fori_loop(1, order, next_order, carry)

    def coefficients(i: int) -> Float[Array, "coefficients m"]:
        if constant[i]:
            return jnp.concatenate([row(start(i))[None], jnp.zeros((order, *opaque_one.shape))])
        return jnp.concatenate([buffers[i][order:1:-1], before[i][None], last[i][None]])

    return [coefficients(i) for i in components]


class _TapeEntry:
    """A series within the loop: its coefficients 0 and k, and those before k if a rule sums over them."""

    def __init__(
        self, start: ScalarLike, constant: bool, buffer: Float[Array, "orders m"] | None, order: int, now: ScalarLike
    ):
        self._start, self._constant, self._buffer, self._order, self._now = start, constant, buffer, order, now

    def compute_coefficient(
        self, tape: Tape, i: int, entries: Sequence["_TapeEntry"], k: Count, opaque_one: Float[Array, " m"]
    ) -> None:
        """Coefficient k, once those of the operands are known."""
        node = tape.nodes[i]
        if self._constant:
            return
        arrays = iter(tape.numbers[i])
        numbers = tuple(next(arrays) if literal is None else literal for literal in node.literals)
        if node.rule is series.polynomial_rule:
            self._now = series.total(jnp.where(k == j, c, 0.0) for j, c in enumerate(numbers) if j > 0)
            return
        now = node.rule(k, self, tuple(entries[j] for j in node.operands), numbers)
        # A division is done once; without it XLA repeats the whole sum in every place that needs it.
        self._now = now / opaque_one if node.rule in _CONVOLVED and not is_zero(now) else now

    def __getitem__(self, k: Order) -> ScalarLike:
        return self._start if is_zero(k) else self._now

    def inner_products(self, other: "_TapeEntry", k: Order, weight: Weight | None = None) -> ScalarLike:
        """The sum of weight(i) self[i] other[k - i] over 0 < i < k; self[i] is still zero from k on."""
        if self._constant or other._constant or self._buffer is None or other._buffer is None:
            return 0
        run = k > 0
        before = computed_once(
            run, lambda b: lax.dynamic_slice_in_dim(b, self._order - k + 1, self._order - 1, 0), other._buffer
        )

        def inner(x: Float[Array, "orders m"], y: Float[Array, "orders m"]) -> ScalarLike:
            terms = (x[self._order - i] * y[i - 1] for i in range(1, self._order))
            if weight is not None:
                terms = (term * weight(i) for i, term in enumerate(terms, start=1))
            return series.total(terms)

        return computed_once(run, inner, self._buffer, before)


def _constants(tape: Tape) -> list[bool]:
    """Which nodes have no coefficient but 0 that can differ from zero."""
    constant: list[bool] = []
    for i, node in enumerate(tape.nodes):
        if node.rule is series.unknown_rule:
            constant.append(tape.rates[i] is None)
        elif node.rule is series.polynomial_rule:
            constant.append(all(is_zero(number) for number in node.literals[1:]))
        else:
            # Cosine and sine are each other's operands: the later one counts as constant if the earlier one is.
            constant.append(all(constant[j] for j in node.operands if j < i))
    return constant


def _looking_back(tape: Tape, constant: list[bool]) -> set[int]:
    """The nodes of which lower coefficients are needed."""
    needed: set[int] = set()
    for i, node in enumerate(tape.nodes):
        if node.rule in _CONVOLVED:
            pair = [i if which is None else node.operands[which] for which in _CONVOLVED[node.rule]]
            if not any(constant[j] for j in pair):
                needed |= set(pair)
    return needed
