"""Results as plain text, one kind of result a file.

Imports results from the rooms below, never files.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .estimate import (
        format_comparison as format_comparison,
        format_report as format_report,
        parameter_cells as parameter_cells,
    )
    from .listings import (
        format_catalogue as format_catalogue,
        format_channels as format_channels,
        format_characterisation as format_characterisation,
        format_entry as format_entry,
        format_guesses as format_guesses,
    )
    from .plan import (
        CONTRIBUTES as CONTRIBUTES,
        ERROR_HEAD as ERROR_HEAD,
        RECORD_HEAD as RECORD_HEAD,
        error_rows as error_rows,
        format_design as format_design,
        format_rehearsal as format_rehearsal,
        plan_summary as plan_summary,
        record_row as record_row,
        sampling_words as sampling_words,
    )
    from .records import format_numbers as format_numbers, format_records as format_records
    from .selection import format_selection as format_selection, selection_sentences as selection_sentences
    from .sweep import format_border as format_border, format_plan as format_plan, format_sweep as format_sweep
else:
    from ...core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
