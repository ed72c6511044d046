"""The measurement of what export formats cost."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.errors import InputError
from aa4d.experiments.export_rounding import errors_of, of_one_instant, rounding
from aa4d.export.clip import Clip
from aa4d.methods.model_file import LoadedModel


def test_rounding_is_found_whatever_the_order(clip: Clip) -> None:
    g = clip.gaussians(0)
    order = np.random.default_rng(1).permutation(len(g.ids))
    quaternions = g.quaternions[order] * [1, -1, -1, -1]  # flipped below
    turned = np.stack([-quaternions[:, 1], quaternions[:, 0], -quaternions[:, 3], quaternions[:, 2]], axis=1)
    found = replace(
        g,
        means=g.means[order] + [0, 0.002, 0],
        scales=g.scales[order] * 1.03,
        quaternions=turned * [1, -1, -1, -1],
        opacities=g.opacities[order],
        colors=g.colors[order] - 0.01,
    )
    off = rounding(found, g)
    assert off["place_mm"] == pytest.approx(2)
    assert off["size_percent"] == pytest.approx(3)
    assert off["rotation_deg"] == pytest.approx(0, abs=1e-5)
    assert (off["opacity"], off["color"]) == (0, pytest.approx(0.01))
    short = {
        name: getattr(found, name)[1:] for name in ("ids", "means", "scales", "quaternions", "opacities", "colors")
    }
    with pytest.raises(InputError, match="not those that were written"):
        rounding(replace(found, **short), g)


def test_errors_of_a_file_are_told_in_what_a_person_knows() -> None:
    off = errors_of({"position": 0.005, "rotation": 0.005, "log_scale": 0.01, "opacity": 0.002, "color": 0.003})
    assert off["place_mm"] == 5
    assert off["size_percent"] == pytest.approx(1.005, abs=1e-3)
    assert off["rotation_deg"] == pytest.approx(1.146, abs=1e-3)


def test_every_format_of_one_instant_has_a_row(loaded: LoadedModel, tmp_path: Path) -> None:
    pytest.importorskip("gaussforge", reason="pip install aa4d[export]")
    rows = of_one_instant(loaded, tmp_path, 0.5)
    assert [(row["format"], row["harmonics"]) for row in rows[:5]] == [
        *((name, 0) for name in ("ply", "glb", "spz", "sog")),
        ("ply", 1),
    ]
    ply, _, spz, sog = rows[:4]
    assert ply["place_mm"] < 0.01 < spz["place_mm"] < sog["place_mm"]
    assert spz["psnr"] < ply["psnr"] + 0.5
    assert min(row["psnr"] for row in rows if "psnr" in row) > 20
    assert rows[4]["mb"] > ply["mb"] > spz["mb"]
