"""Writes an estimate (`estimate.json`, the report, plots and predictions), and several side by side."""

from collections.abc import Sequence
from pathlib import Path

from ..report.text import format_comparison, format_report
from ..study import Estimate
from .draws_results import write_draws
from .estimate_json import estimate_text
from .prediction_results import file_stems, write_records
from .results_folder import staging_folder


def write_estimate(estimate: Estimate, folder: Path) -> None:
    """Put `estimate.json`, `report.txt`, plots and predictions into `folder`, in place of older ones."""
    from ..report.figures import (
        amplification_figure,
        correlation_figure,
        draws_figure,
        error_figure,
        multistart_figure,
        profile_figure,
        residual_split_figure,
        save_figure,
    )

    with staging_folder(folder) as staging:
        _write_essentials(estimate, staging)
        write_records(estimate.records, staging)
        if len(estimate.names) > 1:
            save_figure(correlation_figure(estimate), staging / "plots" / "correlations.png")
        save_figure(error_figure(estimate), staging / "plots" / "standard_errors.png")
        if estimate.draws is not None:
            units = {path: parameter.unit for path, parameter in estimate.parameters.items()}
            write_draws(estimate.draws, units, staging)
            save_figure(draws_figure(estimate), staging / "plots" / "draws.png")
        if estimate.multistart is not None:
            save_figure(multistart_figure(estimate.multistart), staging / "plots" / "multistart.png")
        if estimate.profiles:
            save_figure(profile_figure(estimate.profiles, estimate.parameters), staging / "plots" / "profiles.png")
        if estimate.amplification is not None:
            save_figure(amplification_figure(estimate.amplification), staging / "plots" / "amplification.png")
        (staging / "plots" / "residuals").mkdir()
        for stem, record in zip(file_stems(estimate.records), estimate.records, strict=True):
            if record.role == "fit" and record.simulated:
                save_figure(residual_split_figure(record), staging / "plots" / "residuals" / f"{stem}.png")


def write_essentials(estimate: Estimate, folder: Path) -> None:
    """Put only `estimate.json` and `report.txt` into `folder`, in place of older results."""
    with staging_folder(folder) as staging:
        _write_essentials(estimate, staging)


def _write_essentials(estimate: Estimate, staging: Path) -> None:
    (staging / "estimate.json").write_text(estimate_text(estimate), encoding="utf-8", errors="backslashreplace")
    (staging / "report.txt").write_text(format_report(estimate), encoding="utf-8", errors="backslashreplace")


def write_comparison(estimates: Sequence[Estimate], folder: Path) -> None:
    """Put `comparison.txt` and `comparison.png` into `folder`, in place of older ones.

    **Arguments:** the joint fit first, then those in two steps.
    """
    from ..report.figures import comparison_figure, save_figure

    with staging_folder(folder) as staging:
        (staging / "comparison.txt").write_text(
            format_comparison(*estimates), encoding="utf-8", errors="backslashreplace"
        )
        save_figure(comparison_figure(estimates), staging / "comparison.png")
