"""Figures of records against their predictions: over time, against the voltage, and what the residuals consist of."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import VELOCITY, Display, with_micro_sign
from ...inference import repeats
from ...metrics import CycleSplit, NoiseInTime, ResidualSplit, grid_positions, sample_autocovariance, split_residuals
from ...study import Estimate, FittedRecord, Record, Study
from ._style import BLUE, GREY, VERMILION, YELLOW, fixed_ticks, styled_figure


def record_figure(record: FittedRecord) -> Figure:
    """Measured against predicted over residuals; to the right, the liveliest moment enlarged."""
    scale, unit = _shown(record)
    measured, predicted, residuals = scale * record.measured, scale * record.predicted, _residual(record)
    quality = f"r² {record.r2:.7g}, error index {scale * record.error_index:.3g} {unit}"
    if np.isfinite(record.reduced_chi2):
        quality += f", chi-square per sample {record.reduced_chi2:.3g}"
    if not record.simulated:
        quality = "the simulation failed"
    role = "fitted" if record.role == "fit" else "not fitted"
    # The same places for every record, so that one can leaf through them; to fit the layout takes a third of the time.
    with styled_figure(7.4, 4.6, fitted=False) as figure:
        title = f"{record.name}\n{record.measures}, {role}, {quality}"
        text = figure.suptitle(title, x=0.01, ha="left", fontsize=10.0, wrap=True)
        top = 0.92 - text.get_window_extent().height / figure.bbox.height
        ratios = {"height_ratios": (2, 1), "width_ratios": (3, 2)}
        places = {"left": 0.13, "right": 0.985, "bottom": 0.1, "top": top, "wspace": 0.25, "hspace": 0.1}
        ((motion, near), (residual, near_residual)) = figure.subplots(2, 2, sharex="col", gridspec_kw=ratios | places)
        motion.plot(record.time, measured, color=GREY, linewidth=2.4, label="measured")
        motion.plot(record.time, predicted, color=VERMILION, linewidth=0.9, label="predicted")
        motion.set_ylabel(f"{record.display.quantity} ({unit})")
        motion.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0)
        residual.plot(record.time, residuals, color=BLUE, linewidth=0.6)
        residual.set_ylabel(f"residual ({unit})")
        residual.set_xlabel("time (s)")
        if record.motion is not None:
            _draw_loops(near, near_residual, record, record.motion)
        else:
            moment = liveliest_moment(record.time, record.measured)
            time = 1e3 * record.time[moment]
            near.plot(time, measured[moment], "o", color=GREY, fillstyle="none", markersize=4.5)
            near.plot(time, predicted[moment], ".-", color=VERMILION, linewidth=0.9, markersize=3)
            near.set_title("the shaded moment", loc="left")
            near_residual.plot(time, residuals[moment], ".-", color=BLUE, linewidth=0.7, markersize=3)
            near_residual.set_xlabel("time (ms)")
            for panel in (motion, residual):
                panel.axvspan(*record.time[moment][[0, -1]], color=YELLOW, alpha=0.45, linewidth=0, zorder=0)
        if np.isfinite(record.noise):
            residual.set_ylabel(f"residual ({unit}),\n± 2 noise in grey")
            band = 2.0 * scale * record.noise
            for panel in (residual, near_residual):
                panel.axhspan(-band, band, color="0.9", linewidth=0, zorder=-1)
        fixed_ticks(6, motion, near)
        fixed_ticks(4, residual, near_residual)
        figure.align_ylabels((motion, residual))
    return figure


def liveliest_moment(time: Float[np.ndarray, " n"], measured: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Samples around the fastest motion: a slip, or the onset of a step.

    Some 60 samples show the ring-down at the sampling rates that resolve it; much denser
    records are shown for the sixtieth part of their length.
    """
    width = max(60 * np.median(np.diff(time)), (time[-1] - time[0]) / 60)
    jump = time[np.argmax(np.abs(np.diff(measured) / np.diff(time)))]
    return (time >= jump - 0.15 * width) & (time <= jump + 0.85 * width)


def _draw_loops(force: Axes, residual: Axes, record: FittedRecord, motion: Float[np.ndarray, " n"]) -> None:
    """Friction force against the motion: what tells one law from another."""
    # Loops come in order; the samples of a friction curve need not, and are put into it.
    order = np.argsort(motion) if record.prescribed == VELOCITY else np.arange(motion.size)
    place = record.prescribed.scale * motion[order]
    force.plot(place, record.measured[order], color=GREY, linewidth=2.0)
    force.plot(place, record.predicted[order], color=VERMILION, linewidth=0.8)
    force.set_title(f"against the {record.prescribed.quantity}", loc="left")
    residual.plot(place, _residual(record)[order], color=BLUE, linewidth=0.5)
    residual.set_xlabel(f"{record.prescribed.quantity} ({with_micro_sign(record.prescribed.unit)})")


def _shown(record: FittedRecord) -> tuple[float, str]:
    """The factor from SI to the unit shown, and its name."""
    return record.display.scale, with_micro_sign(record.display.unit)


def _residual(record: FittedRecord) -> Float[np.ndarray, " n"]:
    return _shown(record)[0] * (record.measured - record.predicted)


def study_figure(study: Study) -> Figure:
    """Draw every record of a study as it was measured."""
    return _overview(study.title, study.records)


def estimate_figure(estimate: Estimate) -> Figure:
    """Draw every record of an estimate against its prediction."""
    return _overview(estimate.title, estimate.records)


def _overview(title: str, records: Sequence[Record | FittedRecord]) -> Figure:
    with styled_figure(7.4, 0.9 + 1.25 * len(records)) as figure:
        grid = figure.subplots(len(records), 2, squeeze=False)
        for record, (whole, near) in zip(records, grid, strict=True):
            _draw_row(whole, near, record)
        grid[-1, 0].set_xlabel("time (s)")
        if any(isinstance(record, FittedRecord) for record in records):
            figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.0, wrap=True)
        figure.align_ylabels(grid[:, 0])
    return figure


def _draw_row(whole: Axes, near: Axes, record: Record | FittedRecord) -> None:
    if isinstance(record, FittedRecord):
        display, prescribed = record.display, record.prescribed
    else:
        display, prescribed = record.measurement.display, record.measurement.prescribed_display
    _curves(whole, record.time, record, display, slice(None))
    left_out = ", not fitted" if record.role == "validate" else ""
    whole.set_title(f"{record.name}: {record.measures}{left_out}", loc="left")
    whole.set_ylabel(with_micro_sign(display.unit))
    if record.motion is not None:
        order = np.argsort(record.motion) if prescribed == VELOCITY else np.arange(record.motion.size)
        _curves(near, prescribed.scale * record.motion[order], record, display, order)
        near.set_xlabel(f"{prescribed.quantity} ({with_micro_sign(prescribed.unit)})")
        return
    moment = liveliest_moment(record.time, record.measured)
    _curves(near, 1e3 * record.time[moment], record, display, moment)
    near.set_xlabel("time (ms)", fontsize=7.5, labelpad=1.0)
    near.tick_params(labelsize=7.5)
    whole.axvspan(*record.time[moment][[0, -1]], color=YELLOW, alpha=0.5, linewidth=0, zorder=0)


def _curves(
    axes: Axes, x: Float[np.ndarray, " n"], record: Record | FittedRecord, display: Display, part: "slice | np.ndarray"
) -> None:
    measured = display.scale * record.measured[part]
    if isinstance(record, FittedRecord):
        axes.plot(x, measured, color=GREY, linewidth=2.2, label="measured")
        axes.plot(x, display.scale * record.predicted[part], color=VERMILION, linewidth=0.9, label="predicted")
    else:
        axes.plot(x, measured, color=BLUE, linewidth=1.0, label="measured")


def has_loops(record: FittedRecord) -> bool:
    """Whether a record shows the platform alone while its voltage runs over 20 levels or more: a step has two."""
    return record.voltage is not None and np.unique(np.round(record.voltage, 9)).size >= 20


def loop_figure(record: FittedRecord) -> Figure:
    """Displacement against voltage over the residual against voltage.

    **Arguments:** a `record` that `has_loops`.
    """
    if record.voltage is None:
        raise ValueError("Expected a record with a voltage, but it has none.")
    scale, unit = _shown(record)
    with styled_figure(5.6, 5.6) as figure:
        motion, left = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        motion.plot(record.voltage, scale * record.measured, color=GREY, linewidth=2.4, label="measured")
        motion.plot(record.voltage, scale * record.predicted, color=VERMILION, linewidth=0.8, label="predicted")
        motion.set_ylabel(f"{record.display.quantity} ({unit})")
        motion.legend(loc="best")
        left.plot(record.voltage, _residual(record), ".", color=BLUE, markersize=2.0, alpha=0.35, markeredgewidth=0)
        left.axhline(0.0, color="0.6", linewidth=0.7, zorder=0)
        left.set_ylabel(f"residual ({unit})")
        left.set_xlabel("voltage (V)")
        figures = f"rms {scale * record.rmse:.3g} {unit}, largest {scale * record.largest_error:.3g} {unit}"
        figure.suptitle(f"{record.name}\nagainst the voltage: {figures}", x=0.01, ha="left", fontsize=10.0, wrap=True)
        fixed_ticks(8, motion)
        fixed_ticks(4, left)
        figure.align_ylabels((motion, left))
    return figure


def residual_split_figure(record: FittedRecord) -> Figure:
    """Mean over the cycles at each phase beside all residuals; to the right, the autocorrelation of the rest.

    Of a record that does not repeat, all residuals over time.  All of them are those of the report.  Samples that stand
    out may lie beyond the axis, whose caption says by how much, and are left out of means and autocorrelation.
    """
    split = split_residuals(record.residual_without_outliers, record.time, record.frequency)
    with styled_figure(7.4, 2.9) as figure:
        residuals, correlation = figure.subplots(1, 2, width_ratios=(3, 2))
        residuals.set_ylabel(f"residual ({_shown(record)[1]})")
        if split.cycles is None:
            residuals.plot(record.time, _residual(record), color=BLUE, linewidth=0.6)
            residuals.set_xlabel("time (s)")
        else:
            _draw_cycle(residuals, record, split.cycles)
        others = record.display.scale * record.residual_without_outliers
        others = others[np.isfinite(others)]
        if record.outliers.size and others.size and np.ptp(others) > 0.0:
            margin = 0.1 * float(np.ptp(others))
            residuals.set_ylim(float(others.min()) - margin, float(others.max()) + margin)
        _draw_autocorrelation(correlation, record, split)
        figure.suptitle(f"{record.name}\n{_split_caption(record, split)}", x=0.01, ha="left", fontsize=10.0, wrap=True)
    return figure


def _draw_cycle(axes: Axes, record: FittedRecord, cycles: CycleSplit) -> None:
    there, place = cycles.sizes > 0, cycles.phases()
    scale, residual, seen = record.display.scale, _residual(record), cycles.group >= 0
    # Samples that stand out have no group, but a phase.
    phase = np.mod(record.time * (record.frequency or 0.0), 1.0)
    phase[seen] = place[cycles.group[seen]]
    axes.plot(phase, residual, ".", color="0.75", markersize=2, label="every cycle")
    within = float(np.sqrt(np.nanmean(cycles.rest**2)))
    band = 2.0 * scale * within / np.sqrt(cycles.sizes[there])
    ends = np.mean(residual[seen]) + np.multiply.outer([-1.0, 1.0], band)
    axes.fill_between(place[there], *ends, color=GREY, alpha=0.35, linewidth=0, label="± 2 by noise")
    axes.plot(place[there], scale * cycles.mean[there], color=BLUE, linewidth=1.0, label="mean of the cycles")
    axes.set_xlabel("phase of the cycle")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, markerscale=3, borderaxespad=0.2)


def _draw_autocorrelation(axes: Axes, record: FittedRecord, split: ResidualSplit) -> None:
    interval, places = float(np.median(np.diff(record.time))), grid_positions(record.time)
    if places is None:
        interval = max(interval, float(np.ptp(record.time)) / (4 * record.time.size))
        places = np.rint((record.time - record.time[0]) / interval).astype(int)
    longest = record.time.size // 2 if split.cycles is None else split.cycles.sizes.size // 2
    shown = max(min(60, longest), 2)  # lags
    covariance = sample_autocovariance(split.rest, places, shown)
    if covariance[0] <= 0.0:
        return
    apart = interval * np.arange(shown)
    band = 2.0 / np.sqrt(max(split.freedom, 1.0))
    axes.axhspan(-band, band, color="0.9", linewidth=0, zorder=-1)
    axes.vlines(1e3 * apart, 0.0, covariance / covariance[0], color=BLUE, linewidth=1.2)
    noise = split.noise
    if isinstance(noise, NoiseInTime):
        model, label = noise.covariance_at(apart), f"white and slow noise ({1e3 * noise.duration:.2g} ms)"
    else:
        model, label = noise.autocovariance(shown), f"autoregression of order {noise.order}"
    style = ".-"
    if not noise.order:
        style, label = ".", "white noise"
    axes.plot(1e3 * apart, model / model[0], style, color=VERMILION, linewidth=0.9, markersize=2.5, label=label)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set_xlabel("interval (ms)")
    axes.set_ylabel("autocorrelation " + ("of the residuals" if split.cycles is None else "of the rest"))
    axes.legend(loc="upper right")


def _split_caption(record: FittedRecord, split: ResidualSplit) -> str:
    show = lambda number: with_micro_sign(record.display.text(number))
    without = ""
    if record.outliers.size:
        largest = float(np.max(np.abs(record.residual[record.outliers])))
        without = f"; samples that stand out: {record.outliers.size}, by up to {show(largest)}"
    if split.cycles is None or record.lack_of_fit is None:
        return f"does not repeat: misfit and slow noise cannot be told apart{without}"
    found = record.lack_of_fit
    what = "misfit" if repeats(record) else "as chance has it, no misfit"
    return f"repeats every cycle: {show(found.misfit)} ({what}); does not: {show(found.noise)} (noise){without}"
