"""What the export formats cost: size of the files, what rounding changes, and the picture that is left.

    python -m aa4d.experiments.export_rounding RUN --out DIR

Of one instant, seen from the mean of the cameras, in the formats of one instant, with and without harmonics: read back,
and drawn as each held-out camera sees that instant, against the model's own picture from there. Of the whole clip, in
the formats with time: sizes, and the errors that the files state. The exports stay in DIR.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from plyfile import PlyData
from safetensors import safe_open
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from tyro.conf import Positional, arg

from aa4d.errors import InputError
from aa4d.experiments.program import TABLE, run_as_program
from aa4d.export import export, harmonics
from aa4d.export.clip import Y_UP, Clip, WorldGaussians, mean_eye, turned, world_gaussians
from aa4d.export.html_page import attributes_of
from aa4d.files import make_folder, write_json
from aa4d.filming.camera_path import View, only_time, path_of_frames
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians

DEGREES = (0, 1, 3)
NEAR_M = 0.2
VISIBLE_M = 1e-3  # of a size whose rounding counts
SAME_SHARE = 0.999  # of the splats that must be found again
Picture = NDArray[np.float32]
# Quaternions of half turns about a Gaussian's own axes, which change nothing that is drawn.
FLIPS = np.eye(4)


def of_one_instant(loaded: LoadedModel, out: Path, t: float) -> list[dict[str, Any]]:
    """A row for each format of one instant and each degree."""
    path = path_of_frames(loaded, "all")
    views = [View(view.name, t, view.viewmat) for view in path_of_frames(loaded, "held-out").views]
    truth = [drawn_picture(loaded, world_gaussians(loaded, t, view.center()), view) for view in views]
    rows = []
    for degree in DEGREES:
        clip = Clip(loaded, only_time(path, t), mean_eye(path), degree=degree)
        gaussians, colors = clip.gaussians(0), clip.color_errors(0)["fitted"]
        for name in ("ply", "glb", "spz", "sog"):
            started, folder = time.process_time(), out / f"{name}-{degree}"
            export(clip, name, folder, lambda *_: None)
            row: dict[str, Any] = {
                "format": name,
                "views": 1,
                "harmonics": degree,
                "splats": len(gaussians.ids),
                "mb": size_of(folder, name) / 1e6,
                "color_error": colors,
                "cpu_s": time.process_time() - started,
            }
            if name != "glb":  # float32 as in the PLY, and no reader of others keeps its harmonics unrounded
                found = read_back(next(folder.glob(f"*.{name}")))
                pictures = [drawn_picture(loaded, found, view) for view in views]
                row["psnr"] = float(np.mean([psnr(*pair) for pair in zip(pictures, truth, strict=True)]))
                row |= rounding(found, gaussians)
            rows.append(row)
            print(row, flush=True)
    return rows


def of_the_clip(loaded: LoadedModel, out: Path) -> list[dict[str, Any]]:
    """A row for each format with time, of all frames as each of them sees the scene."""
    clip, rows = Clip(loaded, path_of_frames(loaded, "all"), None), []
    for name, ending in (("track", "safetensors"), ("html", "html"), ("usd", "usdc"), ("4dgs", "4dgs")):
        started, folder = time.process_time(), out / f"clip-{name}"
        export(clip, name, folder, lambda *_: None)
        row = {"format": name, "views": len(clip), "harmonics": 0, "mb": size_of(folder, ending) / 1e6}
        row["cpu_s"] = time.process_time() - started
        [file] = folder.glob(f"*.{ending}")
        rows.append(row | stated(name, file, clip))
        print(rows[-1], flush=True)
    return rows


def stated(name: str, file: Path, clip: Clip) -> dict[str, float]:
    """By how much a file with time is off at most, as it or its exporter says; USD holds float32."""
    if name == "track":
        with safe_open(str(file), framework="np") as track:
            return errors_of(json.loads(track.metadata()["aa4d"])["errors"])
    if name == "html":
        half = {key: attribute.step / 2 for key, attribute in attributes_of(clip).items()}
        return errors_of(half)
    if name == "4dgs":
        import fourdgs

        return {"place_mm": 1e3 * float(fourdgs.read(str(file)).quantization.bounds["pos"])}
    return {}


def errors_of(off: Mapping[str, float]) -> dict[str, float]:
    """The row of errors by attribute, as the track file and the page's header name them."""
    turn = 2 * np.arcsin(min(2 * off["rotation"], 1.0))  # each of a quaternion's components may be off by so much
    return {
        "place_mm": 1e3 * off["position"],
        "size_percent": 100 * float(np.expm1(off["log_scale"])),
        "rotation_deg": float(np.degrees(turn)),
        "opacity": off["opacity"],
        "color": off["color"],
    }


def size_of(folder: Path, ending: str) -> int:
    """Bytes of the export's files."""
    return sum(file.stat().st_size for file in folder.glob(f"*.{ending}"))


def read_back(file: Path) -> WorldGaussians:
    """The splats of a file in the world's axes: SPZ and SOG as GaussForge makes a PLY of them.

    Raises:
        InputError: it cannot.
    """
    ply = file.read_bytes()
    if file.suffix != ".ply":
        import gaussforge

        converted = gaussforge.GaussForge().convert(ply, file.suffix[1:], "ply")
        if "error" in converted:
            raise InputError(f"{file}: GaussForge says: {converted['error']}")
        ply = bytes(converted["data"])
    vertex = PlyData.read(BytesIO(ply))["vertex"].data

    def columns(*names: str) -> NDArray[np.float64]:
        return np.stack([vertex[name] for name in names], axis=1).astype(float)

    rest = [name for name in vertex.dtype.names if name.startswith("f_rest")]
    gaussians = WorldGaussians(
        ids=np.arange(len(vertex)),
        means=columns("x", "y", "z"),
        quaternions=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        scales=np.exp(columns("scale_0", "scale_1", "scale_2")),
        opacities=1 / (1 + np.exp(-columns("opacity")[:, 0])),
        colors=0.5 + harmonics.SH_CONSTANT * columns("f_dc_0", "f_dc_1", "f_dc_2"),
        harmonics=columns(*rest).reshape(len(vertex), 3, -1).swapaxes(1, 2) if rest else None,
    )
    return turned(gaussians, Y_UP.inv()) if file.suffix == ".spz" else gaussians


def rounding(found: WorldGaussians, gaussians: WorldGaussians) -> dict[str, float]:
    """By how much the splats of a file are off at most; matched by all that they are, since SOG sorts them.

    Raises:
        InputError: they are not the same splats.
    """

    def features(g: WorldGaussians) -> NDArray[np.float64]:
        sizes = np.log(np.maximum(g.scales, 1e-9)) / 2
        return np.concatenate([g.means, sizes, 2 * g.colors, g.opacities[:, None]], axis=1)

    _, row = KDTree(features(found)).query(features(gaussians))
    if len(np.unique(row)) < SAME_SHARE * len(gaussians.ids) or len(found.ids) != len(gaussians.ids):
        raise InputError("the splats of a file are not those that were written; its rounding is not known")
    columns = (found.means, found.scales, found.quaternions, found.opacities, found.colors)
    means, scales, quaternions, opacities, colors = (column[row] for column in columns)
    grown = np.abs(np.log(scales / gaussians.scales))[gaussians.scales > VISIBLE_M]
    own = Rotation.from_quat(gaussians.quaternions, scalar_first=True)
    turns = [own * Rotation.from_quat(flip, scalar_first=True) for flip in FLIPS]
    angles = [(Rotation.from_quat(quaternions, scalar_first=True).inv() * turn).magnitude() for turn in turns]
    row_of = {
        "place_mm": 1e3 * float(np.abs(means - gaussians.means).max()),
        "size_percent": 100 * float(np.expm1(grown.max(initial=0))),
        "rotation_deg": float(np.degrees(np.min(angles, axis=0).max())),
        "opacity": float(np.abs(opacities - gaussians.opacities).max()),
        "color": float(np.abs(colors - gaussians.colors).max()),
    }
    if found.harmonics is not None and gaussians.harmonics is not None:
        row_of["harmonics_off"] = float(np.abs(found.harmonics[row] - gaussians.harmonics).max())
    return row_of


def drawn_picture(loaded: LoadedModel, gaussians: WorldGaussians, view: View) -> Picture:
    """[H, W, 3] sRGB, as a view's own camera sees splats with the colors of their harmonics."""
    lens = loaded.camera
    colors = harmonics.shown(gaussians.coefficients(), harmonics.directions_from(view.center()[None], gaussians.means))[
        :, 0
    ]
    columns = (gaussians.means, gaussians.quaternions, gaussians.scales, gaussians.opacities, colors)
    splats = Gaussians(*(torch.from_numpy(np.ascontiguousarray(column)).float() for column in columns))
    K, viewmat = (torch.from_numpy(matrix).float() for matrix in (lens.K, view.viewmat))
    camera = Camera(viewmat, K, lens.width, lens.height, near=NEAR_M)
    with torch.no_grad():
        shown: Picture = rasterize(splats, camera, background=torch.tensor(loaded.background)).color.numpy()
    return shown


def psnr(first: Picture, second: Picture) -> float:
    """Decibels; 99 where they are the same."""
    error = float(np.mean((first.astype(float) - second) ** 2))
    return min(-10 * float(np.log10(max(error, 1e-12))), 99.0)


def main(
    run: Annotated[Positional[Path], arg(help="A trained run.")],
    out: Annotated[Path, arg(help=f"Folder for the exports and {TABLE}.")],
    t: Annotated[float, arg(help="The instant, 0 to 1.")] = 0.5,
) -> None:
    loaded = load_model(run / "model.safetensors")
    make_folder(out)
    rows = list(itertools.chain(of_one_instant(loaded, out, t), of_the_clip(loaded, out)))
    write_json(out / TABLE, {"rows": rows})


if __name__ == "__main__":
    run_as_program(main)
