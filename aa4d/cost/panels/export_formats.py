"""What each export format takes."""

from __future__ import annotations

from typing import Any

from aa4d.cost.inputs import no_capture
from aa4d.cost.kind import cost_task
from aa4d.cost.models import usual_run
from aa4d.cost.panel import Measurement, Panel, Point, Setup
from aa4d.graph.call import Call

DEFAULT = "ply"  # of `aa4d export`
VIEWS = 6


def measure(call: Call) -> dict[str, Any]:
    """Seconds and bytes a view of each format whose package is here."""
    import importlib.util
    import shutil

    from aa4d.cost.models import clip_of
    from aa4d.export import EXPORTERS, export
    from aa4d.training.spent import Spent

    clip, rows = clip_of(call.needs[0].folder, VIEWS), []
    for number, (name, exporter) in enumerate(EXPORTERS.items()):
        if exporter.needs is None or importlib.util.find_spec(exporter.needs[0]) is not None:
            out = call.folder / name
            shutil.rmtree(out, ignore_errors=True)
            start = Spent.clocks()
            export(clip, name, out, lambda *_: None)
            spent = Spent.clocks().since(start)
            size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
            shutil.rmtree(out)
            rows.append(
                {
                    "format": name,
                    "processor_s": spent.processor_seconds / len(clip),
                    "wall_s": spent.seconds / len(clip),
                    "mib": size / len(clip) / 2**20,
                }
            )
        call.advance(number + 1, len(EXPORTERS))
    return {"rows": rows}


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            row["format"],
            row["processor_s"],
            row["wall_s"],
            None,
            row["format"] == DEFAULT,
            more={"MiB a view": row["mib"]},
        )
        for row in result["rows"]
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(cost_task(__name__, "formats", {}, (usual_run(setup),), seconds=15), points),)


PANEL = Panel(
    title="Export: formats",
    varied=f"The format (`--format`); by default {DEFAULT}. One whose package is not installed is not shown.",
    measured=f"{VIEWS} views of the trained model, decoding included. What a format keeps stands in docs/export.md.",
    per="view",
    quality=None,
    measurements=measurements,
    missing=no_capture,
)
