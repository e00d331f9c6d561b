"""The class of every composed stack, made of the text that names it: its parameters become its fields."""

import copy
from functools import cache
from typing import Any

from ..core import Scalar
from ._composed_model import ComposedModel
from ._composition import Composition, composition_of, fields_of, hysteretic_names, mechanical_names
from ._loop_columns import loop_numbers

HOME = "pdssjax.piezo.composed"
"""Where classes say that they come from: there another process finds them by name."""


@cache
def composed_class(made: Composition) -> type[ComposedModel]:
    """The class of a stack that is `made` so: always the same one."""
    fields = fields_of(made)
    compliant = made.dynamics in ("second-order", "rod")
    name = "Composed" if made == Composition() else f"Composed:{made.text}"
    contents: dict[str, Any] = {
        "__module__": HOME,
        "__qualname__": name,
        "__doc__": ComposedModel.__doc__,
        "__annotations__": {field.name: float for field in fields},
        "made": made,
        "told": {field.name: field.text for field in fields},
        "variant_name": "" if made == Composition() else made.text,
        "variant": staticmethod(composed_variant),
        "is_compliant": compliant,
        "loop_numbers": loop_numbers(made),
        "mechanical": mechanical_names(made),
        "hysteretic": hysteretic_names(made),
        "closed_on_lines": made.closed_on_lines,
        # Copies: a declaration belongs to the one field that it is given to.
        **{field.name: copy.copy(field.declared) for field in fields},
    }
    if "mass" not in contents:
        contents["mass"] = property(_mass)
    metaclass: Any = type(ComposedModel)
    return metaclass(name, (ComposedModel,), contents)


def _mass(stack: ComposedModel) -> Scalar:
    """Moving mass [kg] that a force accelerates at first; infinite where none moves the platform."""
    return stack.dynamics.mass()


def composed_variant(text: str) -> type[ComposedModel]:
    """The stack that `text` describes, such as "static+play-8+creep-3".

    **Raises:** `KeyError` for what is no such text.
    """
    return composed_class(composition_of(text))
