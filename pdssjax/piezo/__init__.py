"""Models of the piezo stack with its platform, one a file; a member's name in a study is its file's name.

Imports `core`, the series of `integration`, and `drive` for the voltage that a stack feels.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._composition import (
        DYNAMICS as DYNAMICS,
        HYSTERESES as HYSTERESES,
        MOST as MOST,
        Composition as Composition,
        Field as Field,
        fields_of as fields_of,
    )
    from ._oscillator import damped as damped, underdamped as underdamped
    from ._rod import (
        Modes as Modes,
        Rod as Rod,
        mode_responses as mode_responses,
        modes as modes,
        modes_needed as modes_needed,
        roots as roots,
        shapes as shapes,
        step_response as step_response,
        truncation_error as truncation_error,
        truncation_transfer as truncation_transfer,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
