"""Writes ways of identification side by side: a table and a figure."""

from collections.abc import Sequence
from pathlib import Path

from ..report.text import format_comparison
from ..study import Estimate
from .results_folder import staging_folder


def write_comparison(estimates: Sequence[Estimate], folder: Path) -> None:
    """Put `comparison.txt` and `comparison.png` into `folder`, in place of older ones.

    **Arguments:** the joint fit first, then those in two steps.
    """
    from ..report.figures import comparison_figure

    with staging_folder(folder) as staging:
        (staging / "comparison.txt").write_text(
            format_comparison(*estimates), encoding="utf-8", errors="backslashreplace"
        )
        comparison_figure(estimates).savefig(staging / "comparison.png")
