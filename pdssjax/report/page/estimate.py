"""The page of one identification: what was measured, what was fitted, how sure it is, and how to make it again."""

import contextlib
import math
import re
import textwrap
from collections.abc import Iterator

import numpy as np

from ...core import InputError, percent, rounded, strongest_pairs, with_micro_sign
from ...integration import TAYLOR
from ...study import OWN_MINIMISER, Estimate, FittedParameter, FittedRecord, Provenance, find_entry, split_path
from .. import figures
from ..text._layout import counted
from ..text.estimate import (
    format_amplification,
    format_draws,
    format_multistart,
    format_profiles,
    interval_way,
    parameter_cells,
    ranked_products,
    remedy_gains,
)
from .document import Illustration, Page, Section, Share, Table


def estimate_page(estimate: Estimate) -> Page:
    """Everything that the plain report says of an `estimate`, with its figures, in an order for one who was not there.

    Records without samples, as a fit that was broken off leaves them, are listed and not drawn.
    """
    notes = [Section("Findings", points=estimate.notes)] if estimate.notes else []
    sections = [
        Section("Result", list(_result(estimate))),
        *notes,
        _measured(estimate),
        _fitted(estimate),
        _parameters(estimate),
        _correlations(estimate),
        *_records(estimate),
        *_more(estimate),
        _origin(estimate.provenance, estimate),
    ]
    return Page(estimate.title, sections, subtitle=f"Identification of a piezoelectric actuator: {_verdict(estimate)}")


def _verdict(estimate: Estimate) -> str:
    return f"the {estimate.method} fit {estimate.verdict}"


def _result(estimate: Estimate) -> Iterator[str]:
    """The outcome in sentences."""
    statistics = estimate.statistics
    fitted = [record for record in estimate.records if record.role == "fit"]
    yield f"{_verdict(estimate).capitalize()}: {estimate.message.rstrip('.')}."
    if estimate.converged and not estimate.explained:
        yield (
            f"{estimate.why_unexplained.capitalize()}. The friction law or the piezo model lacks something, or the "
            "optimum is a wrong one: see the findings."
        )
    apart = f", and {statistics.measured_apart} measured apart" if statistics.measured_apart else ""
    judged = "The noise was estimated from the residuals of the fit, so chi-square does not judge the model."
    if not statistics.noise_estimated:
        judged = f"The reduced chi-square is {statistics.reduced_chi2:.4g}; it is 1 where the model explains the "
        judged += "records to within their noise."
    yield (
        f"{counted(len(estimate.names), 'parameter')} and "
        f"{counted(statistics.free - len(estimate.names), 'sensor zero')} were fitted to "
        f"{statistics.samples} samples of {counted(len(fitted), 'record')}{apart}. {judged}"
    )
    validation = [record for record in estimate.records if record.role != "fit"]
    if validation:
        each = "; ".join(f"{record.name}: {_quality(record)}" for record in validation)
        yield f"Predicted without having been fitted ({counted(len(validation), 'validation record')}): {each}."
    known = [p for p in estimate.parameters.values() if p.free and p.value and math.isfinite(p.standard_error)]
    if len(known) > 1:
        ranked = sorted(known, key=lambda p: abs(p.standard_error / p.value))
        best, worst = (f"{p.path} ({percent(p.standard_error, p.value)})" for p in (ranked[0], ranked[-1]))
        yield f"Best known is {best}, least known {worst}, in standard errors."
    unknown = [p.path for p in estimate.parameters.values() if p.free and not p.identifiable]
    if unknown:
        yield f"The records do not determine {', '.join(unknown)}."


def _quality(record: FittedRecord) -> str:
    """How well a record is predicted, in a few words."""
    if not record.simulated:
        return "the simulation failed"
    scale, unit = record.display.scale, with_micro_sign(record.display.unit)
    rms = f"residual {scale * record.rmse:.3g} {unit} rms"
    if math.isfinite(record.reduced_chi2):
        return f"{rms} at a noise of {scale * record.noise:.3g} {unit}, chi-square per sample {record.reduced_chi2:.3g}"
    return rms


def _measured(estimate: Estimate) -> Section:
    rows = []
    for record in estimate.records:
        scale, unit = record.display.scale, with_micro_sign(record.display.unit)
        noise = "found" if record.noise_estimated else "given"
        has_samples = record.time.size > 1
        of = "".join(f" of {word}" if key == "of" else f", {key} {word}" for key, word in record.words.items())
        rows.append(
            [
                record.name,
                f"{record.measures}{of}",
                record.excitation,
                "fitted" if record.role == "fit" else "validation",
                str(record.samples),
                f"{record.time[0]:.4g} to {record.time[-1]:.4g}" if has_samples else "",
                f"{1e3 * float(np.median(np.diff(record.time))):.4g}" if has_samples else "",
                f"{scale * record.noise:.3g} {unit}, {noise}" if math.isfinite(record.noise) else "unknown",
                record.file,
            ]
        )
    head = ["record", "measured", "excitation", "role", "samples", "from, to (s)", "interval (ms)", "noise", "file"]
    # An older folder does not say what moved the rig, nor which files were read.
    there = [at for at in range(len(head)) if any(row[at] for row in rows)]
    only = lambda cells: [cells[at] for at in there]
    caption = "Validation records are predicted and compared, not fitted. Times count from the start of the drive. "
    caption += "The noise was given, or found in the residuals."
    return Section(
        "What was measured", tables=[Table(only(head), list(map(only, rows)), "".join(only("<<<<>>><<")), caption)]
    )


def _fitted(estimate: Estimate) -> Section:
    """The models and the way of fitting."""
    chosen, rows = estimate.actuator, []
    for family in ("piezo", "friction"):
        if family in chosen:
            name, summary = str(chosen[family]), ""
            with contextlib.suppress(InputError):  # this version may not have it
                summary = find_entry(f"{family}/{name.partition(':')[0]}").summary
            # Without the numbers of equations.
            rows.append([f"{family} model", name, re.sub(r" \([\d., -]+\)", "", summary)])
    if "anisotropic" in str(chosen.get("friction")):
        rows.append(["state of the law", str(chosen.get("friction_state", "")), "What stays the same at a reversal."])
    if "feedback" in chosen:
        does = "acts back on the platform" if chosen["feedback"] else "does not act back on the platform"
        rows.append(["friction feedback", "yes" if chosen["feedback"] else "no", f"The contact force {does}."])
    if chosen.get("rests_under_load"):
        rows.append(["rest", "under load", "Load and tilt acted before the drive started."])
    ways = {
        "joint": "All parameters at once, from all fitted records.",
        "sequential": "The piezo first, then the friction with the piezo held; errors of the first step are included.",
        "peaks": "The piezo from the peaks of its step responses, then the friction with the piezo held.",
    }
    rows.append(["method", estimate.method, ways[estimate.method]])
    robust = "A robust loss, under which glitches pull little."
    squares = "Sum of squared residuals, each divided by its noise."
    rows.append(["loss", estimate.loss, squares if estimate.loss == "squares" else robust])
    if estimate.solver != TAYLOR:
        rows.append(["integrator", estimate.solver, "In place of the Taylor series."])
    if estimate.minimiser != OWN_MINIMISER:
        rows.append(["minimiser", estimate.minimiser, "In place of the package's Levenberg-Marquardt."])
    if estimate.check is not None:
        rows.append(["check by a second integrator", estimate.check.solver, estimate.check.sentence])
    return Section("What was fitted", tables=[Table(["what", "choice", "meaning"], rows, "<<<")])


def _parameters(estimate: Estimate) -> Section:
    meanings, rows = _meanings(estimate), []
    for path, parameter in estimate.parameters.items():
        cells = parameter_cells(parameter)
        relative = abs(parameter.standard_error / parameter.value) if parameter.value else math.nan
        # Bars are empty at 0.01 % and full four decades above.
        length = math.log10(relative / 1e-4) / 4.0 if relative > 0.0 else math.nan
        known = parameter.free and math.isfinite(parameter.standard_error)
        rows.append(
            [
                path,
                cells.value,
                cells.error if known else "",
                with_micro_sign(cells.unit) or "1",
                Share(cells.share, length) if known else "",
                cells.interval(" to "),
                ". ".join(filter(None, [parameter.remark.capitalize(), meanings.get(path, "")])),
            ]
        )
    head = ["parameter", "value", "standard error", "unit", "relative error", "95 % interval", "what it is"]
    caption = "Bars are logarithmic, from 0.01 % (empty) to 100 % (full)."
    tables, drawings = [Table(head, rows, "<>><><<", caption)], []
    text = [estimate.error_advice.reason] if estimate.error_advice is not None else []
    models = list(next((p.errors for p in estimate.parameters.values() if p.errors), {}))
    if models:
        way = interval_way(estimate)
        basis = f"by the {models[0]} error model" + (f", the interval by {way}" if way else "")
        text.append(
            f"Standard error, relative error and interval are {basis}. Coloured errors hold whatever the colour of the "
            "noise; errors with misfit also cover what the model's own error may do to a parameter."
        )
    free = [parameter for parameter in estimate.parameters.values() if parameter.free]
    if any(p.value and math.isfinite(p.standard_error) for p in free):
        tables.append(_further_errors(estimate, free, models))
        caption = "Standard errors in per cent of the values, on a logarithmic axis."
        description = f"{caption} The numbers are in the table above."
        drawings.append(Illustration(figures.error_figure(estimate), caption, description))
    return Section("Parameters", text, tables=tables, figures=drawings)


def _further_errors(estimate: Estimate, free: list[FittedParameter], models: list[str]) -> Table:
    """Relative errors by every error model, and where the fit started."""
    naive = estimate.method != "joint"
    head = ["parameter", *(model.replace("-", " ") for model in models), *["naive"] * naive, "start", "unit"]
    rows = []
    for parameter in free:
        cells = parameter_cells(parameter)
        errors = [parameter.errors[model].standard_error if parameter.errors else math.nan for model in models]
        if naive:
            errors.append(math.nan if parameter.naive_standard_error is None else parameter.naive_standard_error)
        shares = [percent(error, parameter.value) for error in errors]
        rows.append([parameter.path, *shares, cells.start, with_micro_sign(cells.unit) or "1"])
    caption = "Standard errors by every error model, in per cent of the value, and where the fit started."
    if naive:
        caption += " Naive errors take the result of the piezo's own fit for exact."
    return Table(head, rows, "<" + ">" * (len(head) - 2) + "<", caption)


def _meanings(estimate: Estimate) -> dict[str, str]:
    """The meaning of each parameter by its path, from the models of this version; unknown ones are left out."""
    drives = {record.excitation.partition(",")[0] for record in estimate.records} - {"prescribed motion"}
    homes = {"drive": [f"drive/{name}" for name in drives]}
    for family in ("piezo", "friction"):
        homes[family] = [f"{family}/{estimate.actuator[family]}"] if family in estimate.actuator else []
    found: dict[str, str] = {}
    for path in estimate.parameters:
        base, condition = split_path(path)
        family, _, name = base.partition(".")
        for home in homes.get(family, [family]):
            with contextlib.suppress(InputError, KeyError):
                text = find_entry(home).parameters[name][1]
                under = f" (under {condition})" if condition else ""
                found[path] = f"{text.partition(' [')[0].rstrip('.')}{text.partition(']')[2].rstrip('.')}{under}"
    return found


WORTH_KNOWING = 0.7
"""Correlations smaller than this in size are in the figure alone."""


def _correlations(estimate: Estimate) -> Section:
    """Which parameters are known together only, and what would help."""
    tables, drawings, text = [], [], []
    pairs = strongest_pairs(estimate.names, estimate.correlation, WORTH_KNOWING)
    if pairs:
        text.append(
            f"Of {counted(len(pairs), 'pair')} with a correlation of {WORTH_KNOWING:g} or more in size, an error of "
            "one parameter goes with an error of the other: the records determine a combination better than either."
        )
        rows = [[path, other, f"{value:+.3f}"] for path, other, value in pairs[:6]]
        tables.append(Table(["parameter", "with", "correlation"], rows, "<<>", "The strongest correlations."))
    else:
        text.append(f"No two parameters are correlated by {WORTH_KNOWING:g} or more in size.")
    diagnosis = estimate.diagnosis
    if diagnosis is not None and len(diagnosis.combinations) > 1:
        least, best = ranked_products(diagnosis, " · ")
        rows = [*(["least", *row] for row in least), *(["best", *row] for row in best)]
        caption = "Products of powers that the records determine least and best; exponents are rounded."
        tables.append(Table(["determined", "product", "standard error"], rows, "<<>", caption))
        if (remedy := diagnosis.remedy) is not None:
            text.append(
                f"If {remedy.path} were known from elsewhere, standard errors would fall: {remedy_gains(remedy)}."
            )
    if len(estimate.names) > 1:
        caption = "Correlations of the estimates."
        description = f"{caption} The strongest are in the table above."
        drawings.append(Illustration(figures.correlation_figure(estimate), caption, description))
    return Section("Correlations", text, tables=tables, figures=drawings)


def _records(estimate: Estimate) -> list[Section]:
    """Every record against its prediction, and what the residuals consist of."""
    head = ["record", "role", "r²", "rms", "largest", "noise", "unit", "chi-square per sample", "zero"]
    rows = []
    for record in estimate.records:
        scale, places = record.display.scale, record.display.decimals(record.rmse, record.noise)
        lengths = record.rmse, record.largest_error, record.noise
        rows.append(
            [
                record.name,
                "fitted" if record.role == "fit" else "validation",
                rounded(record.r2, 7),
                *(rounded(number * scale, places) for number in lengths),
                with_micro_sign(record.display.unit),
                rounded(record.reduced_chi2, 3) if record.simulated else "simulation failed",
                rounded(record.offset * scale, places),
            ]
        )
    caption = "Residuals are measured less predicted: their root mean square and the largest. Chi-square per sample is "
    caption += "against the noise given, and 1 where the record is explained; zero is that of the sensor."
    table = Table(head, rows, "<<>>>><>>", caption)
    drawn = [record for record in estimate.records if record.time.size > 1]
    text = "Measured (grey) and predicted (orange), the residual (blue) below, two standard deviations of the noise as "
    text += "a grey band. To the right the fastest moment, which is shaded in the record, or force against motion."
    if len(drawn) < len(estimate.records):
        text = "Some records have no samples in this folder, as where a fit was broken off, and are not drawn."
    drawings, loops, split = list[Illustration](), list[Illustration](), list[Illustration]()
    for record in drawn:
        by = f", {record.excitation}" if record.excitation else ""
        of = "contact" if record.motion is not None else record.measures
        caption = f'"{record.name}": {record.display.quantity} of the {of}{by}.'
        description = f"Measured and predicted, {caption} {_quality(record)}."
        drawings.append(Illustration(figures.record_figure(record), caption, description))
        if record.simulated and figures.has_loops(record):
            caption = f'Displacement against voltage of "{record.name}".'
            loops.append(Illustration(figures.loop_figure(record), caption))
        if record.simulated and record.role == "fit":
            caption = f'Residuals of "{record.name}": what repeats every cycle is misfit, the rest is noise.'
            split.append(Illustration(figures.residual_split_figure(record), caption))
    sections = [Section("Measured and predicted", [text], tables=[table], figures=[*drawings, *loops])]
    return sections + [Section("Residuals: misfit and noise", figures=split, folded=True)] * bool(split)


def _more(estimate: Estimate) -> Iterator[Section]:
    """Sections that only some estimates have: profiles, draws, starts, amplification."""
    if estimate.profiles:
        caption = "Chi-square minimised over all other parameters, beside the parabola of the linear model."
        figure = Illustration(figures.profile_figure(estimate.profiles, estimate.parameters), caption)
        yield _report_part("Profiles of chi-square", format_profiles(estimate.profiles, estimate.parameters), figure)
    if estimate.draws is not None:
        drawings = []
        if estimate.draws.values.size:
            caption = "Draws beside the normal distribution of the linear model, and pairs beside its 95 % ellipse."
            drawings = [Illustration(figures.draws_figure(estimate), caption)]
        text = format_draws(estimate.draws, estimate.parameters)
        yield _report_part(estimate.draws.kind.capitalize(), text, *drawings)
    if estimate.multistart is not None:
        caption = "Chi-square where each start ended, sorted, and the parameters at the optima."
        figure = Illustration(figures.multistart_figure(estimate.multistart), caption)
        yield _report_part("Other starts", format_multistart(estimate.multistart), figure)
    if estimate.method != "joint" and estimate.amplification is not None:
        caption = "What an error of 1 % of a parameter that is held does to those fitted after it."
        figure = Illustration(figures.amplification_figure(estimate.amplification), caption)
        yield _report_part("Amplification of errors", format_amplification(estimate.amplification), figure)


def _report_part(heading: str, text: str, *drawings: Illustration) -> Section:
    """A part of the plain report without its heading."""
    lines = textwrap.dedent(text.partition("\n")[2]).strip("\n").splitlines()
    return Section(heading, lines=lines, figures=drawings)


def _origin(made: Provenance, estimate: Estimate) -> Section:
    """How to make it again."""
    text, lines = [f"The fit took {estimate.seconds:.3g} s."], list[str]()
    if made.command:
        lines = [made.command]
    elif made.study:
        usual = {"method": "joint", "loss": "squares", "effort": "usual"}
        settings = {key: getattr(estimate, key) for key in usual}
        given = "".join(f", {key}={value!r}" for key, value in settings.items() if value != usual[key])
        lines = [
            "import pdssjax",
            "",
            "pdssjax.prepare_jax()",
            f"study = pdssjax.load_study({made.study!r})",
            f"estimate = pdssjax.identify(study{given})",
            'estimate.report("report.html")',
        ]
    else:
        text.append("The results do not say with which command and which study they were made.")
    rows = [[package, version] for package, version in made.versions.items()]
    tables = [Table(["package", "version"], rows, "<<", "Versions that computed it.")] if rows else []
    return Section("How to repeat it", text, lines=lines, tables=tables)
