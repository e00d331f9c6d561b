"""The page of a comparison of models: the answer, the table, scores and residuals drawn, and how to repeat it."""

from collections.abc import Sequence

from ...core import display_unit
from ...selection import Comparison, Result
from ..text import selection_sentences
from .document import Illustration, Page, Section, Table


def comparison_page(found: Comparison, versions: Sequence[str] = (), commands: Sequence[str] = ()) -> Page:
    """A comparison as a page for a colleague.

    **Arguments:** `versions` of what computed it, and the `commands` that repeat it, both as lines.
    """
    from ..figures import residual_strips_figure, selection_figure

    words, scores, strips = selection_sentences(found), list[Illustration](), list[Illustration]()
    if found.chosen:
        caption = "Held-out log score of each model below the best one's, with two standard errors; the scale is "
        caption += "logarithmic beyond 10. In brackets: free parameters."
        scores.append(Illustration(selection_figure(found), caption))
        caption = "Residuals of each model in the record where it leaves most, grey those of the best model. What "
        caption += "returns at the same place of every cycle is misfit, not noise."
        strips.append(Illustration(residual_strips_figure(found), caption))
    table = Table(words.head, words.rows, "<>>>>>><", words.caption)
    sections = [Section("Which model", words.answer, tables=[table], figures=scores)]
    if words.lacks or strips:
        sections.append(Section("What each other model leaves", points=words.lacks, figures=strips))
    if words.telling:
        sections.append(Section("What would tell them apart", [words.telling]))
    if found.noise:
        sections.append(Section("Noise, the same for all models", points=words.noise))
    if words.failures:
        sections.append(Section("Models without a fit", points=words.failures))
    fitted = [result for result in found.results if not result.fitted.failure]
    if fitted:
        sections.append(Section("Parameters", tables=[_parameters(result) for result in fitted], folded=True))
    if versions or commands:
        sections.append(Section("How to repeat it", text=versions, lines=commands))
    return Page(f"{found.title}: which model?", sections)


def _parameters(result: Result) -> Table:
    """The numbers of one model."""
    rows = []
    for path in result.fitted.free:
        value, error = result.fitted.values[path], result.fitted.errors[path]
        unit, scale = display_unit(result.fitted.units[path])
        rows.append([path, f"{scale * value:.5g}", f"{scale * error:.2g}", unit])
    return Table(["parameter", "value", "standard error", "unit"], rows, "<>><", result.name)
