"""A page of HTML made of sections: paragraphs, tables and figures of matplotlib.

The file loads nothing: style, script and figures are inside it, and its Content-Security-Policy forbids the rest.
Everything that is text is escaped.
"""

import base64
import hashlib
import html
import io
import itertools
import json
import math
import os
import re
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core import Figure, InputError


class Share(NamedTuple):
    """A cell of a table with a bar."""

    text: str
    """Text of the cell."""
    share: float
    """Length of the bar, from 0 to 1 of the cell; no bar where it is NaN."""


@dataclass(frozen=True)
class Table:
    """Rows below a head, the first column being what each row is about."""

    head: Sequence[str]
    """What each column is, with its unit where all rows have the same; "" for a column that explains itself."""
    rows: Sequence[Sequence[str | Share]]
    """Rows of as many cells as the head has."""
    align: str = ""
    """A "<" (left) or ">" (right) for each column; left alone for the first of them where nothing is given."""
    caption: str = ""
    """One or two sentences above it."""


@dataclass(frozen=True)
class Illustration:
    """A figure with what a reader has to know of it."""

    figure: Figure | bytes
    """A figure of matplotlib, or the content of a PNG file."""
    caption: str
    """One or two sentences below it."""
    description: str = ""
    """What the figure shows, for those who cannot see it; the caption where nothing is given."""


@dataclass(frozen=True)
class Section:
    """A part of a page, in this order: paragraphs, a list, lines as they are, tables, figures."""

    heading: str
    text: Sequence[str] = ()
    """Paragraphs."""
    points: Sequence[str] = ()
    """Entries of a list."""
    lines: Sequence[str] = ()
    """Lines of a program or of a plain text, shown as they are, in letters of one width."""
    tables: Sequence[Table] = ()
    figures: Sequence[Illustration] = ()
    folded: bool = False
    """Only the heading is shown until it is clicked; printed in full."""


@dataclass(frozen=True)
class Page:
    """A whole document."""

    title: str
    sections: Sequence[Section]
    subtitle: str = ""
    """One line below the title."""


def write_page(path: str | os.PathLike[str], page: Page, *, overwrite: bool = False) -> None:
    """Write a page into one HTML file, which opens in any browser without network.

    ```python
    from matplotlib.figure import Figure
    from pdssjax.report.page import Illustration, Page, Section, Table, write_page

    figure = Figure()
    figure.subplots().plot([0, 1], [0, 2])
    table = Table(["law", "chi-square"], [["Dahl", "812.4"], ["LuGre", "640.1"]])
    section = Section("Laws", ["LuGre explains the records best."], [table], [Illustration(figure, "Chi-square.")])
    write_page("laws.html", Page("Which law", [section]))
    ```

    **Raises:** `InputError` where `path` exists and `overwrite` is false, or is a folder; `OSError` where nothing can
    be written there.
    """
    place = Path(path)
    if place.is_dir():
        raise InputError(f"{place}: found a folder, expected the name of an HTML file to write.")
    if place.exists() and not overwrite:
        raise InputError(f"{place}: found a file there already; expected another name, or to be told to overwrite it.")
    text = page_html(page)
    # Moved into place when it is whole: a page that cannot be written leaves the former one.
    handle, temporary = tempfile.mkstemp(prefix=".", suffix=".html", dir=place.parent)
    try:
        with open(handle, "w", encoding="utf-8", errors="xmlcharrefreplace") as file:
            file.write(text)
        mask = os.umask(0)  # to read it is to set it
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, place)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def page_html(page: Page) -> str:
    """The whole document as text.

    **Raises:** `ValueError` where a row of a table has more or fewer cells than its head.
    """
    style, script = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    policy += "; base-uri 'none'; form-action 'none'"
    numbers = itertools.count(1)
    links = [f'<li><a href="#s{at}">{html.escape(each.heading)}</a></li>' for at, each in enumerate(page.sections, 1)]
    contents = f'<nav aria-label="Contents"><ol>{"".join(links)}</ol></nav>\n' if len(links) > 2 else ""
    subtitle = f'<p class="subtitle">{html.escape(page.subtitle)}</p>\n' if page.subtitle else ""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="generator" content="pdssjax">\n'
        f"<title>{html.escape(page.title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<header>\n<h1>{html.escape(page.title)}</h1>\n{subtitle}</header>\n"
        f"{contents}<main>\n"
        + "".join(_section(section, at, numbers) for at, section in enumerate(page.sections, 1))
        + f"</main>\n<script>{script}</script>\n</body>\n</html>\n"
    )


def _section(section: Section, at: int, numbers: Iterator[int]) -> str:
    parts = [f"<p>{html.escape(text)}</p>" for text in section.text]
    if section.points:
        parts.append("<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in section.points) + "</ul>")
    if section.lines:
        parts.append(f'<pre tabindex="0">{html.escape(chr(10).join(section.lines))}</pre>')
    for table in section.tables:
        if table.caption:  # beside the table, which may be wider than the screen
            parts.append(f'<p class="caption">{html.escape(table.caption)}</p>')
        label = html.escape(table.caption or section.heading, quote=True)
        parts.append(
            f'<div class="table" tabindex="0" role="region" aria-label="{label}">\n{table_html(table)}\n</div>'
        )
    for shown, number in zip(section.figures, numbers, strict=False):
        description = shown.description or shown.caption
        if isinstance(shown.figure, bytes):
            svg = _picture(shown.figure, description)
        else:
            svg = _svg(shown.figure, number, description)
        caption = html.escape(f"Figure {number}. {shown.caption}")
        parts.append(f"<figure>\n{svg}\n<figcaption>{caption}</figcaption>\n</figure>")
    heading, body = f"<h2>{html.escape(section.heading)}</h2>", "\n".join(parts)
    if section.folded:
        heading, body = "", f"<details>\n<summary>{heading}</summary>\n{body}\n</details>"
    return f'<section id="s{at}">\n{heading}\n{body}\n</section>\n'


def table_html(table: Table) -> str:
    """A table of HTML without its caption, its columns aligned without a style sheet; all cells are escaped.

    **Raises:** `ValueError` where a row has more or fewer cells than the head.
    """
    align = table.align or "<" + ">" * (len(table.head) - 1)
    sides = ["left" if side == "<" else "right" for side in align]
    head = "".join(_cell("th", side, cell, ' scope="col"') for side, cell in zip(sides, table.head, strict=True))
    rows = []
    for cells in table.rows:
        first, *others = zip(sides, cells, strict=True)
        rows.append(_cell("th", *first, ' scope="row"') + "".join(_cell("td", *each) for each in others))
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _cell(tag: str, side: str, cell: str | Share, scope: str = "") -> str:
    text, bar = cell, ""
    if isinstance(cell, Share):
        text = cell.text
        if math.isfinite(cell.share):
            length = 100.0 * min(max(cell.share, 0.0), 1.0)
            bar = f'<span class="bar"><span style="width: {length:.1f}%"></span></span>'
    return f'<{tag}{scope} style="text-align: {side}">{html.escape(str(text))}{bar}</{tag}>'


_MOST_MARKERS, _MOST_VERTICES = 1500, 20_000
"""Samples of a line, with and without markers, from which on it is embedded as a picture: a page of megabytes opens
slowly, and is refused by mail servers."""


def _element(view: str, inches: float, description: str, axes: list[dict[str, Any]], content: str) -> str:
    """An element of the page that can be zoomed."""
    label, known = (html.escape(each, quote=True) for each in (description, json.dumps(axes)))
    # Eight letters an inch, so that all figures have lettering of one size.
    style = f"max-width: {8.0 * inches:.4g}rem"
    return f'<svg viewBox="{view}" style="{style}" role="img" aria-label="{label}" data-axes="{known}">{content}</svg>'


def _picture(content: bytes, description: str) -> str:
    """A PNG file as an element of HTML; **raises** `InputError` where it is none."""
    if content[:8] != b"\x89PNG\r\n\x1a\n" or len(content) < 24:
        raise InputError(f"figure: found {len(content)} bytes that are no PNG picture ({description}), expected one.")
    width, height = struct.unpack(">II", content[16:24])
    data = base64.b64encode(content).decode()
    image = f'<image width="{width}" height="{height}" href="data:image/png;base64,{data}"/>'
    # Plots in a folder of results have 200 dots an inch.
    return _element(f"0 0 {width} {height}", width / 200, description, [], image)


def _svg(figure: Figure, number: int, description: str) -> str:
    """A figure as an element of HTML, with identifiers that no other figure of the page has."""
    file = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))  # the same figure gives the same text
    with _dense_lines_as_pictures(figure):
        figure.savefig(file, format="svg", dpi=300, metadata=nothing)  # pictures in it bear some zooming
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", file.getvalue(), flags=re.S)
    ((attributes, body),) = re.findall(r"<svg\b([^>]*)>(.*)</svg>", text, flags=re.S)
    view = re.findall(r'viewBox="([^"]+)"', attributes)[0]
    names = {name: f"f{number}-{at}" for at, name in enumerate(dict.fromkeys(re.findall(r'\bid="([^"]+)"', body)))}
    renamed = lambda found: found[1] + names.get(found[2], found[2])
    body = re.sub(r"""(\bid="|\bhref="#|\burl\(#)([^")]+)""", renamed, body)
    return _element(view, figure.get_figwidth(), description, _axes(figure), body.strip())


@contextmanager
def _dense_lines_as_pictures(figure: Figure) -> Iterator[None]:
    """Rasterise lines of many samples while the figure is saved; afterwards the figure is as before."""
    most = lambda line: _MOST_VERTICES if line.get_marker() in (None, "", " ", "None", "none") else _MOST_MARKERS
    lines = [line for axes in figure.axes for line in axes.lines if not line.get_rasterized()]
    dense = [line for line in lines if np.size(line.get_xdata()) > most(line)]
    for line in dense:
        line.set_rasterized(True)
    try:
        yield
    finally:
        for line in dense:
            line.set_rasterized(False)


def _axes(figure: Figure) -> list[dict[str, Any]]:
    """Place in the figure, from the top left, and limits in its unit, of every linear pair of axes.

    By it the page says at which coordinates the pointer is.
    """
    found = []
    for axes in figure.axes:
        box, edges = axes.get_position(), [*axes.get_xlim(), *axes.get_ylim()]
        is_linear = axes.name == "rectilinear" and axes.get_xscale() == axes.get_yscale() == "linear"
        if is_linear and axes.get_visible() and all(map(math.isfinite, edges)):
            place = [round(float(end), 5) for end in (box.x0, 1.0 - box.y1, box.x1, 1.0 - box.y0)]
            labels = [_label(axes, "x"), _label(axes, "y")]
            found.append({"place": place, "edges": [float(f"{end:.9g}") for end in edges], "labels": labels})
    return found


def _label(axes: Any, name: str) -> str:
    """The label of an axis, which may stand at another panel that shares it."""
    shared = axes.get_shared_x_axes() if name == "x" else axes.get_shared_y_axes()
    labels = [getattr(each, f"get_{name}label")() for each in (axes, *shared.get_siblings(axes))]
    return next(filter(None, labels), name).replace("\n", " ")
