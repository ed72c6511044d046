"""A page as large as its file may be: pictures are made smaller and fewer until it fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from aa4d.errors import InputError
from aa4d.identity import Identity
from aa4d.reports.page import Links, Section, Text, html_of
from aa4d.reports.pictures import Detail

# From the most to the least that a page holds; the first that fits is taken.
DETAILS = (
    Detail(1280, 88, 8, 960),
    Detail(1280, 82, 4, 960),
    Detail(960, 80, 3, 800),
    Detail(800, 75, 2, 640),
    Detail(640, 70, 1, 480),
    Detail(320, 60, 1, 320),
)


@dataclass(frozen=True)
class Page:
    """What is to be written; its pictures are made as large as the file may be."""

    title: str
    lead: str
    made_from: dict[str, str]  # digests by what they are of
    sections: Callable[[Detail], list[Section]]
    links: tuple[Links, ...] = ()  # to files of the folder, for a page that lies in it


def links_to(folder: Path, names: Sequence[str]) -> tuple[Links, ...]:
    """To those files that are there."""
    there = tuple((name, quote(name)) for name in names if (folder / name).is_file())
    return (Links(there),) if there else ()


def fitted(
    page: Page, notes: Sequence[str], identity: Identity, megabytes: float, *, is_beside: bool, out: Path
) -> str:
    size = 0.0
    for detail in DETAILS:
        sections = page.sections(detail)
        sections.insert(0, Section("", [Text(note, "warning") for note in notes]))  # known by now
        if is_beside:
            sections.append(Section("Files beside this page", page.links))
        reduced = "" if detail is DETAILS[0] else _reduced(detail, megabytes)
        html = html_of(page.title, sections, lead=page.lead, identity=identity, reduced=reduced)
        size = len(html.encode("utf-8")) / 1e6
        if size <= megabytes:
            return html
    raise InputError(f"{out}: cannot be smaller than {size:.2f} MB; give --megabytes {size + 0.01:.2f} or more")


def _reduced(detail: Detail, megabytes: float) -> str:
    frames = "one frame" if detail.views == 1 else f"{detail.views} frames"
    return (
        f"To stay below {megabytes:g} MB, pictures are {detail.longest_px} pixels wide at most, sliders show {frames} "
        f"of a capture at most, loops are {detail.loop_px} pixels wide."
    )
