"""The numpy evaluation against the float64 transcription of docs/formats.md."""

from pathlib import Path

import numpy as np
import pytest
from bad_model_files import GOOD_FILES
from model_files import make_model, write_model
from slow_reference import evaluate

from addon import carriers, names, products
from addon.field import (
    anchor_appearance,
    anchor_positions,
    anchor_state,
    centers,
    local_gaussians,
    plane_weights,
    prepare,
    to_world,
)
from addon.model import read_model
from addon.products import CHUNK

FRAMES = 5
# First, last, on a frame, between frames, and outside the clip, where the planes hold and the networks go on.
TIMES = (0.0, 1.0, 1 / 4, 0.5 / 4, 2.5 / 4, 0.777, -0.2, 1.3)


@pytest.mark.parametrize("t", TIMES)
@pytest.mark.parametrize(("stage", "dlgd"), [("fine", True), ("fine", False), ("coarse", False)])
def test_evaluation_agrees_with_the_specification(t: float, stage: str, dlgd: bool, tmp_path: Path) -> None:
    tensors, information = make_model(40, FRAMES, stage=stage, dlgd=dlgd)
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    field = prepare(model)
    center = np.array([3.0, -40.0, 17.0])
    expected = evaluate(tensors, information, t, center)
    state = anchor_state(field, t)
    gaussians = local_gaussians(field, state, center)
    extent = np.ptp(expected["anchors"], axis=0).max()
    assert np.abs(to_world(model, state.positions) - expected["anchors"]).max() < 1e-6 * extent
    assert np.abs(gaussians.positions - expected["positions"]).max() < 1e-6 * extent
    assert np.abs(gaussians.scales - expected["scales"]).max() < 1e-6 * extent
    assert np.abs(gaussians.colors - expected["colors"]).max() < 1e-5
    assert np.abs(gaussians.opacities - expected["opacities"]).max() < 1e-5
    assert np.abs(gaussians.quaternions - expected["quaternions"]).max() < 1e-5


@pytest.mark.parametrize("kind", ["on one plane", "on one line", "in one place"])
def test_anchors_without_extent_are_in_the_middle_of_the_field(kind: str, tmp_path: Path) -> None:
    GOOD_FILES[kind](tmp_path / "model.safetensors")
    field = prepare(read_model(tmp_path / "model.safetensors"))
    tensors, information = make_model(20)
    tensors["anchors.position"], tensors["field.box"] = (
        field.model.tensors[name].copy() for name in ("anchors.position", "field.box")
    )
    flat = tensors["field.box"][0] == tensors["field.box"][1]
    tensors["field.box"] += flat * np.array([[-1], [1]], np.float32)  # any box around them
    expected = evaluate(tensors, information, 0.3, np.zeros(3))["anchors"]
    found = to_world(field.model, anchor_state(field, 0.3).positions)
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("t", [*TIMES, 0.25, 0.4, 0.7625, 0.8])
@pytest.mark.parametrize("up", [(0, 0, 1), (0.3, -0.5, 0.7)])
@pytest.mark.parametrize("stage", ["fine", "coarse"])
def test_groups_agree_with_the_specification(
    t: float, up: tuple[float, float, float], stage: str, tmp_path: Path
) -> None:
    tensors, information = make_model(40, FRAMES, stage=stage, groups=3, up=up)
    field = prepare(read_model(write_model(tmp_path / "model.safetensors", tensors, information)))
    center = np.array([3.0, -40.0, 17.0])
    expected = evaluate(tensors, information, t, center)
    state = anchor_state(field, t)
    gaussians = local_gaussians(field, state, center)
    extent = np.ptp(expected["anchors"], axis=0).max()
    assert np.abs(to_world(field.model, centers(field, state)) - expected["anchors"]).max() < 1e-6 * extent
    assert np.abs(to_world(field.model, anchor_positions(field, t)) - expected["anchors"]).max() < 1e-6 * extent
    assert np.abs(to_world(field.model, field.canonical) - expected["canonical"]).max() < 1e-6 * extent
    assert np.abs(gaussians.positions - expected["positions"]).max() < 1e-6 * extent
    assert np.abs(gaussians.colors - expected["colors"]).max() < 1e-5
    assert np.abs(gaussians.opacities - expected["opacities"]).max() < 1e-5
    assert np.abs(gaussians.quaternions - expected["quaternions"]).max() < 1e-5


@pytest.mark.parametrize("carrier", [names.ANCHORS, names.GAUSSIANS])
def test_absent_group_has_no_size(carrier: str, tmp_path: Path) -> None:
    """Group 2 comes and goes between t 0.2 and 0.8, group 3 from 0.4 on."""
    tensors, information = make_model(40, FRAMES, groups=3)
    field = prepare(read_model(write_model(tmp_path / "model.safetensors", tensors, information)))
    group = np.repeat(tensors["anchors.group"], 1 if carrier == names.ANCHORS else 3)
    for t, absent in ((0.1, (1, 2)), (0.25, (2,)), (0.5, ()), (0.9, (1,))):
        values = carriers.evaluate(field, carrier, t, np.zeros(3), names.SHAPE)
        hidden = np.isin(group, absent)
        assert (values[names.OPACITY][hidden] == 0).all()
        np.testing.assert_array_equal(values[names.RADIUS] == 0, hidden)
        np.testing.assert_array_equal(values[names.SCALE].max(axis=1) == 0, hidden)
    half, whole = (carriers.evaluate(field, carrier, t, np.zeros(3), ())[names.OPACITY] for t in (0.25, 0.3))
    assert half[group == 1].max() < 0.55 < whole[group == 1].max()


def test_speed_and_displacement_include_the_ride(tmp_path: Path) -> None:
    tensors, information = make_model(40, FRAMES, groups=3)
    field = prepare(read_model(write_model(tmp_path / "model.safetensors", tensors, information)))
    values = carriers.evaluate(field, names.ANCHORS, 0.5, np.zeros(3), (names.SPEED, names.DISPLACEMENT))
    step = 0.5 / (FRAMES - 1)
    before, now, after = (evaluate(tensors, information, t, np.zeros(3)) for t in (0.5 - step, 0.5, 0.5 + step))
    speed = np.linalg.norm(after["anchors"] - before["anchors"], axis=1) * information["fps"]
    np.testing.assert_allclose(values[names.SPEED], speed, rtol=1e-3, atol=1e-3)
    moved = np.linalg.norm(now["anchors"] - now["canonical"], axis=1)
    np.testing.assert_allclose(values[names.DISPLACEMENT], moved, atol=1e-3)
    assert np.median(moved[tensors["anchors.group"] >= 0]) > 2


@pytest.mark.parametrize("aggregation", ["acfa", "anchor_only", "time_only", "mean", "product", None])
def test_every_aggregation_agrees_with_the_specification(aggregation: str | None, tmp_path: Path) -> None:
    tensors, information = make_model(40, FRAMES, aggregation=aggregation or "acfa")
    if aggregation is None:  # an older file does not say
        for switch in ("aggregation", "dlgd", "dacw"):
            del information["config"][switch]
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    field = prepare(model)
    for t in (0.0, 0.37, 1.0):
        expected = evaluate(tensors, {**information, "config": {"dlgd": True, **information["config"]}}, t, np.ones(3))
        extent = np.ptp(expected["anchors"], axis=0).max()
        assert np.abs(to_world(model, anchor_state(field, t).positions) - expected["anchors"]).max() < 1e-5 * extent
        np.testing.assert_allclose(anchor_positions(field, t), anchor_state(field, t).positions, atol=1e-6)
        np.testing.assert_allclose(plane_weights(field, t).sum(axis=1), 1, atol=1e-5)


def test_appearance_of_an_anchor_is_that_of_its_gaussians(tmp_path: Path) -> None:
    model = read_model(write_model(tmp_path / "model.safetensors", *make_model(40)))
    field = prepare(model)
    center = np.array([3.0, -40.0, 17.0])
    state = anchor_state(field, 0.3)
    colors, opacities, reach = anchor_appearance(field, anchor_state(field, 0.3, offsets=False), center)
    gaussians = local_gaussians(field, state, center)
    np.testing.assert_allclose(colors, gaussians.colors, atol=1e-6)
    np.testing.assert_allclose(opacities, gaussians.opacities, atol=1e-6)
    ordered = np.sort(gaussians.scales, axis=2)
    np.testing.assert_allclose(reach, np.sqrt(ordered[..., 1] * ordered[..., 2]), rtol=1e-5)


def test_anchors_move_visibly(tmp_path: Path) -> None:
    """The other tests would pass on a model that stands still."""
    model = read_model(write_model(tmp_path / "model.safetensors", *make_model(40)))
    field = prepare(model)
    moved = np.abs(anchor_state(field, 1.0).positions - anchor_state(field, 0.0).positions).max()
    assert model.scale * moved > 1.0


def test_chunks_do_not_show(tmp_path: Path) -> None:
    """More anchors than one chunk give what each gives alone."""
    tensors, information = make_model(CHUNK + 7)
    field = prepare(read_model(write_model(tmp_path / "many.safetensors", tensors, information)))
    few = {name: tensor[-9:] if name.startswith("anchors.") else tensor for name, tensor in tensors.items()}
    alone = prepare(read_model(write_model(tmp_path / "few.safetensors", few, information)))
    np.testing.assert_allclose(anchor_state(field, 0.4).positions[-9:], anchor_state(alone, 0.4).positions, atol=1e-5)


@pytest.mark.parametrize("way", [products.by_blas, products.by_loops])
@pytest.mark.parametrize("processors", [1, 3])
def test_neither_numpy_without_a_blas_nor_threads_show(
    way: products.Product, processors: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    field = prepare(read_model(write_model(tmp_path / "model.safetensors", *make_model(2 * CHUNK + 7))))
    center = np.array([3.0, -40.0, 17.0])
    wanted = (*names.SHAPE, *names.INSPECTION)
    expected = carriers.evaluate(field, names.GAUSSIANS, 0.4, center, wanted)
    monkeypatch.setattr(products, "_fastest", lambda: way)
    monkeypatch.setattr(products, "_processors", lambda: processors)
    for attribute, values in carriers.evaluate(field, names.GAUSSIANS, 0.4, center, wanted).items():
        np.testing.assert_allclose(values, expected[attribute], rtol=1e-4, atol=2e-4, err_msg=attribute.name)


def test_threads_of_the_blas_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """While chunks run in threads of ours, it has one; afterwards as many as before, even after a failure."""
    counts = [4]
    blas = products.OpenBlas(lambda: counts[-1], counts.append)
    monkeypatch.setattr(products, "_openblas", lambda: blas)
    monkeypatch.setattr(products, "_processors", lambda: 2)
    assert products.over_chunks(2 * CHUNK, lambda part: (part.start, counts[-1])) == [(0, 1), (CHUNK, 1)]
    assert counts == [4, 1, 4]
    with pytest.raises(ZeroDivisionError):
        products.over_chunks(2 * CHUNK, lambda part: 1 / part.start)
    assert counts == [4, 1, 4, 1, 4]


def test_openblas_of_numpy_is_found() -> None:
    if not list(Path(np.__file__).parent.parent.glob("numpy.libs/*openblas*")):
        pytest.skip("this numpy brings no OpenBLAS")
    blas = products._openblas()
    assert blas is not None
    before = blas.get_threads()
    with products._one_blas_thread():
        assert blas.get_threads() == 1
    assert blas.get_threads() == before >= 1


@pytest.mark.parametrize("along", ["space", "time"])
def test_planes_of_one_texel_are_constant_along_it(along: str, tmp_path: Path) -> None:
    tensors, information = make_model(10)
    for name, plane in tensors.items():
        if along == "space" and name.startswith("field.planes.0"):
            tensors[name] = plane[..., :1] if name.endswith("t") else plane[:, :1, :1]
        elif along == "time" and name.startswith("field.planes") and name.endswith("t"):
            tensors[name] = plane[:, :1]
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    expected = evaluate(tensors, information, 0.3, np.zeros(3))["anchors"]
    np.testing.assert_allclose(to_world(model, anchor_state(prepare(model), 0.3).positions), expected, atol=1e-4)


def test_clip_of_one_frame_has_time_zero(tmp_path: Path) -> None:
    model = read_model(write_model(tmp_path / "model.safetensors", *make_model(10, frames=1)))
    assert model.time_of_rank(0.0) == model.time_of_rank(5.0) == 0.0


def test_anchor_summary_weighs_by_opacity(tmp_path: Path) -> None:
    tensors, information = make_model(40)
    model = read_model(write_model(tmp_path / "model.safetensors", tensors, information))
    wanted = (*names.SHAPE, *names.INSPECTION)
    values = carriers.evaluate(prepare(model), names.ANCHORS, 0.5, model.camera_center_at(0.5), wanted)
    expected = evaluate(tensors, information, 0.5, model.camera_center_at(0.5))
    opacity = np.maximum(expected["opacities"], 0)
    np.testing.assert_allclose(values[names.OPACITY], opacity.max(axis=1), atol=1e-5)
    seen = opacity.max(axis=1) > 0.05
    srgb = (opacity[..., None] * expected["colors"]).sum(axis=1)[seen] / opacity.sum(axis=1)[seen, None]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(values[names.COLOR][seen, :3], linear, atol=1e-4)
    canonical = model.scale * tensors["anchors.position"] + model.translation
    distance = np.linalg.norm(expected["anchors"] - canonical, axis=1)
    np.testing.assert_allclose(values[names.DISPLACEMENT], distance, atol=1e-4)
