"""What `aa4d inspect` shows is what the model holds."""

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.field.planes import PLANES
from aa4d.inspection.history import history_figure, read_history
from aa4d.inspection.motion_groups import groups_by_motion, groups_by_truth
from aa4d.inspection.page import inspect
from aa4d.inspection.trajectories import FARTHEST_ANCHORS, trajectories
from aa4d.inspection.warp import stretch
from aa4d.inspection.weights import spatiotemporal, summary, weights_over_time
from aa4d.methods.model_file import LoadedModel, load_model, save_model
from aa4d.motion.tracks import ALWAYS
from tests.toy_capture import square_centre
from tests.toy_riders import ride
from tests.toy_run import silent


@pytest.fixture
def loaded(toy_run: Path) -> LoadedModel:
    """For a test alone, which may change it."""
    return load_model(toy_run / "model.safetensors")


@pytest.fixture
def run(toy_run: Path, tmp_path: Path) -> Path:
    """The run beside a copy of its capture, to write into."""
    for name in ("run", "capture"):
        shutil.copytree(toy_run.parent / name, tmp_path / name)
    return tmp_path / "run"


def test_dynamic_anchors_lie_where_the_square_slides(loaded: LoadedModel) -> None:
    """The toy square covers -7.5 < x < 7.5 within 1.5 m of the line y = 1 over the clip."""
    for parameter in loaded.model.head_position.output.parameters():
        torch.nn.init.zeros_(parameter)  # anchors stay where they are
    groups = groups_by_truth(loaded, read_capture(loaded.capture_folder or Path()))
    assert groups is not None
    world = loaded.model.anchors.position.numpy() * loaded.frame.unit_m + loaded.frame.origin_m
    beside = np.abs(world[:, 1] - 1) - 1.5
    assert groups.dynamic.any()
    assert groups.static.sum() > 20
    assert not (groups.static & groups.dynamic).any()
    # A little play for pixels.
    assert beside[groups.dynamic].max() < 0.5
    deep_inside = (beside < -1.0) & (np.abs(world[:, 0]) < 5)
    assert not groups.static[deep_inside].any()
    assert groups.static[(beside > 2) & (np.abs(world) < 6).all(1)].all()


def test_a_hidden_anchor_is_in_no_group(loaded: LoadedModel) -> None:
    capture = read_capture(loaded.capture_folder or Path())
    before = groups_by_truth(loaded, capture)
    assert before is not None
    hidden = int(np.flatnonzero(before.static)[0])
    loaded.model.anchors.position[hidden, 2] -= 5 / loaded.frame.unit_m
    after = groups_by_truth(loaded, capture)
    assert after is not None
    assert not after.static[hidden]
    assert not after.dynamic[hidden]


def test_without_truth_the_models_own_motion_decides(loaded: LoadedModel, toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    for frame in capture.frames:
        object.__setattr__(frame, "truth", None)
    assert groups_by_truth(loaded, capture) is None
    groups = groups_by_motion(loaded)
    n = len(loaded.model.anchors)
    assert groups.static.sum() == pytest.approx(n / 2, abs=1)
    assert groups.dynamic.sum() == pytest.approx(n / 20, abs=1)
    assert "by the model's own motion" in groups.rule


def test_weights_are_shares_and_the_planes_with_time_are_told_apart(loaded: LoadedModel) -> None:
    groups = groups_by_motion(loaded)
    bias = loaded.model.get_parameter("aggregation.predictor.output.bias")
    channels = len(bias) // len(PLANES)
    with torch.no_grad():
        for name, parameter in loaded.model.named_parameters():
            if name.startswith("aggregation."):
                parameter.zero_()
    uniform = weights_over_time(loaded, groups)
    assert uniform is not None
    np.testing.assert_allclose(uniform.static, 1 / 6, rtol=1e-6)
    with torch.no_grad():
        for plane in ("xt", "yt", "zt"):
            p = PLANES.index(plane)
            bias[p * channels : (p + 1) * channels] = np.log(3)
    weights = weights_over_time(loaded, groups)
    assert weights is not None
    np.testing.assert_allclose(weights.dynamic.sum(axis=2), 1, rtol=1e-6)
    np.testing.assert_allclose(spatiotemporal(weights.dynamic), 0.75, rtol=1e-6)
    rows = summary(weights)
    assert [row["anchors"] for row in rows] == [groups.static.sum(), groups.dynamic.sum()]
    assert rows[0]["mean"] == pytest.approx(0.75)
    assert rows[0]["deviation"] == pytest.approx(0, abs=1e-6)


def test_the_stretch_is_the_slope_of_the_warp(loaded: LoadedModel) -> None:
    bins = loaded.model.warp.boundaries.shape[1] - 1
    uniform = torch.linspace(-1, 1, bins + 1)
    loaded.model.warp.boundaries.copy_(uniform.repeat(3, 1))
    assert all(s["most"] == pytest.approx(1) and s["least"] == pytest.approx(1) for s in stretch(loaded))
    loaded.model.warp.boundaries[1] = uniform.sign() * uniform.abs().square()
    _, y, _ = stretch(loaded)
    assert y["most"] == pytest.approx(2, rel=0.05)
    assert y["least"] == pytest.approx(0, abs=0.05)


def test_the_page_holds_everything_itself(run: Path) -> None:
    (run / "history.csv").unlink()
    page, _ = inspect(run, None, run / "inspect", silent)
    html = page.read_text()
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert len(sources) == 2 * 4 + 2 + 3 + 2 + 1  # two frames, two scales, three plots, paths over frames and a map
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "http" not in html
    assert "no history.csv" in html
    assert "by the truth of the capture" in html
    assert {"weights_over_time.png", "weights_by_plane.png", "warp.png"} <= {p.name for p in page.parent.iterdir()}
    for path in page.parent.glob("*.png"):
        with Image.open(path) as picture:
            assert np.array(picture.convert("L")).std() > 1, f"{path} is blank"


def test_the_page_does_without_a_capture(run: Path) -> None:
    inspect(run, None, run / "inspect", silent)
    (run / "inspect/notes.png").touch()
    shutil.rmtree(run.parent / "capture")
    page, note = inspect(run, None, run / "inspect", silent)
    html = page.read_text()
    assert note is not None
    assert "capture is not there" in note
    # The frames of the first page are gone, and nothing else.
    assert not list((run / "inspect").glob("*_frame.png"))
    assert (run / "inspect/notes.png").exists()
    assert "by the model&#39;s own motion" in html
    assert "frame 0" not in html
    with pytest.raises(InputError, match="no such capture folder"):
        inspect(run, run.parent / "capture", run / "inspect", silent)


def test_the_growth_of_the_anchors_is_shown(run: Path) -> None:
    rows = [f"{i},{'coarse' if i <= 20 else 'fine'},{i},0.1,{20 + i / 10},{100 + i},{i / 3}" for i in range(1, 41)]
    (run / "history.csv").write_text("step,stage,iteration,loss,psnr_db,anchors,seconds\n" + "\n".join(rows) + "\n")
    history = read_history(run / "history.csv")
    assert history is not None
    assert len(history) == 40
    assert (history[-1].step, history[-1].stage, history[-1].anchors) == (40, "fine", 140)
    html = inspect(run, None, run / "inspect", silent)[0].read_text()
    assert "anchors over training" in html
    assert (run / "inspect/history.png").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("step,stage,loss\n1,coarse,0.1\n", "has no column 'psnr_db'"),
        ("step,stage,psnr_db,anchors\n1,coarse,x,5\n", "cannot be read as a history"),
        ("step,stage,psnr_db,anchors\n1,coarse\n", "cannot be read as a history"),
        ("step,stage,psnr_db,anchors\n1,coarse,nan,5\n", "psnr_db of step 1 is nan"),
        ("step,stage,psnr_db,anchors\n1,coarse,-inf,5\n", "psnr_db of step 1 is -inf"),
    ],
)
def test_a_damaged_history_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "history.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_history(tmp_path / "history.csv")


def test_the_coarse_stage_has_nothing_to_look_into(run: Path) -> None:
    (run / "coarse.safetensors").replace(run / "model.safetensors")
    with pytest.raises(InputError, match="of the coarse stage"):
        inspect(run, None, run / "inspect", silent)
    assert not (run / "inspect").exists()


def test_a_folder_with_other_files_is_not_written_into(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "photos"
    out.mkdir()
    (out / "holiday.jpg").touch()
    with pytest.raises(InputError, match="not empty and not pages of `aa4d inspect`"):
        inspect(run, None, out, silent)
    assert [path.name for path in out.iterdir()] == ["holiday.jpg"]


def test_a_path_is_where_the_group_goes_and_heads(loaded: LoadedModel) -> None:
    ride(loaded, torch.zeros(len(loaded.model.anchors), dtype=torch.long), turn=np.pi / 2, shown=((0.2, 0.3, 2, 3),))
    (path,) = trajectories(loaded)
    assert path.name == "car 0"
    ways = np.stack([square_centre(t) for t in path.times])
    np.testing.assert_allclose(path.position_m[:, :2], ways, atol=1e-3)
    assert path.forward is not None
    angle = path.times * np.pi / 2
    np.testing.assert_allclose(path.forward[:, :2], np.stack([np.cos(angle), np.sin(angle)], 1), atol=1e-4)
    assert np.array_equal(path.there, path.times > 0.2)


def test_without_groups_the_anchors_that_travel_farthest_are_shown(loaded: LoadedModel) -> None:
    paths = trajectories(loaded)
    lengths = [np.linalg.norm(np.diff(path.position_m, axis=0), axis=1).sum() for path in paths]
    assert len(paths) == min(FARTHEST_ANCHORS, len(loaded.model.anchors))
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[0] > 0
    assert all(path.forward is None and path.name == "" for path in paths)


def test_riders_are_told_apart_where_they_are(loaded: LoadedModel) -> None:
    """All anchors that start within the square ride with it: they are dynamic, though their group's frame is not."""
    world = loaded.model.anchors.position.numpy() * loaded.frame.unit_m + loaded.frame.origin_m
    on = (np.abs(world[:, :2] - square_centre(0)) < 1.2).all(axis=1)
    assert on.any()
    ride(loaded, torch.from_numpy(np.where(on, 0, -1)))
    groups = groups_by_truth(loaded, read_capture(loaded.capture_folder or Path()))
    assert groups is not None
    assert groups.dynamic[on].all()


def test_a_page_of_a_model_with_groups_names_them(run: Path) -> None:
    loaded = load_model(run / "model.safetensors")
    capture = read_capture(run.parent / "capture")
    group = torch.full((len(loaded.model.anchors),), -1)
    group[::2] = 1
    ride(loaded, group, shown=(ALWAYS, ALWAYS))
    save_model(
        run / "model.safetensors", loaded.method, loaded.model, is_static=False, capture=capture, frame=loaded.frame,
        background=loaded.background, training={"seconds": 1.0},
    )  # fmt: skip
    page, _ = inspect(run, None, run / "inspect", silent)
    assert "Paths of the 2 rigid groups" in page.read_text()
    assert (page.parent / "trajectories.png").exists()
    assert len(list(page.parent.glob("*_trajectories.png"))) == 2


def test_a_history_without_any_error_is_shown(tmp_path: Path) -> None:
    """Training of an all-black clip writes infinite PSNR: what it wrote itself is no damage."""
    rows = "".join(f"{20 * i},{'coarse' if i < 5 else 'fine'},{20.5 if i < 3 else 'inf'},9\n" for i in range(1, 9))
    for text in (rows, rows.replace("20.5", "inf")):
        (tmp_path / "history.csv").write_text("step,stage,psnr_db,anchors\n" + text)
        history = read_history(tmp_path / "history.csv")
        assert history is not None
        assert [row.psnr_db for row in history[2:]] == [math.inf] * 6
        history_figure(history).savefig(tmp_path / "history.png")
