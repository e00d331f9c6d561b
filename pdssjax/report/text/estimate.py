"""An estimate as plain text.

The order and the vocabulary follow lmfit's `fit_report`, which people in the field know.
"""

from collections.abc import Sequence

from ...core import decimals_for, display_unit, percent, rounded, strongest_pairs
from ...study import Estimate, FittedParameter
from ._layout import aligned_table, heading, note
from .amplification import format_amplification
from .diagnosis import format_diagnosis
from .draws import format_draws
from .multistart import format_multistart
from .profiles import format_profiles
from .records import format_records

WORTH_KNOWING = 0.3
"""Correlations smaller than this are left out of the report."""


def format_report(estimate: Estimate) -> str:
    """The whole report, in ASCII apart from what the study's own title and names contain."""
    parts = [
        heading(estimate.title) + _outcome(estimate) + _statistics(estimate),
        heading("Parameters") + _parameters(estimate),
        format_records(estimate.records),
        heading(f"Correlations of size {WORTH_KNOWING:g} or more") + _correlations(estimate),
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
    verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
    loss = "" if estimate.loss == "squares" else f" with {estimate.loss.capitalize()}'s loss"
    outcome = f"    {estimate.method} fit{loss} {verdict}: {estimate.message}\n"
    if estimate.converged and not estimate.explained:
        outcome += (
            "    The records leave more than noise, or contradict each other, or those that were not fitted are not "
            "predicted:\n    the law lacks something, or the optimum is a wrong one; see the notes.\n"
        )
    return outcome


def _statistics(estimate: Estimate) -> str:
    statistics = estimate.statistics
    fitted = sum(record.role == "fit" for record in estimate.records)
    apart = f", and {statistics.measured_apart} measured apart" if statistics.measured_apart else ""
    lines = [
        ("records fitted", f"{fitted} of {len(estimate.records)}"),
        ("samples fitted", f"{statistics.samples}{apart}"),
        ("free parameters", f"{len(estimate.names)}, with offsets {statistics.free}"),
        ("iterations", f"{statistics.iterations} ({statistics.evaluations} evaluations, {estimate.seconds:.1f} s)"),
        ("chi-square", f"{statistics.chi2:.6g}"),
        ("reduced chi-square", _reduced_chi2(estimate)),
        ("Akaike criterion", f"{statistics.aic:.6g}"),
        ("Bayesian criterion", f"{statistics.bic:.6g}"),
    ]
    return "".join(f"    {name:<19}= {text}\n" for name, text in lines)


def _reduced_chi2(estimate: Estimate) -> str:
    """The number, unless it is 1 by construction."""
    fitted = [record for record in estimate.records if record.role == "fit"]
    silent = sum(record.noise_estimated for record in fitted)
    if estimate.statistics.noise_estimated:
        return "- (noise estimated from these residuals)"
    mixed = f" (noise estimated from the residuals in {silent} of {len(fitted)} records)" if silent else ""
    return f"{estimate.statistics.reduced_chi2:.6g}{mixed}"


def _parameters(estimate: Estimate) -> str:
    models = list(next((p.errors for p in estimate.parameters.values() if p.errors), {}))
    names = [model.replace("-", " ") for model in models] or [""]
    head = ["", "unit", "value", "+/-", *names, "naive", "95 % interval", "start", ""]
    rows = [head, *(_parameter(parameter, models) for parameter in estimate.parameters.values())]
    align, legend = "<<>>" + ">" * len(names) + "><<<", ""
    if estimate.method != "joint":
        legend = "    naive: the error if the results of the piezo's own fit were exact; +/-: with their errors.\n"
    else:
        place = 4 + len(names)
        align, rows = align[:place] + align[place + 1 :], [row[:place] + row[place + 1 :] for row in rows]
    return aligned_table(align, rows) + legend + _about_errors(estimate, models)


def _about_errors(estimate: Estimate, models: Sequence[str]) -> str:
    """What the errors by each model cover, and which to believe."""
    if estimate.error_advice is None:
        return ""
    from ...inference import all_error_models

    lines = [note(f"{m.name.replace('-', ' ')}: covers {m.covers}.") for m in all_error_models() if m.name in models]
    profiled = any(parameter.verdicts for parameter in estimate.parameters.values())
    way = estimate.draws.kind if estimate.draws is not None else "profile likelihood" if profiled else ""
    which = f"+/-: {models[0]}; interval: by {way}" if way else f"+/- and interval: {models[0]}"
    return "".join(lines) + note(f"{which}. {estimate.error_advice.reason}")


def _parameter(parameter: FittedParameter, models: Sequence[str]) -> list[str]:
    unit, factor = display_unit(parameter.unit)
    places = decimals_for(parameter.standard_error * factor)
    low, high = (rounded(end * factor, places) for end in parameter.interval)
    start = None if parameter.start is None else f"{parameter.start * factor:.4g}"
    errors = [parameter.errors[model].standard_error for model in models if parameter.errors]
    shares = [percent(error, parameter.value) for error in errors or [parameter.standard_error] * max(len(models), 1)]
    return [
        parameter.path,
        unit,
        rounded(parameter.value * factor, places),
        rounded(parameter.standard_error * factor, places),
        *shares,
        _naive(parameter),
        "-" if low == high == "-" else f"{low} .. {high}",
        start or "-",
        parameter.remark,
    ]


def _naive(parameter: FittedParameter) -> str:
    if parameter.naive_standard_error is None:
        return "-"
    return percent(parameter.naive_standard_error, parameter.value)


def _correlations(estimate: Estimate) -> str:
    pairs = strongest_pairs(estimate.names, estimate.correlation, WORTH_KNOWING)
    if not pairs:
        return "    none\n"
    return aligned_table("<>", [[f"C({path}, {other})", f"{value:+.3f}"] for path, other, value in pairs])
