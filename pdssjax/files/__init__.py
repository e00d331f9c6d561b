"""The only room that touches the disk: reads studies, records and estimates, writes results.

What is at fault in a user's file or option is raised as `InputError`, which names the place.  Imports `report` and the
rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .channel_roles import Hints as Hints
    from .channel_samples import list_channels as list_channels
    from .characterise_record import characterise as characterise, write_characterisations as write_characterisations
    from .comparison_folder import (
        CandidateFolder as CandidateFolder,
        compare as compare,
        write_selection as write_selection,
    )
    from .design_table import (
        BUDGET_KEYS as BUDGET_KEYS,
        DesignTable as DesignTable,
        read_design as read_design,
        read_knowledge as read_knowledge,
    )
    from .draws_file import DrawsFile as DrawsFile, holds_draws as holds_draws, read_draws as read_draws
    from .estimate_folder import (
        own_page as own_page,
        read_estimate_folder as read_estimate_folder,
        read_page as read_page,
    )
    from .estimate_results import (
        estimate_text as estimate_text,
        read_covariance as read_covariance,
        starting_at_estimate as starting_at_estimate,
        with_estimate as with_estimate,
        write_comparison as write_comparison,
        write_essentials as write_essentials,
        write_estimate as write_estimate,
    )
    from .friction_study import (
        FrictionFile as FrictionFile,
        friction_file as friction_file,
        write_friction_study as write_friction_study,
    )
    from .guessed_record import NewRecord as NewRecord, RigOptions as RigOptions, guess_file as guess_file
    from .new_study import drive_of_samples as drive_of_samples, write_study as write_study
    from .plan_results import (
        REHEARSAL as REHEARSAL,
        plan_folder as plan_folder,
        write_plan as write_plan,
        write_rehearsal as write_rehearsal,
    )
    from .record_results import (
        check_recordings as check_recordings,
        write_predictions as write_predictions,
        write_recordings as write_recordings,
    )
    from .results_folder import (
        EXAMPLE as EXAMPLE,
        check_empty as check_empty,
        check_free as check_free,
        copy_example as copy_example,
        reserved_folder as reserved_folder,
        write_aside as write_aside,
    )
    from .study_copy import save_study as save_study
    from .study_schema import schema_text as schema_text
    from .study_toml import load_study as load_study
    from .sweep_store import (
        SWEEP_STORE as SWEEP_STORE,
        SweepStore as SweepStore,
        bytes_needed as bytes_needed,
        check_room as check_room,
        check_store as check_store,
        check_zarr as check_zarr,
        read_sweep as read_sweep,
        write_border as write_border,
        write_sweep as write_sweep,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
