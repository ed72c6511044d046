"""A page of results: typed sections become one HTML file that holds its pictures, its style and its script.

    write_page(path, "What accuracy costs", [Section("Training", (Plot(...), Table(...)))])

Every string is escaped, so that names may be anything. Nothing is loaded from elsewhere, which the page's own policy
forbids too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from aa4d import __version__
from aa4d.files import write_text
from aa4d.identity import Identity, digest_of
from aa4d.reports.pictures import Picture
from aa4d.reports.plot import Plot

Value = str | int | float | None


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = ""  # "note" is small, "warning" stands out
    writes: ClassVar[str] = "text"


@dataclass(frozen=True)
class Code:
    """A text as it stands in a file."""

    text: str
    about: str  # for whoever cannot see it
    writes: ClassVar[str] = "code"


@dataclass(frozen=True)
class Links:
    """Files beside the page: names and addresses relative to it."""

    links: tuple[tuple[str, str], ...]
    writes: ClassVar[str] = "links"


@dataclass(frozen=True)
class Column:
    """Of a table. Numbers are written with `digits`; the first click on a heading puts the good end on top."""

    title: str
    digits: int | None = None  # None: as many as the number has, up to six
    good: int = 0  # 1 the higher, -1 the lower, 0 neither
    hint: str = ""
    is_number: bool = True


@dataclass(frozen=True)
class Cell:
    """A text that is sorted by a number."""

    text: str
    value: float | None = None
    mark: str = ""  # "best", "second", "default"
    is_number: bool = True
    wraps: bool = False

    @property
    def sort_key(self) -> str | None:
        if self.value is None or math.isnan(self.value):
            return None
        return repr(float(self.value)) if math.isfinite(self.value) else f"{'-' if self.value < 0 else ''}Infinity"

    @property
    def classes(self) -> str:
        named = (("number", self.is_number), (self.mark, self.mark), ("wraps", self.wraps))
        return " ".join(name for name, there in named if there)


@dataclass(frozen=True)
class Table:
    """Rows under headings that sort. A number that is not there is a blank, and sorted last."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[Value | Cell]]
    title: str = ""
    sorts: bool = True
    writes: ClassVar[str] = "table"

    @property
    def cells(self) -> list[list[Cell]]:
        return [[_cell(value, column) for value, column in zip(row, self.columns, strict=True)] for row in self.rows]


def _cell(value: Value | Cell, column: Column) -> Cell:
    if isinstance(value, Cell):
        return value
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return Cell("", is_number=column.is_number)
    if isinstance(value, str):
        return Cell(value, is_number=column.is_number, wraps=len(value) > 60)
    text = f"{value:z.{column.digits}f}" if column.digits is not None else f"{value:z.6g}"
    return Cell(text, float(value), is_number=column.is_number)


@dataclass(frozen=True)
class View:
    """A frame of a slider: a picture for each of the slider's names, None where there is none."""

    name: str
    pictures: tuple[Picture | None, ...]
    note: str = ""


@dataclass(frozen=True)
class Slider:
    """Two pictures of one frame with a divider to drag over them; with more than two one chooses which."""

    names: tuple[str, ...]
    views: tuple[View, ...]
    left: int = 0
    right: int = 1
    writes: ClassVar[str] = "slider"

    @property
    def width(self) -> int:
        return self._first.width

    @property
    def height(self) -> int:
        return self._first.height

    @property
    def _first(self) -> Picture:
        return next(picture for view in self.views for picture in view.pictures if picture is not None)


@dataclass(frozen=True)
class Loop:
    """A picture that moves, and its first frame for when it is held; names stand over the cells of a grid."""

    moving: Picture
    still: Picture
    names: tuple[str, ...]
    columns: int
    note: str = ""
    writes: ClassVar[str] = "loop"

    @property
    def lines(self) -> int:
        return -(-len(self.names) // self.columns)


@dataclass(frozen=True)
class Pictures:
    """Pictures in rows of so many."""

    pictures: tuple[Picture, ...]
    columns: int
    writes: ClassVar[str] = "pictures"


Part = Text | Code | Links | Table | Plot | Slider | Loop | Pictures


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    parts: Sequence[Part]
    note: str = ""
    folded: bool = False  # opened by a click
    anchor: str = ""  # which links of the page lead to


def html_of(
    title: str, sections: Sequence[Section], *, lead: str = "", identity: Identity | None = None, reduced: str = ""
) -> str:
    """The page, which says its own size.

    Args:
        lead: a paragraph below the title.
        identity: what the page was made from; None: nothing that has one.
        reduced: a sentence on what was made smaller to keep the file small.
    """
    template = environment().get_template("page.html.jinja")
    made_from = identity or Identity("report", digest_of({"version": __version__}))
    sections = [section for section in sections if section.parts]
    megabytes = "0.00"
    for _ in range(2):  # the second time with the size of the first
        html = template.render(
            title=title,
            lead=lead,
            sections=sections,
            identity=made_from.as_text(),
            version=__version__,
            reduced=reduced,
            megabytes=megabytes,
        )
        megabytes = f"{len(html.encode('utf-8')) / 1e6:.2f}"
    return html


def write_page(
    path: Path, title: str, sections: Sequence[Section], *, lead: str = "", identity: Identity | None = None
) -> None:
    """Write a page whole; a section without parts is left out."""
    write_text(path, html_of(title, sections, lead=lead, identity=identity))


def environment(*folders: Path) -> Environment:
    """Templates of this folder, after those of `folders`; what they write is escaped, what they lack is an error."""
    where = [*folders, Path(__file__).parent]
    return Environment(
        loader=FileSystemLoader(where), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
