"""Results as HTML, for notebooks, one kind of result a file; numbers with units, as in the report.

Imports results from the rooms below, never files.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .estimate import estimate_html as estimate_html
    from .study import study_html as study_html
    from .trajectory import trajectory_html as trajectory_html
else:
    from ...core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
