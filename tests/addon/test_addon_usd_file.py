"""A USD file that was cut short is known."""

from pathlib import Path

import pytest

pytest.importorskip("pxr", reason="needs usd-core")

from addon.usd_file import is_whole


@pytest.mark.parametrize("ending", ["usdc", "usda"])
def test_a_file_cut_anywhere_is_not_whole(tmp_path: Path, ending: str) -> None:
    from pxr import Usd, UsdGeom

    path = tmp_path / f"points.{ending}"
    stage = Usd.Stage.CreateNew(str(path))
    points = UsdGeom.Points.Define(stage, "/points")
    for frame in range(3):
        points.CreatePointsAttr().Set([(float(i), 0.0, float(frame)) for i in range(500)], frame)
    stage.Save()
    del stage, points
    assert is_whole(path)
    content = path.read_bytes()
    cut = tmp_path / f"cut.{ending}"
    for length in {0, 7, 8, 23, 24, len(content) // 2, len(content) - 9, *range(0, len(content) - 2, 97)}:
        cut.write_bytes(content[:length])
        assert not is_whole(cut), length
