"""An estimate as plain text.

The order and the vocabulary follow lmfit's `fit_report`, which people in the field know.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...core import decimals_for, display_unit, percent, rounded, strongest_pairs
from ...integration import TAYLOR
from ...study import (
    OWN_MINIMISER,
    Amplification,
    Combination,
    Diagnosis,
    Draws,
    Estimate,
    FittedParameter,
    Multistart,
    ParameterDraws,
    Profile,
    Remedy,
)
from ._layout import aligned_table, heading, note
from .records import format_records

WORTH_KNOWING = 0.3
"""Smallest correlation in size that the report lists."""


def format_report(estimate: Estimate) -> str:
    """The whole report, in ASCII apart from what the study's own title and names contain."""
    pairs = strongest_pairs(estimate.names, estimate.correlation, WORTH_KNOWING)
    rows = [[f"C({path}, {other})", f"{value:+.3f}"] for path, other, value in pairs]
    correlations = aligned_table("<>", rows) if rows else "    none\n"
    parts = [
        heading(estimate.title) + _outcome(estimate),
        heading("Parameters") + _parameters(estimate),
        format_records(estimate.records),
        heading(f"Correlations of size {WORTH_KNOWING:g} or more") + correlations,
    ]
    if estimate.diagnosis is not None and len(estimate.diagnosis.combinations) > 1:
        parts.append(format_diagnosis(estimate.diagnosis))
    if estimate.method != "joint" and estimate.amplification is not None:
        parts.append(format_amplification(estimate.amplification))
    if estimate.multistart is not None:
        parts.append(format_multistart(estimate.multistart))
    if estimate.draws is not None:
        parts.append(format_draws(estimate.draws, estimate.parameters))
    if estimate.profiles:
        parts.append(format_profiles(estimate.profiles, estimate.parameters))
    if estimate.notes:
        parts.append(heading("Notes") + "".join(map(note, estimate.notes)))
    return "\n".join(parts)


def _outcome(estimate: Estimate) -> str:
    """How the fit ended, and its statistics."""
    verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
    loss = "" if estimate.loss == "squares" else f" with {estimate.loss.capitalize()}'s loss"
    outcome = f"    {estimate.method} fit{loss} {verdict}: {estimate.message}\n"
    if estimate.converged and not estimate.explained:
        outcome += f"    {estimate.why_unexplained.capitalize()}.\n"
        outcome += "    The law lacks something, or the optimum is wrong: see the notes.\n"
    statistics = estimate.statistics
    fitted = [record for record in estimate.records if record.role == "fit"]
    apart = f", and {statistics.measured_apart} measured apart" if statistics.measured_apart else ""
    silent = sum(record.noise_estimated for record in fitted)
    mixed = f" (noise estimated from the residuals in {silent} of {len(fitted)} records)" if silent else ""
    reduced_chi2 = f"{statistics.reduced_chi2:.6g}{mixed}"
    if statistics.noise_estimated:  # then it is 1 by construction
        reduced_chi2 = "- (noise estimated from these residuals)"
    lines = [
        ("records fitted", f"{len(fitted)} of {len(estimate.records)}"),
        ("samples fitted", f"{statistics.samples}{apart}"),
        ("free parameters", f"{len(estimate.names)}, with offsets {statistics.free}"),
        ("iterations", f"{statistics.iterations} ({statistics.evaluations} evaluations, {estimate.seconds:.1f} s)"),
        ("chi-square", f"{statistics.chi2:.6g}"),
        ("reduced chi-square", reduced_chi2),
        ("Akaike criterion", f"{statistics.aic:.6g}"),
        ("Bayesian criterion", f"{statistics.bic:.6g}"),
    ]
    if estimate.solver != TAYLOR:
        lines.append(("solver", estimate.solver))
    if estimate.minimiser != OWN_MINIMISER:
        lines.append(("minimiser", estimate.minimiser))
    if estimate.check is not None:
        lines.append(("check", estimate.check.sentence))
    return outcome + "".join(f"    {name:<19}= {text}\n" for name, text in lines)


def _parameters(estimate: Estimate) -> str:
    """The table of parameters, what the errors by each model cover, and which to believe."""
    models = list(next((p.errors for p in estimate.parameters.values() if p.errors), {}))
    names = [model.replace("-", " ") for model in models] or [""]
    has_naive = estimate.method != "joint"
    head = ["", "unit", "value", "+/-", *names, *["naive"] * has_naive, "95 % interval", "start", ""]
    rows = [_parameter(parameter, models, has_naive) for parameter in estimate.parameters.values()]
    text = aligned_table("<<>>" + ">" * (len(names) + has_naive) + "<<<", [head, *rows])
    if has_naive:
        text += "    naive: error with the piezo's own fit taken as exact; +/-: with its errors included.\n"
    if estimate.error_advice is None:
        return text
    from ...inference import all_error_models

    for model in all_error_models():
        if model.name in models:
            text += note(f"{model.name.replace('-', ' ')}: covers {model.covers}.")
    way = interval_way(estimate)
    which = f"+/-: {models[0]}; interval: by {way}" if way else f"+/- and interval: {models[0]}"
    return text + note(f"{which}. {estimate.error_advice.reason}")


def interval_way(estimate: Estimate) -> str:
    """The way in which intervals were found, in words; "" where they are those of the standard errors."""
    if estimate.draws is not None:
        return estimate.draws.kind
    return "profile likelihood" if any(parameter.verdicts for parameter in estimate.parameters.values()) else ""


class ParameterCells(NamedTuple):
    """The numbers of a parameter as texts of a table, in the unit shown, with the digits that its error deserves."""

    unit: str
    value: str
    error: str
    """The standard error; "-" where it is not known, as the next ones."""
    share: str
    """The standard error in per cent of the value."""
    low: str
    high: str
    """Ends of the 95 % interval."""
    start: str
    """Where the fit started."""

    def interval(self, between: str) -> str:
        """Both ends of the interval with a word or sign `between`; "" where neither is known."""
        return "" if self.low == self.high == "-" else f"{self.low}{between}{self.high}"


def parameter_cells(parameter: FittedParameter) -> ParameterCells:
    """The numbers of a `parameter` as texts."""
    unit, factor = display_unit(parameter.unit)
    places = decimals_for(parameter.standard_error * factor)
    low, high = (rounded(end * factor, places) for end in parameter.interval)
    return ParameterCells(
        unit,
        rounded(parameter.value * factor, places),
        rounded(parameter.standard_error * factor, places),
        percent(parameter.standard_error, parameter.value),
        low,
        high,
        "-" if parameter.start is None else f"{parameter.start * factor:.4g}",
    )


def _parameter(parameter: FittedParameter, models: Sequence[str], has_naive: bool) -> list[str]:
    cells, naive = parameter_cells(parameter), parameter.naive_standard_error
    errors = [parameter.errors[model].standard_error for model in models if parameter.errors]
    shares = [percent(error, parameter.value) for error in errors or [parameter.standard_error] * max(len(models), 1)]
    return [
        parameter.path,
        cells.unit,
        cells.value,
        cells.error,
        *shares,
        *["-" if naive is None else percent(naive, parameter.value)] * has_naive,
        cells.interval(" .. ") or "-",
        cells.start,
        parameter.remark,
    ]


def format_diagnosis(diagnosis: Diagnosis) -> str:
    """The worst and the best determined products of powers of parameters, with their relative standard errors."""
    least, best = ranked_products(diagnosis)
    text = heading("Products that the data determine least") + aligned_table("<>", least)
    if (remedy := diagnosis.remedy) is not None:
        text += note(f"If {remedy.path} were known from elsewhere, errors would fall: {remedy_gains(remedy)}.")
    if best:
        text += "\n" + heading("Products that the data determine best") + aligned_table("<>", best)
        text += note("Exponents are rounded and small ones left out; estimate.json has the exact ones.")
    return text


def ranked_products(diagnosis: Diagnosis, times: str = "  ") -> tuple[list[list[str]], list[list[str]]]:
    """Rows of the three products that are determined least, and of the three best: each with its relative error."""
    ranked = sorted(diagnosis.combinations, key=lambda found: -found.relative_error)
    row = lambda each: [_product(each, times), f"{100 * each.relative_error:.2g} %"]
    return list(map(row, ranked[:3])), list(map(row, ranked[3:][-3:][::-1]))


def remedy_gains(remedy: Remedy) -> str:
    """What errors would fall to if the one parameter whose separate measurement helps most were known."""
    return ", ".join(f"{path} from {100 * a:.2g} to {100 * b:.2g} %" for path, (a, b) in remedy.errors.items())


def _product(combination: Combination, times: str) -> str:
    """Text of a combination, such as "friction.sigma1_b  friction.f_ss_b^-0.42"."""
    parts = [path if abs(e - 1.0) < 0.005 else f"{path}^{e:.2f}" for path, e in combination.exponents.items()]
    return times.join([*parts[:4], *["..."] * (len(parts) > 4)])


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
    """Name, for each parameter identified first, the two others that its error moves most."""
    amplification = amplification.visible()
    lines = ["    What errors of the held stack do:\n"]
    for j, mover in enumerate(amplification.earlier):
        column = np.abs(amplification.matrix[:, j])
        moved = [f"{amplification.later[i]} by {_digits(float(column[i]))} %" for i in np.argsort(-column)[:2]]
        lines.append(f"    1 % in {mover} moves {' and '.join(moved)}.\n")
    return "".join(lines)


def _digits(percent: float) -> str:
    """Text of a percentage with two significant digits, without an exponent."""
    return f"{float(f'{percent:.2g}'):g}"


def format_multistart(multistart: Multistart) -> str:
    """List how many starts led to each optimum, and its chi-square above the lowest."""
    count, least = multistart.chi2.size, float(np.min(multistart.chi2))
    failed = int(np.sum(~multistart.converged))
    optima = "1 optimum" if multistart.distinct == 1 else f"{multistart.distinct} distinct optima"
    said = f"    {count} starts, {count - failed} of them converged, to {optima}\n"
    rows = [["optimum", "starts", "chi-square above the lowest"]]
    for number in range(multistart.distinct):
        at = multistart.optimum == number
        rows.append([str(number + 1), str(int(np.sum(at))), f"{float(np.min(multistart.chi2[at])) - least:.4g}"])
    return heading("Starts") + said + aligned_table(">>>", rows)


def format_draws(draws: Draws, parameters: Mapping[str, FittedParameter]) -> str:
    """List mean, deviation and intervals of the draws of each parameter, and whether the chains agree."""
    chains, each, _ = draws.values.shape
    drawn = f"{chains} chains of {each} draws" if draws.kind == "posterior" else f"{each} replicates"
    lines = f"    {drawn}, seed {draws.seed}; {draws.failed} {draws.failure}\n    drawn: {draws.description}\n"
    head = ["", "unit", "mean", "+/-", "", "95 % of the draws"]
    head += ["R-hat", "effective"] if draws.kind == "posterior" else ["mirrored", "linear +/-"]
    rows = [head, *(_draws_row(draw, parameters[draw.path], draws.kind == "posterior") for draw in draws.parameters)]
    return heading(draws.kind.capitalize()) + lines + aligned_table("<<>>>>>>", rows)


def _draws_row(drawn: ParameterDraws, parameter: FittedParameter, posterior: bool) -> list[str]:
    unit, factor = display_unit(parameter.unit)
    places = decimals_for(drawn.deviation * factor)
    interval = lambda ends: " .. ".join(rounded(end * factor, places) for end in ends)
    row = [
        drawn.path,
        unit,
        rounded(drawn.mean * factor, places),
        rounded(drawn.deviation * factor, places),
        percent(drawn.deviation, drawn.mean),
        interval(drawn.percentile),
    ]
    if posterior:
        sizes = [size for size in (drawn.effective, drawn.effective_tails) if size is not None]
        rhat = "-" if drawn.rhat is None else f"{drawn.rhat:.3f}"
        return [*row, rhat, f"{min(sizes):.0f}" if sizes else "-"]
    mirrored = "-" if drawn.basic is None else interval(drawn.basic)
    return [*row, mirrored, rounded(parameter.standard_error * factor, places)]


def format_profiles(profiles: Sequence[Profile], parameters: Mapping[str, FittedParameter]) -> str:
    """List the verdict of each parameter, and both ends of its interval relative to the linear ones.

    Free parameters without a profile are there, too, held by a bound at the estimate or without information.
    """
    rows = [["", "verdict", "below", "above", "quality"]]
    ratio = lambda verdict, square: f"{math.sqrt(square):.2f}" if verdict == "bounded" else "-"
    for profile in profiles:
        verdicts, ends = parameters[profile.path].verdicts or ("", ""), profile.linear[[0, -1]] / profile.threshold
        quality = "-" if math.isnan(profile.quality) else f"{profile.quality:.2f}"
        rows.append([profile.path, profile.verdict, *map(ratio, verdicts, ends), quality])
    profiled = {profile.path for profile in profiles}
    for path, parameter in parameters.items():
        if parameter.free and path not in profiled and (parameter.at_bound or not parameter.identifiable):
            verdict = "held by a bound: the estimate lies there" if parameter.at_bound else "flat: no information"
            rows.append([path, verdict, "-", "-", "-"])
    legend = (
        "    below, above: distance of either end in units of that of the linear interval (1.00: a parabola).\n"
        "    quality: 1 where the points of the curve predict each other, 0 where one misses by the threshold.\n"
    )
    return heading("Profiles of chi-square") + aligned_table("<<>>>", rows) + legend


def format_comparison(joint: Estimate, *others: Estimate) -> str:
    """Fits side by side: the values of each parameter, a line per method, with and without errors of the earlier step.

    **Arguments:** the `joint` fit, and fits of the same study in two steps, at least one.
    """
    estimates = [joint, *others]
    head = ["", "", "unit", "value", "+/- naive", "+/- corrected", "shift/sigma"]
    rows = [row for path in joint.names for row in _method_rows(path, estimates)]
    legend = "    naive: error with the earlier step taken as exact; corrected: with its errors included.\n"
    legend += "    shift/sigma: distance from the joint fit's value, in corrected standard errors.\n"
    *ways, last = [estimate.method for estimate in estimates]
    title = heading(f"{', '.join(ways)} and {last} side by side".capitalize())
    effects = [format_effects(other.amplification) for other in others[:1] if other.amplification is not None]
    return title + aligned_table("<<<>>>>", [head, *rows]) + legend + "".join(effects)


def _method_rows(path: str, estimates: Sequence[Estimate]) -> list[list[str]]:
    """The rows of a parameter, that of the joint fit first."""
    joint, rows = estimates[0].parameters[path], []
    unit, factor = display_unit(joint.unit)
    for estimate in estimates:
        found, first = estimate.parameters[path], estimate is estimates[0]
        shift = (found.value - joint.value) / found.standard_error if found.standard_error else math.nan
        rows.append(
            [
                path if first else "",
                estimate.method,
                unit if first else "",
                rounded(found.value * factor, decimals_for(found.standard_error * factor)),
                "" if found.naive_standard_error is None else percent(found.naive_standard_error, found.value),
                percent(found.standard_error, found.value),
                "" if first else rounded(shift, 2),
            ]
        )
    return rows
