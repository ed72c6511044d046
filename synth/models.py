"""Models of the user's own that stand for a kind of road user: which file, checked and identified before Blender."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from synth.errors import InputError

FORMATS = (".glb", ".gltf", ".fbx", ".obj")


class Asset(Protocol):
    """A table `[[assets]]` of the scene."""

    @property
    def kind(self) -> str: ...
    @property
    def file(self) -> str: ...
    @property
    def yaw_deg(self) -> float: ...


@dataclass(frozen=True)
class Model:
    """A file that Blender imports; its content enters the plan by its SHA-256."""

    kind: str
    path: Path
    yaw_deg: float
    sha256: str


def find_models(assets: Sequence[Asset], folder: Path) -> tuple[Model, ...]:
    """Look the files up in the scene's folder.

    Raises:
        InputError: a file that is not there, lies elsewhere, or has a format that is not read; a kind given twice.
    """
    models: dict[str, Model] = {}
    for index, asset in enumerate(assets):
        where, path = f"assets[{index}]", folder / asset.file
        if ".." in Path(asset.file).parts or Path(asset.file).is_absolute():
            raise InputError(f"{where}.file: {asset.file!r} must lie in the scene's folder or below it.")
        if path.suffix.lower() not in FORMATS:
            raise InputError(f"{where}.file: {asset.file!r} must end in one of {', '.join(FORMATS)}.")
        if asset.kind in models:
            raise InputError(f"{where}.kind: {asset.kind!r} is given twice; give each kind once.")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"{where}.file: {path}: cannot read it: {error.strerror}.") from None
        models[asset.kind] = Model(asset.kind, path.resolve(), asset.yaw_deg, hashlib.sha256(content).hexdigest())
    return tuple(models.values())
