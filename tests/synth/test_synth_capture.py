"""What a render wrote: truth that agrees with itself, and exports that others read."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from synth.camera import OPENCV_TO_OPENGL, invert_rigid, pixel_centres, project, unproject
from synth.city.layout import WORN_HEIGHT_M
from synth.streets.ground import MARKING_HEIGHT_M, PATCH_HEIGHT_M
from synth.traffic.network import KERB_HEIGHT_M

Array = NDArray[np.float64]


class Reader:
    """A capture as arrays, by the words of docs/formats.md alone."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.index: dict[str, Any] = json.loads((root / "capture.json").read_text())
        self.K = np.array(self.index["camera"]["K"])
        self.viewmats = [np.array(frame["viewmat"]) for frame in self.index["frames"]]
        self.tracks = np.load(root / self.index["tracks"], allow_pickle=False)

    def truth(self, k: int) -> tuple[Array, NDArray[np.uint32]]:
        arrays = np.load(self.root / self.index["frames"][k]["truth"], allow_pickle=False)
        assert arrays["depth_z"].dtype == np.float32
        assert arrays["instance_id"].dtype == np.uint32
        return arrays["depth_z"].astype(np.float64), arrays["instance_id"]

    def surface(self, k: int) -> Array:
        """World points [H, W, 3] of a frame."""
        depth, _ = self.truth(k)
        height, width = depth.shape
        return unproject(pixel_centres(width, height), depth, self.viewmats[k], self.K)

    def fixed(self, k: int) -> NDArray[np.bool_]:
        """Pixels [H, W] of what does not move."""
        depth, ids = self.truth(k)
        moving = set(self.tracks["instance_id"][self.tracks["moving"][k]].tolist())
        return np.isfinite(depth) & ~np.isin(ids, list(moving))


@pytest.fixture(scope="module")
def reader(capture: Path) -> Reader:
    return Reader(capture)


def test_index_is_as_documented(reader: Reader) -> None:
    index = reader.index
    assert (index["format"], index["version"], index["name"]) == ("aa4d-capture", 1, "tiny")
    assert [frame["split"] for frame in index["frames"]] == ["test", *["train"] * 5]
    assert [frame["time_s"] for frame in index["frames"]] == [k / 2 for k in range(6)]
    assert [frame["t"] for frame in index["frames"]] == [k / 5 for k in range(6)]
    for frame in index["frames"]:
        with Image.open(reader.root / frame["image"]) as image:
            assert (image.size, image.mode) == ((96, 54), "RGB")
            assert np.asarray(image).std() > 20
    assert not list(reader.root.rglob("*.part"))


def round_trip(reader: Reader, a: int, b: int, K: Array) -> Array:
    """Pixels between a point's place in frame a and where it comes back to, over frame b's own depth.

    Only points that frame b sees, on surfaces that are flat there: the inverse of planar depth is affine across the
    image of a plane, so that its bilinear interpolation is exact.
    """
    depth_b, _ = reader.truth(b)
    height, width = depth_b.shape
    centres = pixel_centres(width, height)
    depth_a, _ = reader.truth(a)
    chosen = reader.fixed(a)
    points = unproject(centres[chosen], depth_a[chosen], reader.viewmats[a], K)
    uv, z = project(points, reader.viewmats[b], K)
    column, row = np.floor(uv[:, 0] - 0.5).astype(int), np.floor(uv[:, 1] - 0.5).astype(int)
    inside = (z > 0) & (column >= 1) & (column < width - 2) & (row >= 1) & (row < height - 2)
    uv, z, column, row = uv[inside], z[inside], column[inside], row[inside]
    start = centres[chosen][inside]

    patch = np.array([[1 / depth_b[row + i, column + j] for j in range(-1, 3)] for i in range(-1, 3)])  # [4, 4, P]
    bend = np.abs(np.concatenate([np.diff(patch, 2, axis=0).reshape(8, -1), np.diff(patch, 2, axis=1).reshape(8, -1)]))
    still = np.all([[reader.fixed(b)[row + i, column + j] for j in range(2)] for i in range(2)], axis=(0, 1))
    fx, fy = uv[:, 0] - 0.5 - column, uv[:, 1] - 0.5 - row
    near = (1 - fy) * ((1 - fx) * patch[1, 1] + fx * patch[1, 2]) + fy * ((1 - fx) * patch[2, 1] + fx * patch[2, 2])
    seen = (bend.max(axis=0) < 1e-6) & (np.abs(near * z - 1) < 0.02) & still
    back, _ = project(unproject(uv, 1 / near, reader.viewmats[b], K), reader.viewmats[a], K)
    return np.linalg.norm(back - start, axis=1)[seen]


@pytest.mark.parametrize(("a", "b"), [(0, 1), (1, 0), (0, 5), (4, 2)])
def test_fixed_points_reproject_within_a_twentieth_of_a_pixel(reader: Reader, a: int, b: int) -> None:
    errors = round_trip(reader, a, b, reader.K)
    assert len(errors) > 300
    assert np.percentile(errors, 99.5) < 0.05
    assert np.median(errors) < 0.005


def test_reprojection_finds_half_a_pixel_of_principal_point(reader: Reader) -> None:
    shifted = reader.K + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    assert np.percentile(round_trip(reader, 0, 5, shifted), 99.5) > 0.05


def test_depth_of_the_road_is_exact(reader: Reader) -> None:
    """The road is the plane z = 0, its markings lie 4 mm higher: depth in closed form."""
    for k in range(6):
        depth, ids = reader.truth(k)
        height, width = depth.shape
        rays = unproject(pixel_centres(width, height), np.ones((height, width)), reader.viewmats[k], reader.K)
        eye = invert_rigid(reader.viewmats[k])[:3, 3]
        on_ground = depth * (rays - eye)[..., 2] + eye[2]
        flat = (np.abs(on_ground) < 0.06) & (ids == 0)
        assert flat.sum() > 500
        known = np.array([0.0, WORN_HEIGHT_M, PATCH_HEIGHT_M, 0.002, 0.003, MARKING_HEIGHT_M])
        height_error = np.abs(on_ground[flat][:, None] - known).min(axis=1)
        assert np.percentile(height_error, 99) < 5e-4  # metres, seen from 45 metres
        asphalt = flat & (np.abs(on_ground) < 5e-4)
        exact = eye[2] / (eye[2] - rays[..., 2])
        assert asphalt.sum() > 300
        np.testing.assert_allclose(depth[asphalt], exact[asphalt], rtol=2e-5)


def test_instance_pixels_lie_in_the_box_of_their_vehicle(reader: Reader) -> None:
    sizes = {i["id"]: np.array(i["dimensions_m"]) for i in reader.index["instances"]}
    order = {int(number): m for m, number in enumerate(reader.tracks["instance_id"])}
    visible = set()
    for k in range(6):
        _, ids = reader.truth(k)
        points = reader.surface(k)
        for number in np.unique(ids[ids > 0]):
            pose = reader.tracks["object_to_world"][k, order[int(number)]]
            local = (points[ids == number] - pose[:3, 3]) @ pose[:3, :3]
            length, width, height = sizes[int(number)]
            assert np.abs(local[:, 0]).max() < length / 2 + 0.03
            assert np.abs(local[:, 1]).max() < width / 2 + 0.03
            assert -0.01 < local[:, 2].min() <= local[:, 2].max() < height + 0.03
            visible.add(int(number))
        background = points[(ids == 0) & np.isfinite(points[..., 0])]
        for m in range(3):  # and nothing of the background is inside a driven vehicle, above the road
            pose = reader.tracks["object_to_world"][k, m]
            local = (background - pose[:3, 3]) @ pose[:3, :3]
            within = np.abs(local[:, :2]) < sizes[m + 1][:2] / 2 - 0.1
            assert not (within.all(axis=1) & (local[:, 2] > 0.3) & (local[:, 2] < 0.8)).any()
    assert {1, 2, 3} <= visible
    assert len(visible) > 5


def test_moving_is_what_drives(reader: Reader) -> None:
    moving, speed = reader.tracks["moving"], reader.tracks["speed_mps"]
    np.testing.assert_array_equal(moving, speed > 0.05)
    assert moving[0, :3].all()
    assert not moving[:, 3:].any()  # parked
    assert not moving[-1, 2]  # waits at the red light
    step = np.linalg.norm(np.diff(reader.tracks["object_to_world"][:, 0, :2, 3], axis=0), axis=1)
    np.testing.assert_allclose(step, 0.5 * (speed[1:, 0] + speed[:-1, 0]) * 0.5, rtol=0.02)


def test_pycolmap_reads_the_model(reader: Reader) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(str(reader.root / "sparse" / "0"))
    assert model.num_images() == 6
    assert model.num_points3D() > 500
    camera = next(iter(model.cameras.values()))
    np.testing.assert_allclose(camera.calibration_matrix(), reader.K, rtol=1e-12)
    for image in model.images.values():
        k = int(Path(image.name).stem)
        np.testing.assert_allclose(image.cam_from_world().matrix(), reader.viewmats[k][:3], atol=1e-9)
        for observation in image.points2D[:50]:
            projected = image.project_point(model.points3D[observation.point3D_id].xyz)
            assert np.abs(projected - observation.xy).max() < 2e-3
    assert model.compute_mean_track_length() > 2


def test_points_are_on_what_stands_still(reader: Reader) -> None:
    from plyfile import PlyData

    vertices = PlyData.read(str(reader.root / "points.ply"))["vertex"].data
    assert vertices.dtype.names == ("x", "y", "z", "red", "green", "blue")
    points = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    assert len(points) > 500
    assert np.ptp(vertices["red"]) > 100
    assert points[:, 2].min() > -0.01
    road = (np.abs(points[:, 0]) < 5) & (np.abs(points[:, 1]) < 5)
    assert points[road, 2].max() < KERB_HEIGHT_M  # the cars that cross have left no ghosts


def test_transforms_are_opengl_poses(reader: Reader) -> None:
    transforms = json.loads((reader.root / "transforms.json").read_text())
    assert (transforms["w"], transforms["h"], transforms["cx"]) == (96, 54, 48.0)
    for k, frame in enumerate(transforms["frames"]):
        assert (reader.root / frame["file_path"]).is_file()
        pose = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(invert_rigid(pose @ OPENCV_TO_OPENGL), reader.viewmats[k], atol=1e-12)
        assert pose[2, 1] > 0  # the camera's y axis points up in OpenGL's convention
        assert pose[:3, 3] @ pose[:3, 2] > 0  # and z away from the scene
    assert set(transforms["train_filenames"]).isdisjoint(transforms["test_filenames"])


def test_cost_lists_every_frame(reader: Reader) -> None:
    cost = json.loads((reader.root / "cost.json").read_text())
    assert [frame["name"] for frame in cost["frames"]] == [f"{k:06d}" for k in range(6)]
    assert {"build", "truth", "picture", "export"} <= set(cost["stages"])
    assert cost["seconds"] > 0


def test_png_has_no_metadata(reader: Reader) -> None:
    content, at, kinds = (reader.root / "frames/000000.png").read_bytes(), 8, []
    while at < len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        kinds.append(content[at + 4 : at + 8])
        at += length + 12
    assert kinds == [b"IHDR", b"IDAT", b"IEND"]
