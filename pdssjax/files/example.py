"""Where the packaged example is, and a copy of it."""

from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "example"
"""Folder of the packaged study."""


def copy_example(folder: Path) -> None:
    """Copy the packaged example into `folder`, all of it or nothing.

    **Raises:** `InputError` where the folder holds something already, or cannot be written to.
    """
    import shutil

    from .results_folder import check_empty, staging_folder

    check_empty(folder)
    with staging_folder(folder, sorted(path.name for path in EXAMPLE.iterdir())) as staging:
        for path in EXAMPLE.iterdir():
            shutil.copyfile(path, staging / path.name)
