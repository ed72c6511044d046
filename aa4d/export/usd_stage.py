"""What the USD files share: a stage in metres with z up, on the clip's own clock, written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pxr import Usd, UsdGeom

from aa4d.export.clip import Clip
from aa4d.files import whole_file


@contextmanager
def stage_of(clip: Clip, path: Path) -> Iterator[tuple[Any, list[float]]]:
    """The stage, whose default prim is /AdaAnchor4D, and the time code of each view; whoever takes it lets go of it."""
    codes = [round(clip.seconds(index) * clip.path.fps, 6) for index in range(len(clip))]
    with whole_file(path) as temporary:
        temporary.unlink()  # USD makes its file itself
        stage = Usd.Stage.CreateNew(str(temporary))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(clip.path.fps)
        stage.SetFramesPerSecond(clip.path.fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(codes[-1])
        named = {} if clip.identity is None else {"aa4d": clip.identity.as_text()}
        placed = {} if clip.origin is None else {"geographicOrigin": dict(clip.origin)}
        stage.GetRootLayer().customLayerData = named | placed
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/AdaAnchor4D").GetPrim())
        yield stage, codes
        stage.GetRootLayer().Save()
