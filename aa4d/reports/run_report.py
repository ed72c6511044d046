"""The report of a run: scores, held-out frames, where moving pixels are worst, history, settings, identity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from aa4d.commands.evaluate import metrics_table, not_measured
from aa4d.errors import InputError
from aa4d.identity import identity_of
from aa4d.inspection.history import Row as HistoryRow
from aa4d.methods import DEFAULT, METHODS, title_of
from aa4d.reports.fitting import Page, links_to
from aa4d.reports.frames import Drawn, frame_sections
from aa4d.reports.page import Code, Column, Part, Pictures, Section, Table, Text
from aa4d.reports.pictures import Detail, picture_of
from aa4d.reports.plot import Plot, Series
from aa4d.reports.scored import METRICS, Captures, ScoredRun, scored_run
from aa4d.words import counted

LINKED = ("settings.toml", METRICS, "history.csv", "inspect/index.html", "page/scene.html")


def run_page(folder: Path, captures: Captures) -> Page:
    """Raises InputError where the run has not been scored, or a file of it is damaged."""
    run = scored_run(folder)
    capture = captures.of(run)
    made_from = {"evaluation": run.digest} | ({} if capture is None else {"capture": capture.identity.digest()})
    description = run.description()
    title = _title(folder.resolve(), description)
    first = [Section("Scores", _scores(run)), *_plots(run)]
    last = [_every_frame(run), _settings(run, description), _identity(run, made_from)]

    if note := run.missing():
        captures.tell(note)

    def sections(detail: Detail) -> list[Section]:
        frames = frame_sections("Held-out frames", capture, [Drawn("render", run)], detail)
        return [*first[:1], *frames, *first[1:], *_motion(run, detail), *last]

    return Page(title, _lead(run, description), made_from, sections, links_to(folder, LINKED))


def name_of(run: ScoredRun, description: dict[str, Any]) -> str:
    """Its method as publications call it; with tracks, where its anchors ride on them."""
    method = run.metrics.get("method", description.get("method", DEFAULT))
    title = title_of(method) if method in METHODS else str(method)
    training = description.get("training")
    return f"{title} + tracks" if isinstance(training, dict) and training.get("motion") else title


def _title(folder: Path, description: dict[str, Any]) -> str:
    """A run's folder by its name; one of an experiment, which is called after its seed alone, as tables call it."""
    training, capture = description.get("training"), description.get("capture")
    if isinstance(training, dict) and isinstance(capture, str):
        variant, name, seed = folder.parent.name, Path(capture).name, training.get("seed")
        if folder.name == f"seed{seed}" and folder.parent.parent.name == name:
            return f"{name}, {variant}, seed {seed}"
    return f"Run {folder.name}"


def _lead(run: ScoredRun, description: dict[str, Any]) -> str:
    said = [name_of(run, description)]
    training = description.get("training")
    if isinstance(training, dict):
        coarse, fine, seed = (training.get(key) for key in ("coarse_iterations", "fine_iterations", "seed"))
        said.append(f"preset {training.get('preset')}, {coarse} + {fine} iterations, seed {seed}")
    if isinstance(description.get("capture"), str):
        said.append(f"trained on {Path(description['capture']).name}")
    said.append(f"scored on {counted(len(run.frames), 'frame')} that training never saw")
    return "; ".join(said) + "."


def _scores(run: ScoredRun) -> list[Part]:
    """What `aa4d eval` prints."""
    try:
        printed, reasons = metrics_table(run.metrics), not_measured(run.metrics)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(
            f"{run.folder / METRICS}: is damaged or of an older version ({error}); run `aa4d eval {run.trained}` again"
        ) from None
    columns = [Column(str(column.header), is_number=n > 0) for n, column in enumerate(printed.columns)]
    cells = [[str(cell) for cell in column.cells] for column in printed.columns]
    table = Table(columns, [list(row) for row in zip(*cells, strict=True)], sorts=False)
    return [table, *(Text(reason, "note") for reason in reasons)]


def _plots(run: ScoredRun) -> list[Section]:
    keys = (("psnr", "whole image"), ("psnr_still", "still pixels"), ("psnr_dynamic", "moving pixels"))
    series = [Series("training frames", _points(run.metrics.get("training_frames"), "psnr"), faint=True)]
    series += [Series(f"held-out, {name}", _points(run.frames, key), line=True) for key, name in keys]
    series.append(
        Series(
            "moving pixels, coarse stage", _points(run.frames, "psnr_dynamic_static"), line=True, color=2, dashed=True
        )
    )
    over_time = Plot("PSNR over the clip", "t", "PSNR, dB", [s for s in series if s.points])
    history = run.history()
    return [
        Section(
            "Over the clip, and over training",
            [over_time, *([] if history is None else history_plots([("", history)]))],
        )
    ]


def _points(frames: Any, key: str) -> list[tuple[float, float]]:
    """Of frames that have the score; what is malformed is left out."""
    found = [(f.get("t"), f.get(key)) for f in frames if isinstance(f, dict)] if isinstance(frames, list) else []
    return [(t, v) for t, v in found if isinstance(t, int | float) and isinstance(v, int | float)]


def history_plots(histories: Sequence[tuple[str, list[HistoryRow]]], where: str = "") -> list[Plot]:
    """PSNR of training views and the number of units over the iterations, a line for each name."""
    rows = histories[0][1]
    steps = (
        [(float(b.step), f"{a.stage} stage") for b, a in pairwise(rows) if b.stage != a.stage]
        if len(histories) == 1
        else []
    )
    psnr, units = [], []
    for name, history in histories:
        seen = [(float(row.step), row.psnr_db if math.isfinite(row.psnr_db) else math.nan) for row in history]
        psnr.append(Series(name or "training views", seen, line=True, dots=False))
        units.append(
            Series(name or "units", [(float(row.step), float(row.anchors)) for row in history], line=True, dots=False)
        )
    return [
        Plot(f"PSNR of training views{where}", "iteration", "PSNR, dB", psnr, steps=steps),
        Plot(f"Units (anchors, or free Gaussians){where}", "iteration", "units", units, steps=steps),
    ]


def _motion(run: ScoredRun, detail: Detail) -> list[Section]:
    picture = run.drawn("motion")
    if picture is None:
        return []
    shown = picture_of(picture, detail, "true motion on the left, drawn motion on the right")
    note = (
        "The held-out frame with most moving pixels: true motion left, drawn motion right, without the camera's. Hue "
        "is direction, strength is speed, white stands still."
    )
    return [Section("Motion", [Pictures((shown,), 1)], note)]


def _every_frame(run: ScoredRun) -> Section:
    networks = list(dict.fromkeys(n for f in run.frames if isinstance(f.get("lpips"), dict) for n in f["lpips"]))
    columns = [
        Column("frame", is_number=False),
        Column("t", 3),
        Column("PSNR", 2, 1),
        Column("moving", 2, 1, "PSNR over moving pixels"),
        Column("moving, coarse", 2, 1, "PSNR over moving pixels, of the coarse stage"),
        Column("still", 2, 1, "PSNR over still pixels"),
        Column("SSIM", 4, 1),
        *(Column(f"LPIPS {network}", 4, -1) for network in networks),
        Column("moves, %", 2, 0, "share of pixels that move"),
    ]
    rows = []
    for f in run.frames:
        lpips = f["lpips"] if isinstance(f.get("lpips"), dict) else {}
        share = f.get("moving_share")
        rows.append(
            [
                *(
                    f.get(k)
                    for k in ("frame", "t", "psnr", "psnr_dynamic", "psnr_dynamic_static", "psnr_still", "ssim")
                ),
                *(lpips.get(network) for network in networks),
                None if share is None else 100 * share,
            ]
        )
    return Section("Every held-out frame", [Table(columns, rows)])


def _settings(run: ScoredRun, description: dict[str, Any]) -> Section:
    parts: list[Part] = settings_text(run.trained)
    if not parts and description:
        training = description.get("training")
        flat = flattened(training if isinstance(training, dict) else {})
        parts = [Table([Column("setting", is_number=False), Column("value", is_number=False)], flat)]
    return Section("Settings", parts or [Text("This run has no settings beside it.")], folded=True)


def settings_text(folder: Path) -> list[Part]:
    """The settings as a file that `--config` takes; nothing where a run has none."""
    try:
        text = (folder / "settings.toml").read_text(encoding="utf-8")
    except (OSError, ValueError):
        return []
    return [Code(text, "settings.toml")]


def flattened(table: dict[str, Any], before: str = "") -> list[list[str]]:
    """Keys with dots between them, and their values."""
    rows: list[list[str]] = []
    for key, value in table.items():
        rows += flattened(value, f"{before}{key}.") if isinstance(value, dict) else [[f"{before}{key}", str(value)]]
    return rows


def _identity(run: ScoredRun, made_from: dict[str, str]) -> Section:
    evaluation = identity_of(run.metrics.get("identity"))
    trained = identity_of(run.description().get("identity"))
    digests = {"run": trained.digest()} if trained is not None else {}
    digests |= dict(evaluation.made_from) if evaluation is not None else {}
    digests |= made_from
    rows = [[what, digest] for what, digest in digests.items()]
    columns = [Column("artifact", is_number=False), Column("identity (SHA-256)", is_number=False)]
    return Section("Identity", [Table(columns, rows, sorts=False)], folded=True)
