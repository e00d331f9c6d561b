"""What shows results in a notebook: `pdssjax.core.presenter()` is this module, by its name (`pdssjax/__init__.py`)."""

from ..core import Figure, InputError, draw_in_notebook
from ..simulation import Trajectory
from ..study import Estimate, Study


def as_html(shown: object) -> str:
    """A result as a piece of HTML."""
    from .html import estimate_html, study_html, trajectory_html

    if isinstance(shown, Estimate):
        return estimate_html(shown)
    if isinstance(shown, Study):
        return study_html(shown)
    if isinstance(shown, Trajectory):
        return trajectory_html(shown)
    raise TypeError(f"Argument `shown` must be a result, but it is a {type(shown).__name__}")


def as_figure(shown: object, what: str | None = None) -> Figure:
    """A result as a figure; **raises** `InputError` for a `what` that it does not have."""
    figure = _figure(shown, what)
    draw_in_notebook(type(figure))
    return figure


def _figure(shown: object, what: str | None) -> Figure:
    from .figures import study_figure, sweep_figure, trajectory_figure

    if isinstance(shown, Estimate):
        return _estimate_figure(shown, what)
    if isinstance(shown, Study):
        return study_figure(shown)
    if isinstance(shown, Trajectory):
        return trajectory_figure(shown)
    return sweep_figure(shown)  # pyright: ignore[reportArgumentType]


def _estimate_figure(estimate: Estimate, what: str | None) -> Figure:
    from .figures import (
        amplification_figure,
        correlation_figure,
        draws_figure,
        error_figure,
        estimate_figure,
        multistart_figure,
        profile_figure,
        record_figure,
    )

    known = {"errors": lambda: error_figure(estimate)}
    if len(estimate.names) > 1:
        known["correlations"] = lambda: correlation_figure(estimate)
    if estimate.profiles:
        known["profiles"] = lambda: profile_figure(estimate.profiles, estimate.parameters)
    if estimate.draws is not None:
        known["draws"] = lambda: draws_figure(estimate)
    if (starts := estimate.multistart) is not None:
        known["starts"] = lambda: multistart_figure(starts)
    if (amplification := estimate.amplification) is not None:
        known["amplification"] = lambda: amplification_figure(amplification)
    known |= {record.name: lambda record=record: record_figure(record) for record in estimate.records}
    if what is None:
        return estimate_figure(estimate)
    if what not in known:
        raise InputError(f'plot: found "{what}", expected one of {", ".join(known)}.')
    return known[what]()
