"""What held-out frames hold reaches the scores and nothing else; activity classes."""

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture, read_image
from aa4d.errors import InputError
from aa4d.evaluation.activity import PooledError, activity_labels
from aa4d.evaluation.evaluate import Metrics, evaluate
from aa4d.evaluation.image_metrics import psnr
from aa4d.methods.model_file import read_tensors
from aa4d.motion.tracks import Tracks
from aa4d.motion.tracks_file import save_tracks
from aa4d.training.trainer import train
from tests.toy_capture import HEIGHT, WIDTH
from tests.toy_run import BRIEF, silent

SCORES = {
    "psnr", "ssim", "lpips", "psnr_dynamic", "psnr_still", "psnr_static", "psnr_dynamic_static", "psnr_activity",
    "psnr_activity_static", "activity_share", "psnr_swept", "psnr_swept_static", "frames", "motion_epe_px",
    "motion_epe_px_median", "motion_epe_px_static", "travel_ratio",
}  # fmt: skip
# Figures of the clock, and the size of a file whose header spells the seconds of training out.
CLOCK = {"fps", "training_seconds", "training_processor_seconds", "total_mib"}


@pytest.fixture(autouse=True)
def no_weights(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "weights").mkdir()
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path / "weights"))


@pytest.fixture
def trained(toy_run: Path, tmp_path: Path) -> tuple[Path, Path]:
    """The capture, and a copy of the run to write into."""
    run = tmp_path / "trained/run"
    shutil.copytree(toy_run, run)
    return toy_run.parent / "capture", run


def alter_held_out(capture: Path) -> None:
    """Every held-out image inverted, its truth shuffled."""
    rng = np.random.default_rng(0)
    for index in read_capture(capture).of_split("test"):
        image = capture / f"frames/{index:06}.png"
        Image.fromarray(255 - np.asarray(Image.open(image))).save(image)
        ids = rng.integers(0, 2, (HEIGHT, WIDTH)).astype(np.uint32)
        np.savez(capture / f"truth/{index:06}.npz", depth_z=np.ones((HEIGHT, WIDTH), np.float32), instance_id=ids)


def files(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir() if p.is_file()}


def test_held_out_frames_change_no_bit_but_the_scores(trained: tuple[Path, Path], tmp_path: Path) -> None:
    capture, run = trained
    before = evaluate(run, capture, silent)
    altered, other_run = tmp_path / "capture", tmp_path / "run"
    shutil.copytree(capture, altered)
    alter_held_out(altered)
    train(read_capture(altered), other_run, BRIEF, silent)
    for name in ("coarse.safetensors", "model.safetensors"):
        (header, tensors), (other_header, other_tensors) = read_tensors(run / name), read_tensors(other_run / name)
        assert tensors.keys() == other_tensors.keys()
        assert all(torch.equal(tensors[key], other_tensors[key]) for key in tensors)
        for h in (header, other_header):
            del h["training"]["seconds"], h["training"]["processor_seconds"]
            del h["identity"]["made_from"]  # it names the capture, which is another one
        assert header == other_header

    kept = files(other_run)
    after = evaluate(other_run, altered, silent)
    assert {name: digest for name, digest in files(other_run).items() if name != "metrics.json"} == kept
    one, two = before.as_json(), after.as_json()
    assert {key for key in one if one[key] != two[key]} - CLOCK <= SCORES | {"identity"}
    assert one["psnr"] != two["psnr"]
    assert one["training_frames"] == two["training_frames"]
    for frame in ("000000", "000008"):
        for picture in (f"{frame}.png", f"{frame}_static.png"):
            assert (run / "eval" / picture).read_bytes() == (other_run / "eval" / picture).read_bytes()


def test_metrics_add_up(trained: tuple[Path, Path]) -> None:
    capture, run = trained
    metrics = evaluate(run, capture, silent)
    assert metrics.lpips == {}
    assert "alexnet-owt" in metrics.lpips_not_measured["alex"]
    assert metrics.psnr_activity == metrics.activity_share == {}
    loaded = read_capture(capture)
    for score in metrics.frames:
        truth = torch.from_numpy(read_image(loaded, loaded.frames[int(score.frame)])).double() / 255
        render = torch.from_numpy(np.array(Image.open(run / f"eval/{score.frame}.png"))).double() / 255
        assert score.psnr == pytest.approx(psnr(render, truth), abs=1e-4)
        # The image is its moving and its still pixels, so its error is their mean.
        assert score.moving_share is not None
        parts = ((score.moving_share, score.psnr_dynamic), (1 - score.moving_share, score.psnr_still))
        pooled = sum(share * 10 ** (-db / 10) for share, db in parts if db is not None)
        assert score.psnr == pytest.approx(-10 * np.log10(pooled), abs=1e-3)
    assert len(metrics.training_frames) == 8
    assert Image.open(run / "eval/psnr.png").size[0] > 500


def write_activity(capture: Path, labels: np.ndarray, frame: str = "000000") -> Path:
    path = capture / f"truth/activity/{frame}.png"
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(labels).save(path)
    return path


def test_psnr_by_activity_class(toy_capture: Path, tmp_path: Path) -> None:
    capture, run = toy_capture, tmp_path / "run"
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[4:10, 3:20] = 2
    labels[20:, :] = 3
    write_activity(capture, labels)
    write_activity(capture, np.full((HEIGHT, WIDTH), 2, np.uint8), "000008")
    train(read_capture(capture), run, BRIEF, silent)
    metrics = evaluate(run, capture, silent)
    assert list(metrics.psnr_activity) == ["static", "persistent", "appearance-only"]
    pixels = HEIGHT * WIDTH
    assert metrics.activity_share["persistent"] == pytest.approx((pixels + 6 * 17) / (2 * pixels))
    loaded = read_capture(capture)
    images = []
    for frame in ("000000", "000008"):
        truth = read_image(loaded, loaded.frames[int(frame)]).astype(np.float64) / 255
        images.append((truth - np.array(Image.open(run / f"eval/{frame}.png")) / 255) ** 2)
    expected = -10 * np.log10(np.concatenate([images[0][labels == 2].ravel(), images[1].ravel()]).mean())
    assert metrics.psnr_activity["persistent"] == pytest.approx(expected, abs=1e-4)
    assert metrics.psnr_swept is None, "the capture has labels of pixels alone"
    assert isinstance(metrics, Metrics)
    assert replace(metrics).as_json()["psnr_activity_static"].keys() == metrics.psnr_activity.keys()


@pytest.mark.parametrize(
    ("labels", "says"),
    [
        (np.zeros((HEIGHT, WIDTH - 1), np.uint8), "expected 8-bit labels of shape"),
        (np.zeros((HEIGHT, WIDTH, 3), np.uint8), "expected 8-bit labels of shape"),
        (np.full((HEIGHT, WIDTH), 5, np.uint8), "holds label 5"),
    ],
)
def test_damaged_activity_labels_are_refused(toy_capture: Path, labels: np.ndarray, says: str) -> None:
    write_activity(toy_capture, labels)
    with pytest.raises(InputError, match=says):
        activity_labels(read_capture(toy_capture), 0)


def test_a_truncated_label_picture_is_refused(toy_capture: Path) -> None:
    path = write_activity(toy_capture, np.zeros((HEIGHT, WIDTH), np.uint8))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="activity labels cannot be read"):
        activity_labels(read_capture(toy_capture), 0)


def test_a_class_that_is_exact_is_infinite_and_an_absent_one_is_left_out() -> None:
    pooled = PooledError()
    image = torch.full((2, 2, 3), 0.5)
    pooled.add(image, image, np.array([[0, 0], [4, 4]], np.uint8))
    assert pooled.psnr() == {"static": float("inf"), "unseen": float("inf")}
    assert pooled.share() == {"static": 0.5, "unseen": 0.5}


def test_tracks_that_are_not_the_runs_own_are_refused_before_anything_is_rendered(trained: tuple[Path, Path]) -> None:
    capture, run = trained
    shown, there = np.array([[0.0, 0.1, 0.9, 1.0]]), np.zeros((9, HEIGHT, WIDTH), np.uint16)
    other = Tracks(("mover 1",), np.zeros((1, 6, 4)), shown, np.array([0.0, 0, 1]), there, there > 0)
    save_tracks(run / "tracks.npz", other)
    with pytest.raises(InputError, match=r"tracks\.npz: is of another run than the model beside it; put the run's own"):
        evaluate(run, capture, silent)
    (run / "tracks.npz").write_bytes((run / "tracks.npz").read_bytes()[:200])
    with pytest.raises(InputError, match=r"tracks\.npz: cannot be read as tracks; delete it to be scored without"):
        evaluate(run, capture, silent)
    assert not (run / "eval").exists()
    (run / "tracks.npz").unlink()
    assert evaluate(run, capture, silent).track_recall is None
