"""Splats of one instant in glTF, SPZ and SOG, read back by programs that others wrote, with the error of rounding."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from numpy.typing import NDArray
from plyfile import PlyData
from scipy.spatial import KDTree

from aa4d.errors import InputError
from aa4d.export import export
from aa4d.export.clip import Y_UP, Clip, WorldGaussians, mean_eye, turned
from aa4d.export.harmonics import SH_CONSTANT
from aa4d.filming.camera_path import only_time
from tests.toy_run import silent

NPM_PACKAGE = "@playcanvas/splat-transform"


@pytest.fixture(scope="module")
def instant(clip: Clip) -> Clip:
    """Of time 0.5, seen from the cameras' mean."""
    return replace(clip, path=only_time(clip.path, 0.5), eye=mean_eye(clip.path))


def only_file(folder: Path, ending: str) -> Path:
    [path] = folder.glob(f"*.{ending}")
    return path


@pytest.mark.parametrize("degree", [0, 2])
def test_gltf_is_read_back_exactly(instant: Clip, tmp_path: Path, degree: int) -> None:
    gltf = pytest.importorskip("fourdgs.gltf", reason="pip install aa4d[export]")
    clip = replace(instant, degree=degree)
    export(clip, "glb", tmp_path / "out", silent)
    read = gltf.from_gltf(str(only_file(tmp_path / "out", "glb")))
    assert read.metadata["coordinate_system"] == "y-up-right-handed"
    assert read.metadata["color_space"] == "srgb-rec709-display"
    g, splats = turned(clip.gaussians(0), Y_UP), read.gaussians
    np.testing.assert_allclose(splats.positions, g.means, atol=1e-4)
    np.testing.assert_allclose(splats.scales, g.scales, rtol=1e-6)
    np.testing.assert_allclose(np.abs((splats.rotations * g.quaternions[:, [1, 2, 3, 0]]).sum(1)), 1, atol=1e-6)
    np.testing.assert_allclose(splats.colors[:, 3], g.opacities, atol=1e-6)
    np.testing.assert_allclose(splats.colors[:, :3], np.clip(g.colors, 0, 1), atol=1e-6)
    assert splats.sh_degree == degree
    if degree:
        # That reader keeps harmonics in bytes, each channel's together.
        low, high = gltf.SH_QUANT_LO, gltf.SH_QUANT_HI
        found = (splats.sh / 255 * (high - low) + low).reshape(len(g.ids), 3, -1).swapaxes(1, 2)
        inside = np.clip(g.coefficients()[:, 1:], low, high)
        np.testing.assert_allclose(found, inside, atol=0.51 * (high - low) / 255)


def gltf_document(path: Path) -> dict:
    data = path.read_bytes()
    assert int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    assert (length % 4, len(data) % 4) == (0, 0)
    document: dict = json.loads(data[20 : 20 + length])
    return document


def test_gltf_says_where_on_earth_and_what_it_was_made_from(
    instant: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    origin = {"latitude_deg": 52.5, "longitude_deg": 13.4, "altitude_m": 34.0}
    monkeypatch.setattr("aa4d.export.origin.geographic_origin", lambda _loaded: origin)
    export(instant, "glb", tmp_path / "glb", silent)
    document = gltf_document(only_file(tmp_path / "glb", "glb"))
    extras = document["asset"]["extras"]
    assert extras["geographicOrigin"] == origin
    assert extras["t"] == 0.5
    identity = json.loads((tmp_path / "glb/export.json").read_text())["identity"]
    assert extras["aa4d"] == identity
    [primitive] = document["meshes"][0]["primitives"]
    assert (primitive["mode"], document["extensionsUsed"]) == (0, ["KHR_gaussian_splatting"])
    sizes = {document["accessors"][index]["count"] for index in primitive["attributes"].values()}
    assert sizes == {len(instant.gaussians(0).ids)}

    pytest.importorskip("gaussforge", reason="pip install aa4d[export]")
    export(instant, "sog", tmp_path / "sog", silent)
    with ZipFile(only_file(tmp_path / "sog", "sog")) as archive:
        about = json.loads(archive.read("aa4d.json"))
        assert {"meta.json", "means_l.webp", "sh0.webp"} <= set(archive.namelist())
    assert about["geographic_origin"] == origin
    assert about["identity"]["made_from"] == {"model": instant.loaded.identity.digest()}


def splats_of_ply(path: Path) -> WorldGaussians:
    vertex = PlyData.read(str(path))["vertex"].data

    def columns(*names: str) -> NDArray[np.float64]:
        return np.stack([vertex[name] for name in names], axis=1).astype(float)

    rest = [name for name in vertex.dtype.names if name.startswith("f_rest")]
    return WorldGaussians(
        ids=np.arange(len(vertex)),
        means=columns("x", "y", "z"),
        quaternions=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        scales=np.exp(columns("scale_0", "scale_1", "scale_2")),
        opacities=1 / (1 + np.exp(-columns("opacity")[:, 0])),
        colors=0.5 + SH_CONSTANT * columns("f_dc_0", "f_dc_1", "f_dc_2"),
        harmonics=columns(*rest).reshape(len(vertex), 3, -1).swapaxes(1, 2) if rest else None,
    )


def covariances(g: WorldGaussians) -> NDArray[np.float64]:
    """[N, 3, 3] square metres: readers may flip a Gaussian's own axes, which changes nothing that is drawn."""
    from scipy.spatial.transform import Rotation

    axes = Rotation.from_quat(g.quaternions[:, [1, 2, 3, 0]]).as_matrix() * g.scales[:, None]
    return axes @ axes.swapaxes(1, 2)


# Metres, of the color's range, of opacity, of the largest standard deviation: what rounding costs at most.
BOUNDS = {"spz": (0.0003, 0.004, 0.0021, 0.05), "sog": (0.02, 0.02, 0.0021, 0.1)}


@pytest.mark.parametrize("name", ["spz", "sog"])
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.slow
def test_a_program_of_others_reads_small_splats(instant: Clip, tmp_path: Path, name: str, degree: int) -> None:
    """PlayCanvas's splat-transform makes a PLY of them, whose y is down."""
    pytest.importorskip("gaussforge", reason="pip install aa4d[export]")
    npx = shutil.which("npx")
    if npx is None:
        pytest.skip("npx, of node, is not installed")
    command = [npx, "--yes", NPM_PACKAGE]
    if subprocess.run([*command, "--version"], capture_output=True, timeout=300).returncode:
        pytest.skip(f"the npm package {NPM_PACKAGE} cannot be had")
    clip = replace(instant, axes="world" if name == "spz" else "viewer", degree=degree)
    export(clip, name, tmp_path / "out", silent)
    file, read = only_file(tmp_path / "out", name), tmp_path / "read.ply"
    subprocess.run([*command, "-q", str(file), str(read)], check=True, timeout=300, capture_output=True)
    compare(splats_of_ply(read), replace(clip, axes="viewer").gaussians(0), *BOUNDS[name])


def compare(
    found: WorldGaussians, g: WorldGaussians, place: float, color: float, opacity: float, extent: float
) -> None:
    """SOG sorts the splats: they are matched by all that they are."""
    assert len(found.ids) == len(g.ids)

    def features(s: WorldGaussians) -> NDArray[np.float64]:
        return np.concatenate([s.means, s.colors, s.opacities[:, None], np.log(np.maximum(s.scales, 1e-4)) / 4], axis=1)

    _, row = KDTree(features(found)).query(features(g))
    assert len(np.unique(row)) == len(row)
    assert np.abs(found.means[row] - g.means).max() < place
    assert np.abs(found.colors[row] - g.colors).max() < color
    assert np.abs(found.opacities[row] - g.opacities).max() < opacity
    off = np.abs(covariances(found)[row] - covariances(g)).max(axis=(1, 2)) / (g.scales.max(axis=1) ** 2)
    assert off.max() < 2 * extent
    assert (found.harmonics is None) == (g.harmonics is None)
    if found.harmonics is not None and g.harmonics is not None:
        assert np.abs(found.harmonics[row] - g.harmonics).max() < 0.1


def test_what_spz_cannot_hold_is_refused(instant: Clip) -> None:
    """The library would write a place modulo 4096 m, and a size cut off."""
    splat_spz = pytest.importorskip("aa4d.export.splat_spz", reason="pip install aa4d[export]")
    g = instant.gaussians(0)
    splat_spz.check_it_fits(g)
    far, large = g.means.copy(), g.scales.copy()
    far[3, 1], large[3, 1] = -2100, 400
    with pytest.raises(InputError, match="a place of at most 2,047 m, and one is 2,100 m"):
        splat_spz.check_it_fits(replace(g, means=far))
    with pytest.raises(InputError, match="a size of at most 379 m, and one is 400 m"):
        splat_spz.check_it_fits(replace(g, scales=large))


@pytest.mark.parametrize("name", ["glb", "spz", "sog"])
def test_a_view_that_shows_nothing_is_refused(
    instant: Clip, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name != "glb":
        pytest.importorskip("gaussforge", reason="pip install aa4d[export]")
    monkeypatch.setattr("aa4d.export.clip.FAINTEST", 2.0)
    with pytest.raises(InputError, match="nothing is drawn in the view"):
        export(instant, name, tmp_path / "out", silent)
    assert not list((tmp_path / "out").glob(f"*.{name}"))


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_small_splats_are_a_fraction_of_the_ply(instant: Clip, tmp_path: Path, name: str) -> None:
    """Read back by the library that wrote them: axes, order of the columns and metres."""
    gaussforge = pytest.importorskip("gaussforge", reason="pip install aa4d[export]")
    clip = replace(instant, degree=1)
    for each in (name, "ply"):
        export(clip, each, tmp_path / each, silent)
    file, ply = only_file(tmp_path / name, name), only_file(tmp_path / "ply", "ply")
    forge = gaussforge.GaussForge()
    read = forge.write(forge.read(file.read_bytes(), name)["data"], "ply")
    (tmp_path / "read.ply").write_bytes(bytes(read["data"]))
    found = splats_of_ply(tmp_path / "read.ply")
    compare(turned(found, Y_UP.inv()) if name == "spz" else found, clip.gaussians(0), *BOUNDS[name])
    if name == "spz":
        assert file.stat().st_size < 0.3 * ply.stat().st_size
