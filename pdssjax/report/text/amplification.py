"""What an error of the stack does to the parameters identified after it, as plain text."""

from ...core import rounded
from ...study import Amplification
from ._layout import aligned_table, heading


def format_amplification(amplification: Amplification) -> str:
    """A table of relative changes, and its largest entry in words."""
    rows = [
        [path, *(rounded(float(value), 2) for value in row)]
        for path, row in zip(amplification.later, amplification.matrix, strict=True)
    ]
    moved, mover, factor = amplification.strongest()
    sentence = f"    1 % in {mover} moves {moved} by {float(f'{abs(factor):.2g}'):g} %.\n"
    head = ["", *amplification.earlier]
    title = heading("Amplification: per cent in the row for 1 % in the column, where that is held")
    return title + aligned_table("<" + ">" * len(amplification.earlier), [head, *rows]) + sentence
