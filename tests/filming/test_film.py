"""Films: the right pictures, whole files, continuing, videos that open."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.views import render_frame
from aa4d.filming import layers
from aa4d.filming.camera_path import path_of_frames, with_camera, with_time
from aa4d.filming.film import film
from aa4d.filming.layers import (
    LAYERS,
    WORLD_GRAY,
    colored,
    displacement_m,
    draw,
    group_color,
    mover_colors,
    scale_of,
    spatiotemporal_share,
    speed_mps,
)
from aa4d.filming.video import write_video
from aa4d.methods.adaanchor4d.aggregation import Weighted, make_aggregation
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.motion.tracks import ALWAYS
from tests.toy_capture import ALTITUDE_M
from tests.toy_riders import ride
from tests.toy_run import silent


@pytest.fixture(scope="module")
def loaded(toy_run: Path) -> LoadedModel:
    return load_model(toy_run / "model.safetensors")


def pictures(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.png"))}


def test_held_out_views_are_those_that_are_scored(loaded: LoadedModel, tmp_path: Path) -> None:
    capture = read_capture(loaded.capture_folder or Path())
    film(loaded, path_of_frames(loaded, "held-out"), ["color"], tmp_path / "out", video=False, progress=silent)
    for index in (0, 8):
        written = np.array(Image.open(tmp_path / f"out/color/{index:06}.png"))
        assert np.array_equal(written, render_frame(loaded, capture, index))
    assert not list((tmp_path / "out").glob("*.mp4"))


def test_a_frozen_scene_seen_from_one_place_is_one_picture(loaded: LoadedModel) -> None:
    path = path_of_frames(loaded, "all")
    still = with_camera(with_time(path, 0.5), path.views[4].viewmat)
    moving = with_camera(path, path.views[4].viewmat)
    first, last = (draw(loaded, still.views[i], path.camera, ["color"]).color for i in (0, 9))
    assert np.array_equal(first, last)
    first, last = (draw(loaded, moving.views[i], path.camera, ["color"]).color for i in (0, 9))
    assert not np.array_equal(first, last)


def test_a_stopped_film_continues_and_ends_as_if_it_had_not(loaded: LoadedModel, tmp_path: Path) -> None:
    path = path_of_frames(loaded, "training")
    chosen = ["color", "depth", "motion"]
    scales = film(loaded, path, chosen, tmp_path / "once", video=True, progress=silent)

    def stop(done: int, _total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    out = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt):
        film(loaded, path, chosen, out, video=True, progress=stop)
    assert len(list((out / "color").iterdir())) == 3
    kept = (out / "color/000001.png").stat().st_mtime_ns
    assert film(loaded, path, chosen, out, video=True, progress=silent) == scales
    assert (out / "color/000001.png").stat().st_mtime_ns == kept
    assert pictures(out) == pictures(tmp_path / "once")
    assert {p.name for p in out.glob("*.mp4")} == {"color.mp4", "depth.mp4", "motion.mp4"}
    assert not [p for p in out.rglob("*") if p.name.startswith(".")]


def test_a_layer_can_be_added_to_a_film(loaded: LoadedModel, tmp_path: Path) -> None:
    path, out = path_of_frames(loaded, "held-out"), tmp_path / "out"
    film(loaded, path, ["depth"], out, video=False, progress=silent)
    before = pictures(out)
    assert film(loaded, path, ["alpha"], out, video=False, progress=silent) == {"alpha": (0.0, 1.0)}
    assert before.items() <= pictures(out).items()
    assert (out / "alpha/000008.png").exists()


def test_another_film_or_another_folder_is_not_written_into(loaded: LoadedModel, tmp_path: Path) -> None:
    path, out = path_of_frames(loaded, "held-out"), tmp_path / "out"
    film(loaded, path, ["color"], out, video=False, progress=silent)
    with pytest.raises(InputError, match="holds a render with other settings"):
        film(loaded, with_time(path, 0.5), ["color"], out, video=False, progress=silent)
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").touch()
    with pytest.raises(InputError, match="not empty and not a render"):
        film(loaded, path, ["color"], foreign, video=False, progress=silent)
    assert [p.name for p in foreign.iterdir()] == ["thesis.tex"]
    with pytest.raises(InputError, match=r"thesis\.tex: is a file; choose a new folder with --out"):
        film(loaded, path, ["color"], foreign / "thesis.tex", video=False, progress=silent)
    (out / "render.json").write_text('{"scales": 3}')
    with pytest.raises(InputError, match="other settings"):
        film(loaded, path, ["color"], out, video=False, progress=silent)


def test_depth_is_in_metres(loaded: LoadedModel) -> None:
    view = path_of_frames(loaded, "all").views[3]
    drawn = draw(loaded, view, loaded.camera, ["depth", "alpha"])
    depth = drawn.values["depth"]
    assert np.nanmedian(depth) == pytest.approx(ALTITUDE_M, rel=0.1)
    assert np.array_equal(np.isnan(depth), drawn.values["alpha"] < layers.NOTHING)
    assert 0 <= drawn.values["alpha"].min() <= drawn.values["alpha"].max() <= 1 + 1e-6


def test_what_all_anchors_are_painted_with_is_seen_everywhere(
    loaded: LoadedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However transparent a pixel: a painted value is the mean over what it shows, not darkened by what it lacks."""
    n = len(loaded.model.anchors)
    for name, value in (("activity", 0.37), ("motion", 5.0)):
        monkeypatch.setitem(LAYERS, name, replace(LAYERS[name], anchor_values=lambda *_, v=value: torch.full((n,), v)))
    drawn = draw(loaded, path_of_frames(loaded, "all").views[3], loaded.camera, ["activity", "motion"])
    for name, value in (("activity", 0.37), ("motion", 5.0)):
        seen = drawn.values[name][np.isfinite(drawn.values[name])]
        assert seen.size > 500
        np.testing.assert_allclose(seen, value, rtol=1e-4)


def test_activity_is_the_weight_on_the_planes_with_time(loaded: LoadedModel) -> None:
    assert isinstance(loaded.model.aggregation, Weighted)
    rows = loaded.model.anchors.rows()
    share = spatiotemporal_share(loaded, 0.5)
    with torch.no_grad():
        weights = loaded.model.aggregation.weights(rows.embedding_acfa, 0.5)
    assert torch.allclose(share, weights[:, 3:].sum(1).mean(1))
    assert not torch.allclose(share, torch.full_like(share, 0.5), atol=1e-4)


def test_weights_of_the_planes_are_layers_that_sum_to_one(loaded: LoadedModel) -> None:
    names = [name for name in LAYERS if name.startswith("weight-")]
    assert names == ["weight-xy", "weight-xz", "weight-yz", "weight-xt", "weight-yt", "weight-zt"]
    view = path_of_frames(loaded, "all").views[3]
    values = draw(loaded, view, loaded.camera, [*names, "activity"]).values
    shown = np.isfinite(values["activity"])
    np.testing.assert_allclose(sum(values[name] for name in names)[shown], 1, atol=1e-4)
    np.testing.assert_allclose(sum(values[name] for name in names[3:])[shown], values["activity"][shown], atol=1e-4)
    assert values["weight-xt"][shown].std() > 0


def test_motion_is_in_metres_and_nothing_moves_in_the_coarse_stage(toy_run: Path, loaded: LoadedModel) -> None:
    with torch.no_grad():
        moved = loaded.model.deformed(loaded.model.anchors.rows(), 0.9).position - loaded.model.anchors.position
    expected = moved.norm(dim=1) * 20.0
    assert torch.allclose(displacement_m(loaded, 0.9), expected, rtol=1e-3)
    assert expected.max() > 0.01
    coarse = load_model(toy_run / "coarse.safetensors")
    assert displacement_m(coarse, None).abs().max() == 0
    with pytest.raises(InputError, match="no aggregation weights"):
        spatiotemporal_share(coarse, None)


def test_an_aggregation_without_weights_has_no_activity(toy_run: Path) -> None:
    rival = load_model(toy_run / "model.safetensors")
    rival.model.aggregation = make_aggregation("product", 32, 256, 16)
    with pytest.raises(InputError, match="no aggregation weights"):
        draw(rival, path_of_frames(rival, "all").views[3], rival.camera, ["activity"])
    assert np.isfinite(
        draw(rival, path_of_frames(rival, "all").views[3], rival.camera, ["motion"]).values["motion"]
    ).any()


def test_colour_scales_hold_what_is_seen() -> None:
    layer = LAYERS["depth"]
    values = np.linspace(10, 20, 1001, dtype=np.float32)
    assert scale_of(layer, [values]) == pytest.approx((10.1, 19.9), abs=1e-3)
    assert scale_of(LAYERS["motion"], [values])[0] == 0
    assert scale_of(LAYERS["alpha"], [values]) == (0, 1)
    assert scale_of(layer, [np.full(5, np.nan, np.float32)]) == (0, 1)
    assert scale_of(layer, [np.full(5, 7, np.float32)]) == (7, 8)
    assert scale_of(LAYERS["motion"], [np.zeros(5, np.float32)]) == (0, 1)
    picture = colored(LAYERS["alpha"], np.array([[-1, 0, 0.5, 1, 9, np.nan, np.inf]], np.float32), (0, 1))
    assert picture[0, :, 0].tolist() == [0, 0, 128, 255, 255, 0, 0]


def test_a_video_plays_with_its_colours(tmp_path: Path) -> None:
    """Odd sides, and the colours that H.264 loses where the matrix is wrong."""
    shades = [(200, 60, 30), (30, 160, 60), (40, 60, 190), (128, 128, 128)]
    write_video(tmp_path / "a.mp4", (np.full((33, 47, 3), shade, np.uint8) for shade in shades), 12.5)
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == (48, 34)
        assert stream.codec_context.name == "h264"
        assert stream.pix_fmt == "yuv420p"
        assert float(stream.average_rate or 0) == 12.5
        decoded = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(decoded) == 4
    for frame, shade in zip(decoded, shades, strict=True):
        np.testing.assert_allclose(frame[16, 20], shade, atol=4)


def test_a_video_shows_each_picture_at_its_own_second(tmp_path: Path) -> None:
    seconds = [0.0, 1.0, 2.0, 3.0, 9.5, 10.0]
    pictures = (np.full((32, 48, 3), 40 * rank, np.uint8) for rank in range(len(seconds)))
    write_video(tmp_path / "a.mp4", pictures, 0.5, np.array(seconds))
    with av.open(str(tmp_path / "a.mp4")) as container:
        decoded = [(float(frame.time or 0), frame.to_ndarray(format="gray").mean()) for frame in container.decode()]
    assert [time for time, _ in decoded] == pytest.approx(seconds, abs=1e-4)
    assert [shade for _, shade in decoded] == sorted(shade for _, shade in decoded)


def test_a_video_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def broken() -> object:
        yield np.zeros((8, 8, 3), np.uint8)
        raise InputError("a picture cannot be read")

    with pytest.raises(InputError):
        write_video(tmp_path / "a.mp4", broken(), 10)
    assert list(tmp_path.iterdir()) == []


def riding(toy_run: Path) -> LoadedModel:
    """Every second anchor rides on the first of two groups, every third of the others on one that comes late."""
    loaded = load_model(toy_run / "model.safetensors")
    group = torch.full((len(loaded.model.anchors),), -1)
    group[::2], group[1::3] = 0, 1
    ride(loaded, group, shown=(ALWAYS, (0.5, 0.6, 2.0, 3.0)))
    return loaded


def test_motion_and_speed_are_those_of_the_group_that_an_anchor_rides_on(toy_run: Path) -> None:
    """The square goes 12 m in the nine frame intervals of a clip of 10 frames a second."""
    loaded = riding(toy_run)
    group = loaded.model.anchors.group
    assert group is not None
    for t in (0.0, 0.5, 1.0):
        torch.testing.assert_close(displacement_m(loaded, t), (group >= 0) * 12.0 * t, atol=1e-3, rtol=0)
        torch.testing.assert_close(speed_mps(loaded, t), (group >= 0) * 12 / 0.9, atol=1e-2, rtol=0)
    slow = replace(loaded, frames=tuple(replace(f, time_s=i**2 / 10) for i, f in enumerate(loaded.frames)))
    for t, seconds in ((0.0, 0.05), (4 / 9, 0.8), (1.0, 0.85)):  # of half a step to each side
        way = 12 / 9 * (1 if t == 4 / 9 else 0.5)
        torch.testing.assert_close(speed_mps(slow, t), (group >= 0) * way / seconds, atol=1e-2, rtol=0)
    assert speed_mps(loaded, None).abs().max() == 0


def test_each_mover_has_a_color_of_its_own_and_the_world_is_gray(toy_run: Path) -> None:
    loaded = riding(toy_run)
    group = loaded.model.anchors.group
    assert group is not None
    colors = mover_colors(loaded)
    for g, color in ((-1, WORLD_GRAY), (0, group_color(0)), (1, group_color(1))):
        torch.testing.assert_close(colors[group == g], torch.tensor(color).expand(int((group == g).sum()), 3))
    many = np.array([group_color(g) for g in range(200)])
    apart = np.linalg.norm(many[:, None] - many[None], axis=2)
    assert np.abs(np.diff(many, axis=0)).max(axis=1).min() > 0.5
    assert apart[~np.eye(200, dtype=bool)].min() > 0


def test_movers_are_filmed_without_a_scale(toy_run: Path, tmp_path: Path) -> None:
    loaded = riding(toy_run)
    path = path_of_frames(loaded, "held-out")
    scales = film(loaded, path, ["movers", "speed"], tmp_path / "out", video=False, progress=silent)
    assert scales.keys() == {"speed"}
    assert not (tmp_path / "out/movers_scale.png").exists()
    # Beside a layer that is a scalar the colours are the same.
    alone = draw(loaded, path.views[1], path.camera, ["movers"]).paintings["movers"]
    assert np.array_equal(np.array(Image.open(tmp_path / "out/movers/000008.png")), alone)
    assert alone.std(axis=2).max() > 20


def test_without_groups_there_are_no_movers_to_show(loaded: LoadedModel) -> None:
    with pytest.raises(InputError, match="has no rigid groups"):
        draw(loaded, path_of_frames(loaded, "all").views[3], loaded.camera, ["movers"])
