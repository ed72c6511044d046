"""`aa4d report`: what a folder holds becomes one HTML file, small enough to send."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import escape

from aa4d import __version__
from aa4d.errors import InputError
from aa4d.files import make_folder, write_text
from aa4d.identity import Identity, digest_of
from aa4d.reports.comparison_report import COMPARISON, comparison_page
from aa4d.reports.experiment_report import INDEX, experiment_page
from aa4d.reports.fitting import Page, fitted
from aa4d.reports.run_report import run_page
from aa4d.reports.scored import METRICS, Captures

NAME = "report.html"
PAGES = (".html", ".htm")  # endings of files that may be replaced
MEGABYTES = 10.0
HEAD_BYTES = 4096  # in which a page says what it was made from


@dataclass(frozen=True)
class Written:
    path: Path
    megabytes: float
    notes: tuple[str, ...]


def write_report(
    folder: Path,
    out: Path | None = None,
    *,
    captures: Sequence[Path] = (),
    megabytes: float = MEGABYTES,
    keep: bool = False,
) -> Written:
    """Write the page of a run, of an experiment (ablation, sweep) or of a comparison.

    Args:
        out: the file; None: report.html in the folder.
        captures: folders, where captures are not where their runs were trained.
        megabytes: of the file, at most; pictures are made smaller and fewer until it fits.
        keep: leave a page as it is that was made from the same.

    Raises:
        InputError: the folder is none of these or has nothing to show yet, a file in it is damaged, the page cannot be
            that small, or `out` is a file of another kind.
    """
    if not 0 < megabytes < float("inf"):
        raise InputError(f"--megabytes {megabytes:g}: must be a positive number")
    for capture in captures:
        if not (capture / "capture.json").is_file():
            raise InputError(f"--captures {capture}: no such capture folder; name one that holds a capture.json")
    path = out or folder / NAME
    if path.is_file() and path.suffix.lower() not in PAGES:
        raise InputError(
            f"--out {path}: is there and no page; name another file, for instance {path.with_suffix('.html')}"
        )
    found = Captures(captures)
    page = page_of(folder, found)
    identity = Identity("report", digest_of({"version": __version__, "megabytes": megabytes}), page.made_from)
    if keep and _is_of(path, identity):
        return Written(path, path.stat().st_size / 1e6, ())
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the file with --out, for instance {path / NAME}")
    html = fitted(page, found.notes, identity, megabytes, is_beside=path.resolve().parent == folder.resolve(), out=path)
    make_folder(path.parent)
    write_text(path, html)
    return Written(path, len(html.encode("utf-8")) / 1e6, tuple(found.notes))


def closing_line(folder: Path) -> str:
    """Write the report of an experiment that has just ended, and say so; where it cannot be, the experiment stands."""
    try:
        written = write_report(folder, keep=True)
    except InputError as error:
        return f"report: not written: {error}"
    return f"report: {written.path} ({written.megabytes:.1f} MB)"


def page_of(folder: Path, captures: Captures) -> Page:
    """Tell by its files what the folder is. Raises InputError where it is nothing that has a report."""
    if folder.is_file():
        raise InputError(f"{folder}: is a file; name the folder that holds it")
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name a run, an experiment or a comparison")
    if (folder / COMPARISON).exists():
        return comparison_page(folder, captures)
    if (folder / INDEX).exists():
        return experiment_page(folder, captures)
    if any((folder / name).exists() for name in (METRICS, "config.json", "model.safetensors")):
        return run_page(folder, captures)
    raise InputError(
        f"{folder}: neither a run of `aa4d train` nor what `aa4d ablate`, `sweep`, `experiment` or `compare` made; "
        "name such a folder"
    )


def _is_of(path: Path, identity: Identity) -> bool:
    """Whether a page says that it was made from the same by the same version."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8", "replace")
    except OSError:
        return False
    return f'content="{escape(identity.as_text())}"' in head
