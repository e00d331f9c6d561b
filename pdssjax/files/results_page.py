"""Reads a folder of results as a page for a colleague."""

import json
from pathlib import Path

from ..core import InputError
from ..report.page import Illustration, Page, Section, estimate_page
from .estimate_folder import read_estimate_folder

_MOST_BYTES = 2_000_000
"""Largest size of the pictures on a page: as text they are a third larger, and mail refuses more than 3 MB."""


_OWN = "comparison.html", "plan.html"
"""Pages that commands write themselves, since they know more than their files say."""


def own_page(folder: Path) -> Path | None:
    """The page that the command wrote into its `folder` of results; None where it wrote none."""
    return next((folder / name for name in _OWN if (folder / name).is_file()), None)


def read_page(folder: Path) -> Page:
    """The page of a `folder` of results: of an estimate all that is known, of others their texts and pictures.

    **Raises:** `InputError` where there are no results, or they cannot be read.
    """
    if not folder.is_dir():
        what = "a file" if folder.exists() else "nothing there"
        raise InputError(f"{folder}: found {what}, expected a folder that a command of pdssjax wrote.")
    if (folder / "estimate.json").exists():
        return estimate_page(read_estimate_folder(folder))
    texts = [_section(file) for file in sorted(folder.glob("*.txt"))]
    pictures = [*sorted(folder.glob("*.png")), *sorted((folder / "plots").rglob("*.png"))]
    if not (texts or pictures):
        raise InputError(
            f"{folder}: found no estimate.json, no text and no picture; expected a folder that a command of pdssjax "
            "wrote."
        )
    figures, left = _illustrations(pictures)
    text = [f"Left out, since the page would become too large to send: {', '.join(left)}."] if left else []
    shown = [Section("Figures", text, figures=figures)] if pictures else []
    return Page(_title(folder), [*texts, *shown], subtitle=f"Results in the folder {folder.resolve().name}")


def _section(file: Path) -> Section:
    """A plain text as it is."""
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read ({error}), expected a plain text.") from None
    return Section(file.stem.replace("_", " ").capitalize(), lines=lines)


def _title(folder: Path) -> str:
    """The title that one of the JSON files of a `folder` has, or its name."""
    for file in sorted(folder.glob("*.json")):
        try:
            document: object = json.loads(file.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError, RecursionError):
            continue  # only the title is wanted, and the folder has a name
        title = document.get("title") if isinstance(document, dict) else None
        if isinstance(title, str) and title:
            return title
    return folder.resolve().name


def _illustrations(pictures: list[Path]) -> tuple[list[Illustration], list[str]]:
    """Pictures up to the size of a page, and the names of those beyond it."""
    shown, left, room = [], [], _MOST_BYTES
    for file in pictures:
        content = file.read_bytes()
        if len(content) > room:
            left.append(file.name)
            continue
        room -= len(content)
        shown.append(Illustration(content, f"{file.stem.replace('_', ' ')}."))
    return shown, left
