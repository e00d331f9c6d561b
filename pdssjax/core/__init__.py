"""Errors, units, declared quantities, families of models, and the set-up of JAX.

The ground floor: imports no other room of pdssjax.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .arguments import ascending_times as ascending_times
    from .arrays import Count as Count
    from .arrays import Document as Document
    from .arrays import Given as Given
    from .arrays import Scalar as Scalar
    from .arrays import ScalarLike as ScalarLike
    from .arrays import Tree as Tree
    from .arrays import Truth as Truth
    from .blas_threads import one_blas_thread as one_blas_thread
    from .by_value import equal_by_value as equal_by_value
    from .display_units import LENGTH as LENGTH
    from .display_units import MICROMETRES as MICROMETRES
    from .display_units import VELOCITY as VELOCITY
    from .display_units import Display as Display
    from .display_units import decimals_for as decimals_for
    from .display_units import display_unit as display_unit
    from .display_units import percent as percent
    from .display_units import rounded as rounded
    from .display_units import strongest_pairs as strongest_pairs
    from .errors import InputError as InputError
    from .errors import InputWarning as InputWarning
    from .errors import MiscompilationError as MiscompilationError
    from .errors import check_kind as check_kind
    from .errors import check_whole as check_whole
    from .errors import nearest as nearest
    from .executors import check_executor as check_executor
    from .families import member as member
    from .families import member_name as member_name
    from .families import members as members
    from .families import told_by as told_by
    from .garbage import seldom_look_for_garbage as seldom_look_for_garbage
    from .jax_setup import prepare_jax as prepare_jax
    from .jax_setup import require_float64 as require_float64
    from .most import MOST_DRAWN as MOST_DRAWN
    from .most import MOST_POINTS as MOST_POINTS
    from .most import MOST_SEED as MOST_SEED
    from .most import MOST_STARTS as MOST_STARTS
    from .most import MOST_WORKERS as MOST_WORKERS
    from .notebook import clear_bar as clear_bar
    from .notebook import counted_in_notebook as counted_in_notebook
    from .notebook import draw_in_notebook as draw_in_notebook
    from .notebook import told_in_notebook as told_in_notebook
    from .physical_quantity import AbstractModel as AbstractModel
    from .physical_quantity import Choice as Choice
    from .physical_quantity import Declared as Declared
    from .physical_quantity import Quantity as Quantity
    from .physical_quantity import as_number as as_number
    from .physical_quantity import as_single as as_single
    from .physical_quantity import check_range as check_range
    from .physical_quantity import choice as choice
    from .physical_quantity import choices as choices
    from .physical_quantity import described as described
    from .physical_quantity import quantities as quantities
    from .physical_quantity import quantity as quantity
    from .physical_quantity import single_number as single_number
    from .presentation import Figure as Figure
    from .presentation import present_with as present_with
    from .presentation import presenter as presenter
    from .quasi_random import sobol_points as sobol_points
    from .units import column_unit as column_unit
    from .units import factor as factor
    from .units import split_text as split_text
    from .units import to_si as to_si
    from .units import unit_given as unit_given
    from .units import unit_named as unit_named
else:
    from .lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "arguments": ["ascending_times"],
            "arrays": ["Count", "Document", "Given", "Scalar", "ScalarLike", "Tree", "Truth"],
            "blas_threads": ["one_blas_thread"],
            "by_value": ["equal_by_value"],
            "display_units": [
                *("Display", "LENGTH", "MICROMETRES", "VELOCITY", "decimals_for", "display_unit"),
                *("percent", "rounded", "strongest_pairs"),
            ],
            "errors": ["InputError", "InputWarning", "MiscompilationError", "check_kind", "check_whole", "nearest"],
            "executors": ["check_executor"],
            "families": ["member", "member_name", "members", "told_by"],
            "garbage": ["seldom_look_for_garbage"],
            "jax_setup": ["prepare_jax", "require_float64"],
            "most": ["MOST_DRAWN", "MOST_POINTS", "MOST_SEED", "MOST_STARTS", "MOST_WORKERS"],
            "notebook": ["clear_bar", "counted_in_notebook", "draw_in_notebook", "told_in_notebook"],
            "physical_quantity": [
                "AbstractModel",
                "Choice",
                "Declared",
                "Quantity",
                "as_number",
                "as_single",
                "check_range",
                "choice",
                "choices",
                "described",
                "quantities",
                "quantity",
                "single_number",
            ],
            "quasi_random": ["sobol_points"],
            "presentation": ["Figure", "present_with", "presenter"],
            "units": ["column_unit", "factor", "split_text", "to_si", "unit_given", "unit_named"],
        },
    )
