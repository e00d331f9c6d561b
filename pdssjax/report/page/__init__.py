"""Results as one self-contained HTML page, for a colleague who has a browser and nothing else.

Imports results from the rooms below, never files.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .comparison import comparison_page as comparison_page
    from .document import (
        Illustration as Illustration,
        Page as Page,
        Section as Section,
        Share as Share,
        Table as Table,
        page_html as page_html,
        table_html as table_html,
        write_page as write_page,
    )
    from .estimate import estimate_page as estimate_page
    from .plan import plan_html as plan_html, plan_page as plan_page
else:
    from ...core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
