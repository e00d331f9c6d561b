"""What an error of the stack does to the parameters identified after it, as plain text."""

import numpy as np

from ...core import rounded
from ...study import Amplification
from ._layout import aligned_table, heading


def format_amplification(amplification: Amplification) -> str:
    """A table of relative changes, and its largest entry in words."""
    amplification = amplification.visible()
    rows = [
        [path, *(rounded(float(value), 2) for value in row)]
        for path, row in zip(amplification.later, amplification.matrix, strict=True)
    ]
    moved, mover, factor = amplification.strongest()
    sentence = f"    1 % in {mover} moves {moved} by {_digits(abs(factor))} %.\n"
    head = ["", *amplification.earlier]
    title = heading("Amplification: per cent in the row for 1 % in the column, where that is held")
    return title + aligned_table("<" + ">" * len(amplification.earlier), [head, *rows]) + sentence


def format_effects(amplification: Amplification) -> str:
    """Of each parameter identified first, in words, the two that an error of it moves most where it is held."""
    amplification = amplification.visible()
    lines = ["    Where the stack is held, its errors are carried on:\n"]
    for j, mover in enumerate(amplification.earlier):
        column = np.abs(amplification.matrix[:, j])
        moved = [f"{amplification.later[i]} by {_digits(float(column[i]))} %" for i in np.argsort(-column)[:2]]
        lines.append(f"    1 % in {mover} moves {' and '.join(moved)}.\n")
    return "".join(lines)


def _digits(percent: float) -> str:
    """Two of them, without an exponent."""
    return f"{float(f'{percent:.2g}'):g}"
