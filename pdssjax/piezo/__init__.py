"""Models of the piezo stack with its platform, one a file; a member's name in a study is its file's name.

Imports `core`, the series of `integration`, and `drive` for the voltage that a stack feels.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._composition import DYNAMICS as DYNAMICS
    from ._composition import HYSTERESES as HYSTERESES
    from ._composition import MOST as MOST
    from ._composition import Composition as Composition
    from ._composition import Field as Field
    from ._composition import fields_of as fields_of
    from ._oscillator import damped as damped
    from ._oscillator import underdamped as underdamped
    from ._rod import Modes as Modes
    from ._rod import Rod as Rod
    from ._rod import mode_responses as mode_responses
    from ._rod import modes as modes
    from ._rod import modes_needed as modes_needed
    from ._rod import roots as roots
    from ._rod import shapes as shapes
    from ._rod import step_response as step_response
    from ._rod import truncation_error as truncation_error
    from ._rod import truncation_transfer as truncation_transfer
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "_composition": ["DYNAMICS", "HYSTERESES", "MOST", "Composition", "Field", "fields_of"],
            "_oscillator": ["damped", "underdamped"],
            "_rod": [
                "Modes",
                "Rod",
                "mode_responses",
                "modes",
                "modes_needed",
                "roots",
                "shapes",
                "step_response",
                "truncation_error",
                "truncation_transfer",
            ],
        },
    )
