"""How finely an exported page rounds its Gaussians."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from aa4d.cost.inputs import no_capture
from aa4d.cost.kind import cost_task
from aa4d.cost.models import usual_run
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.graph.call import Call

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
VIEWS = 6
BYTES = "bytes a Gaussian and key"  # what coarser steps save; seconds hardly change


def measure(call: Call) -> dict[str, Any]:
    """Of each coarseness: seconds and bytes of the packed keys, and PSNR of what they draw against the model's own."""
    import statistics
    import zlib

    import numpy as np

    from aa4d.cost.models import clip_of, drawn
    from aa4d.cost.stopwatch import least
    from aa4d.evaluation.image_metrics import capped, psnr
    from aa4d.export.html_page import Attribute, attributes_of, packed_keys, rounded
    from aa4d.export.keys import decoded, drawn_ids

    clip = clip_of(call.needs[0].folder, VIEWS)
    ids = drawn_ids(clip, lambda _: None)
    keys = [{name: values[name][ids] for name in values} for values in decoded(clip)]
    exact = [drawn(clip, index, values) for index, values in enumerate(keys)]
    rows = []
    for number, factor in enumerate(FACTORS):
        attributes = {
            name: replace(attribute, step=attribute.step * factor, levels=max(1, round(attribute.levels / factor)))
            for name, attribute in attributes_of(clip).items()
        }
        found: dict[str, Any] = {}

        def pack(of: dict[str, Attribute] = attributes, found: dict[str, Any] = found) -> None:
            found["levels"] = {name: np.stack([rounded(k[name], a) for k in keys]) for name, a in of.items()}
            found["bytes"] = len(zlib.compress(b"".join(packed_keys(v)[0] for v in found["levels"].values()), 6))

        spent = least(pack, 2, warm_up=0)
        pictures = [
            drawn(clip, i, {name: found["levels"][name][i] * a.step for name, a in attributes.items()})
            for i in range(len(clip))
        ]
        decibels = [capped(psnr(ours, theirs)) for ours, theirs in zip(pictures, exact, strict=True)]
        rows.append(
            {
                "factor": factor,
                "processor_s": spent.processor_seconds / len(clip),
                "wall_s": spent.seconds / len(clip),
                "psnr": statistics.fmean(decibels),
                "bytes": found["bytes"] / len(clip),
            }
        )
        call.advance(number + 1, len(FACTORS))
    return {"rows": rows, "gaussians": len(ids)}


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            f"{row['factor']:g} times",
            row["processor_s"],
            row["wall_s"],
            row["psnr"],
            row["factor"] == 1,
            more={BYTES: row["bytes"] / result["gaussians"]},
        )
        for row in result["rows"]
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(cost_task(__name__, "quantization", {}, (usual_run(setup),), seconds=10), points),)


PANEL = Panel(
    title="Export: quantization",
    varied="The steps that `aa4d export --format html` rounds to, in times those of the format, which is the default.",
    measured=f"Rounding, packing and deflating {VIEWS} keys of the trained model; PSNR of the pictures drawn from what "
    "is left against those drawn from all digits.",
    per="key",
    quality=Quality("PSNR against all digits", "dB", 1),
    measurements=measurements,
    missing=no_capture,
    across=BYTES,
)
