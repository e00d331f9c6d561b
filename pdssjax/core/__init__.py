"""Errors, units, declared quantities, families of models, and the set-up of JAX.

The ground floor: imports no other room of pdssjax.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .arrays import (
        Count as Count,
        Document as Document,
        Given as Given,
        Scalar as Scalar,
        ScalarLike as ScalarLike,
        Tree as Tree,
        Truth as Truth,
        ascending_times as ascending_times,
        on_device as on_device,
    )
    from .by_value import equal_by_value as equal_by_value
    from .display_units import (
        LENGTH as LENGTH,
        MICROMETRES as MICROMETRES,
        VELOCITY as VELOCITY,
        Display as Display,
        decimals_for as decimals_for,
        display_unit as display_unit,
        percent as percent,
        rounded as rounded,
        strongest_pairs as strongest_pairs,
        with_micro_sign as with_micro_sign,
    )
    from .errors import (
        MOST_DRAWN as MOST_DRAWN,
        MOST_POINTS as MOST_POINTS,
        MOST_SEED as MOST_SEED,
        MOST_STARTS as MOST_STARTS,
        MOST_WORKERS as MOST_WORKERS,
        InputError as InputError,
        InputWarning as InputWarning,
        MiscompilationError as MiscompilationError,
        check_executor as check_executor,
        check_kind as check_kind,
        check_whole as check_whole,
        nearest as nearest,
    )
    from .families import docstring_of as docstring_of, member as member, member_name as member_name, members as members
    from .jax_setup import (
        Float64Call as Float64Call,
        prepare_jax as prepare_jax,
        require_float64 as require_float64,
        use_float64 as use_float64,
    )
    from .kept_programs import (
        KeptFunction as KeptFunction,
        forget_programs as forget_programs,
        keep_programs_in as keep_programs_in,
        kept_jit as kept_jit,
    )
    from .physical_quantity import (
        AbstractModel as AbstractModel,
        Choice as Choice,
        Declared as Declared,
        Quantity as Quantity,
        as_number as as_number,
        as_single as as_single,
        check_range as check_range,
        choice as choice,
        choices as choices,
        described as described,
        quantities as quantities,
        quantity as quantity,
        single_number as single_number,
    )
    from .presentation import (
        Figure as Figure,
        clear_bar as clear_bar,
        draw_in_notebook as draw_in_notebook,
        notebook_counter as notebook_counter,
        notebook_progress as notebook_progress,
        present_with as present_with,
        presenter as presenter,
    )
    from .process import (
        installed_versions as installed_versions,
        one_blas_thread as one_blas_thread,
        raise_gc_threshold as raise_gc_threshold,
    )
    from .quasi_random import sobol_points as sobol_points
    from .units import (
        column_unit as column_unit,
        factor as factor,
        split_text as split_text,
        to_si as to_si,
        unit_given as unit_given,
        unit_named as unit_named,
    )
else:
    from .lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
