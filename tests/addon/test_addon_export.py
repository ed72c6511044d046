"""Out again from the packaged extension: splats and USD points."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, go_to, imported, played, srgb

FRAMES = 5


def read_ply(path: Path) -> dict[str, np.ndarray]:
    header, data = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[2] for line in header.decode().splitlines() if line.startswith("property float")]
    rows = np.frombuffer(data, "<f4").reshape(-1, len(names))
    assert f"element vertex {len(rows)}" in header.decode()
    return dict(zip(names, rows.T, strict=True))


@pytest.mark.parametrize("baked", [False, True])
def test_splats_go_out_as_they_are_shown(bpy: Any, model_path: Path, tmp_path: Path, baked: bool) -> None:
    obj = imported(bpy, model_path, carrier="GAUSSIANS", bake=baked)
    go_to(bpy, 3)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "one.ply")) == {"FINISHED"}
    now = played(bpy, obj)
    seen = now["aa_opacity"] >= 0.05
    ply = read_ply(tmp_path / "one.ply")
    np.testing.assert_allclose(np.stack([ply[a] for a in "xyz"], 1), now["position"][seen], atol=1e-5)
    color = 0.5 + 0.28209479177387814 * np.stack([ply[f"f_dc_{i}"] for i in range(3)], 1)
    np.testing.assert_allclose(color, srgb(now["aa_color"][seen, :3]), atol=1e-3)
    np.testing.assert_allclose(1 / (1 + np.exp(-ply["opacity"])), now["aa_opacity"][seen], atol=1e-3)
    scales = np.exp(np.stack([ply[f"scale_{i}"] for i in range(3)], 1))
    np.testing.assert_allclose(scales, now["aa_scale"][seen], rtol=1e-4)
    rotations = np.stack([ply[f"rot_{i}"] for i in range(4)], 1)
    np.testing.assert_allclose(rotations, now["aa_rotation"][seen], atol=1e-5)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "many.ply"), use_range=True) == {"FINISHED"}
    assert len(list(tmp_path.glob("many_000?.ply"))) == FRAMES
    assert (tmp_path / "many_0003.ply").read_bytes() == (tmp_path / "one.ply").read_bytes()
    assert bpy.context.scene.frame_current == 3
    with pytest.raises(RuntimeError, match="No such file"):
        bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "missing" / "one.ply"))
    for name in ("", "folder.ply", "one.png"):
        (tmp_path / "folder.ply").mkdir(exist_ok=True)
        for export in (bpy.ops.aa4d.export_ply, bpy.ops.aa4d.export_usd):
            with pytest.raises(RuntimeError, match=r"^Error: [^\n]*name[^\n]*\s*$"):
                export(filepath=str(tmp_path / name) if name else "")
    assert not list(tmp_path.glob(".*"))


def test_usd_points_move(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 3])
    opacity = [attribute(obj.data, "aa_opacity")]
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        opacity.append(attribute(obj.data, "aa_opacity"))
    seen = np.max(opacity, axis=0) >= 0.05
    count = len(bpy.data.objects)
    path = tmp_path / "points.usdc"
    assert bpy.ops.aa4d.export_usd(filepath=str(path), use_range=True) == {"FINISHED"}
    assert len(bpy.data.objects) == count
    assert bpy.context.active_object == obj
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == (1, FRAMES)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(path))
    cloud = next(o for o in bpy.data.objects if o.type == "POINTCLOUD")
    for frame, positions in zip((1, 4), expected, strict=True):
        go_to(bpy, frame)
        data = cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        matrix = np.array(cloud.matrix_world)
        places = attribute(data, "position") @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(places, positions[seen], atol=1e-3)
