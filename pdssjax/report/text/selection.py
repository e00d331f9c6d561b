"""A comparison of models as text: the model that is enough, the misfit of the others, the record to make next."""

import math
from typing import NamedTuple

from ...selection import Comparison, Difference, DiscriminatingRecord, Misfit, RecordNoise, Result
from ...study import Record
from ._layout import aligned_table, counted, heading, note


def format_selection(found: Comparison) -> str:
    """The report of a comparison."""
    words = selection_sentences(found)
    parts = [f"{found.title}: which model?\n", *(note(sentence, 0) for sentence in words.answer), "\n"]
    parts += [heading("Models"), aligned_table("<>>>>>><", [words.head, *words.rows]), note(words.caption)]
    for title, lines in (
        ("What each other model leaves", words.lacks),
        ("What would tell them apart", [words.telling] if words.telling else []),
        ("Noise, the same for all models", words.noise),
        ("Models without a fit", words.failures),
    ):
        if lines:
            parts += ["\n", heading(title), *map(note, lines)]
    return "".join(parts)


class SelectionSentences(NamedTuple):
    """Sentences and table rows of a comparison, for text, page and notebook."""

    answer: list[str]
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    caption: str
    lacks: list[str]
    telling: str
    noise: list[str]
    failures: list[str]


def selection_sentences(found: Comparison) -> SelectionSentences:
    """A comparison in words and as the rows of a table."""
    records = {record.name: record for record in found.records}
    caption = (
        "held out, records: by how much the log score on held-out blocks of time, and on whole records, lies below "
        f"that of the best model, {found.best or 'none'}, and its standard error. A model is worse where the "
        "difference is at least two standard errors, at least 3, and at least half of the chi-square that the best "
        "model leaves beyond noise; on blocks of time not where it explains the fitted samples as well, with fewer "
        "parameters by the criterion, with more by the likelihood: blocks then show only how little the records tell "
        "of its parameters. criterion: Schwarz's (BIC) with the number of independent samples, above the lowest."
    )
    worse = [(result.name, result.misfit) for result in found.results if result.is_worse]
    return SelectionSentences(
        _answer(found),
        ("model", "free", "held out", "+/-", "records", "+/-", "criterion", ""),
        list(map(_row, found.results)),
        caption,
        [f"{name}: {_misfit(misfit, found.best, records[misfit.record])}" for name, misfit in worse if misfit],
        _discriminating_record(found),
        [f"{name}: {_noise(noise, records[name])}" for name, noise in found.noise.items()],
        [f"{result.name}: {result.fitted.failure}" for result in found.results if result.fitted.failure],
    )


def _answer(found: Comparison) -> list[str]:
    """The answer in a few sentences: the model that is enough, and those that the records cannot tell from it."""
    if not found.chosen:
        return ["No model gave a fit that can be compared; the reasons are below."]
    chosen, best = found[found.chosen], found[found.best]
    held = f"{counted(found.blocks, 'block')} of time"
    if found.whole_records:
        held += f" and {counted(found.whole_records, 'whole record')}"
    if not (found.blocks or found.whole_records):
        return [
            f"No samples could be held out, so the models cannot be compared; {found.chosen} is the simplest of them."
        ]
    lines = [f"{found.chosen} is the simplest model that predicts held-out samples ({held}) no worse than any."]
    if found.chosen != found.best:
        time, extra = chosen.time, len(best.fitted.free) - len(chosen.fitted.free)
        assert time is not None
        more = counted(extra, "more parameter") if extra > 0 else "another model"
        lines.append(
            f"{found.best} predicts them best, by {_number(time.total)} in log score with a standard error of "
            f"{_number(time.standard_error)}, which is no reason for {more}."
        )
    if found.ambiguous:
        lines.append(f"These records do not tell it from {_enumerated(found.ambiguous)}.")
    worse = [result.name for result in found.results if result.is_worse]
    if worse:
        lines.append(f"Significantly worse: {_enumerated(worse)}.")
    if not chosen.fitted.explained:
        lines.append("It leaves more than noise, so another model or another optimum may do better than all of these.")
    if not chosen.fitted.converged:
        lines.append("Its fit did not converge: compare again with more effort.")
    return lines


def _row(result: Result) -> tuple[str, ...]:
    """A model as a row of the table."""
    free = str(len(result.fitted.free))
    if result.fitted.failure:
        return result.name, free, "", "", "", "", "", "no fit"
    remarks = ["worse"] * result.is_worse + ["not converged"] * (not result.fitted.converged)
    remarks += ["leaves more than noise"] * (not result.fitted.explained)
    pairs = (*_pair(result.time), *_pair(result.records))
    return result.name, free, *pairs, _number(result.criterion), ", ".join(remarks)


def _misfit(misfit: Misfit, best: str, record: Record) -> str:
    display = record.measurement.display
    if misfit.by_phase:
        window = f"between {100 * misfit.begin:.0f} and {100 * misfit.end:.0f} % of the drive's cycle"
        if misfit.end < misfit.begin:
            window = f"from {100 * misfit.begin:.0f} % of the drive's cycle to {100 * misfit.end:.0f} % of the next"
    else:
        window = f"between {misfit.begin:.4g} and {misfit.end:.4g} s"
    mine, theirs = (f"{display.scale * rms:.3g}" for rms in (misfit.rms, misfit.best_rms))
    return (
        f"{100 * misfit.share:.0f} % of what it leaves beyond {best} lies in the record {misfit.record}, {window}; "
        f"the root mean square of the record is {mine} {display.unit}, that of {best} {theirs}."
    )


def _discriminating_record(found: Comparison) -> str:
    """Which record would tell models apart that these records do not; "" where there is nothing to tell."""
    if not found.ambiguous:
        return ""
    if found.telling is None:
        return "No record like these, at other voltages or frequencies, shows a difference between the fitted models."
    sentence = f"To tell {_enumerated(found.telling.models)} apart, measure {_telling(found.telling)}."
    chosen, other = (found[name].fitted.model for name in found.telling.models)
    if all(chosen[key] == other[key] for key in chosen if key not in ("friction", "friction_state")):
        sentence += f" pdssjax design STUDY --against {other['friction']} plans such records within limits and costs."
    return sentence


def _telling(record: DiscriminatingRecord) -> str:
    shown = f"the {record.measures} as in {record.template}"
    if math.isnan(record.voltage):
        shown += f" with the motion {record.speed:g} times as fast" if record.speed != 1.0 else " once more"
    else:
        shown += f" at {record.voltage:.3g} V and {record.frequency:.3g} Hz"
    if record.window < 1.0:
        shown += f", with all samples in the first {100 * record.window:.0f} % of each cycle"
    strength = "just enough" if record.sigmas > 4.0 else "too little to tell"
    strength = "enough to tell" if record.sigmas > 8.0 else strength
    return (
        f"{shown}: of {record.tried} records tried, the two fitted models differ most there, by {record.sigmas:.2g} "
        f"standard deviations of the noise over {record.samples} samples, which is {strength}"
    )


def _noise(noise: RecordNoise, record: Record) -> str:
    display, origin = record.measurement.display, "told" if noise.told else "found"
    colour = f"correlated over {1e3 * noise.correlation_time:.3g} ms" if noise.correlation_time > 0.0 else "white"
    return (
        f"{display.scale * noise.deviation:.3g} {display.unit} ({origin}), {colour}, "
        f"{noise.independent:.0f} of {record.time.size} samples count as independent"
    )


def _pair(found: Difference | None) -> tuple[str, str]:
    return ("", "") if found is None else (_number(found.total), _number(found.standard_error))


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) < 1e4 else f"{value:.3g}"


def _enumerated(names: tuple[str, ...] | list[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
