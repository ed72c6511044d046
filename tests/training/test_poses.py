"""Learned poses: the exponential map, the gauge, the trainer with noisy cameras."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.linalg import expm

from aa4d.capture.frame import ModelFrame
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import Interrupted
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.model_file import load_model
from aa4d.methods.settings import AnchorDensification, Decay
from aa4d.raster.types import Camera
from aa4d.training.frames import training_frames
from aa4d.training.poses import (
    PoseRefinement,
    cross_matrix,
    exponential,
    gauge_directions,
    moved,
    refined,
)
from aa4d.training.trainer import Run, train

RATE = Decay(1e-2, 1e-3)


def silent(*_: object) -> None:
    pass


def cameras(count: int = 6) -> list[Camera]:
    generator = torch.Generator().manual_seed(3)
    twists = torch.randn(count, 6, generator=generator, dtype=torch.float64) * 0.4
    twists[:, 5] += 1.0
    K = torch.tensor([[50.0, 0, 24], [0, 50, 16], [0, 0, 1]])
    return [Camera(matrix.float(), K, 48, 32) for matrix in exponential(twists)]


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 1e-3, 0.3, 3.0])
def test_exponential_is_the_matrix_exponential(size: float) -> None:
    twist = torch.tensor([0.3, -0.7, 0.2, 1.0, -2.0, 0.5], dtype=torch.float64) * size
    generator = torch.zeros(4, 4, dtype=torch.float64)
    generator[:3, :3] = cross_matrix(twist[:3])
    generator[:3, 3] = twist[3:]
    torch.testing.assert_close(exponential(twist), torch.from_numpy(expm(generator.numpy())), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("size", [0.0, 1e-5, 1e-3, 0.5])
def test_exponential_has_exact_gradients_at_and_around_zero(size: float) -> None:
    twist = (torch.tensor([0.3, -0.7, 0.2, 1.0, -2.0, 0.5], dtype=torch.float64) * size).requires_grad_()
    assert torch.autograd.gradcheck(exponential, (twist,))


def test_exponential_in_float32_stays_a_rotation_for_tiny_twists() -> None:
    matrix = exponential(torch.full((6,), 1e-20))
    assert torch.isfinite(matrix).all()
    torch.testing.assert_close(matrix, torch.eye(4))


def test_gauge_directions_are_those_that_no_picture_shows() -> None:
    """A turned, shifted and grown scene, seen by the cameras that the gauge's twists give, is the scene."""
    viewmats = torch.stack([c.viewmat for c in cameras()]).double()
    points = torch.randn(40, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    basis = gauge_directions(viewmats)
    assert basis.shape == (36, 7)
    eta = torch.tensor([0.2, -0.1, 0.3, 0.5, 0.4, -0.2], dtype=torch.float64) * 1e-4
    s = 3e-4

    def see(matrices: torch.Tensor, world: torch.Tensor) -> torch.Tensor:
        in_camera = torch.einsum("nij,pj->npi", matrices[:, :3, :3], world) + matrices[:, None, :3, 3]
        return in_camera[..., :2] / in_camera[..., 2:]

    rotation = viewmats[:, :3, :3]
    adjoint = torch.cat(
        [
            (rotation @ eta[:3]),
            (cross_matrix(viewmats[:, :3, 3]) @ rotation @ eta[:3] + rotation @ eta[3:] + s * viewmats[:, :3, 3]),
        ],
        dim=1,
    )
    # That twist lies in the gauge, ...
    flat = adjoint.reshape(-1)
    torch.testing.assert_close(basis @ (basis.T @ flat), flat)
    # ... and it and the scene's motion cancel, to first order.
    motion = exponential(eta)
    world = (points * (1 + s)) @ motion[:3, :3] - motion[:3, 3] @ motion[:3, :3]
    after, before = see(exponential(adjoint) @ viewmats, world), see(viewmats, points)
    visible = before.abs().amax(dim=(0, 2)) < 20
    assert (after - before)[:, visible].abs().max() < 1e-5
    unmatched = see(viewmats, world)
    assert (unmatched - before)[:, visible].abs().max() > 1e-4


def test_cameras_in_one_place_have_no_scale_of_their_own() -> None:
    viewmats = torch.eye(4).repeat(5, 1, 1)
    basis = gauge_directions(viewmats)
    assert basis.shape[1] == 6
    torch.testing.assert_close(basis.T @ basis, torch.eye(6, dtype=torch.float64))


def test_fixing_the_gauge_keeps_what_distinguishes_cameras() -> None:
    poses = PoseRefinement(cameras(), RATE)
    own = torch.randn(6, 6, generator=torch.Generator().manual_seed(1)) * 0.01
    basis = gauge_directions(torch.stack([c.viewmat for c in cameras()]))
    own = (own.reshape(-1).double() - basis @ (basis.T @ own.reshape(-1).double())).float()
    drift = (basis @ torch.linspace(-0.02, 0.02, 7, dtype=torch.float64)).float()
    with torch.no_grad():
        for twist, value in zip(poses.of_views, (own + drift).reshape(-1, 6), strict=True):
            twist.copy_(value)
    poses.fix_gauge()
    torch.testing.assert_close(torch.cat(list(poses.of_views)), own, rtol=0, atol=1e-7)


def test_a_view_moves_its_own_camera_only() -> None:
    poses = PoseRefinement(cameras(), RATE)
    for index in (2, 2, 4):
        poses.camera(index, cameras()[index]).viewmat[0, 3].backward()
        poses.step(0.0)
    moved_cameras = [i for i, twist in enumerate(poses.of_views) if twist.abs().max() > 0]
    assert moved_cameras == [2, 4]
    again = PoseRefinement(cameras(), RATE)
    again.load(poses.tensors())
    for one in (poses, again):
        one.camera(2, cameras()[2]).viewmat[1, 3].backward()
        one.step(0.5)
    for a, b in zip(poses.of_views, again.of_views, strict=True):
        assert torch.equal(a, b)


def test_a_twist_in_the_model_frame_is_the_same_motion_in_metres() -> None:
    frame = ModelFrame(7.0, np.array([100.0, -50.0, 3.0]))
    viewmat = np.array(cameras()[1].viewmat, np.float64)
    twist = np.array([0.01, -0.02, 0.03, 0.1, 0.2, -0.1])
    in_model = frame.camera(viewmat, np.eye(3), 4, 4).viewmat.double()
    wanted = exponential(torch.from_numpy(twist)) @ in_model
    got = frame.camera(moved(viewmat, twist, frame), np.eye(3), 4, 4).viewmat.double()
    torch.testing.assert_close(got, wanted, rtol=1e-5, atol=1e-5)


def test_held_out_cameras_take_what_their_neighbours_in_time_have(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    train_frames = capture.of_split("train")
    twists = np.zeros((len(train_frames), 6))
    twists[:, 3] = [capture.frames[i].t for i in train_frames]
    frame = ModelFrame(2.0, np.zeros(3))
    result = refined(capture, frame, twists)
    held_out = capture.frames[8]
    shift = result.frames[8].viewmat[0, 3] - held_out.viewmat[0, 3]
    assert shift == pytest.approx(2.0 * held_out.t)
    # The first frame has a neighbour on one side only.
    assert result.frames[0].viewmat[0, 3] - capture.frames[0].viewmat[0, 3] == pytest.approx(2.0 * capture.frames[1].t)


LEARNING = AdaAnchor4DSettings(
    preset="test",
    coarse_iterations=250,
    fine_iterations=20,
    voxel_px=1.5,
    refine_poses=True,
    rates=replace(PRESETS["quick"].rates, poses=Decay(4e-3, 4e-4)),
    densification=AnchorDensification(statistics_from=2, start=10, interval=10, until=30, voxel_factor=4),
)


def with_noise(capture: Capture, twists: np.ndarray) -> Capture:
    frame = ModelFrame(20.0, np.zeros(3))
    frames = list(capture.frames)
    for i, twist in zip(capture.of_split("train"), twists, strict=True):
        frames[i] = dataclasses.replace(frames[i], viewmat=moved(frames[i].viewmat, twist, frame))
    return dataclasses.replace(capture, frames=tuple(frames))


def viewmats_of(model: Path) -> dict[str, np.ndarray]:
    return {frame.name: frame.viewmat for frame in load_model(model).frames}


def pixels_off(capture: Capture, run: Path) -> float:
    """How far, in pixels, the ground's middle lies from where the true cameras see it, with one shift for all."""
    viewmats = viewmats_of(run / "coarse.safetensors")
    off = []
    for i in capture.of_split("train"):
        truth, found = capture.frames[i].viewmat, viewmats[capture.frames[i].name]
        ground = np.linalg.inv(truth) @ [0, 0, 20.0, 1]
        seen = capture.camera.K @ (found @ ground)[:3]
        off.append(seen[:2] / seen[2] - capture.camera.K[:2, 2])
    return float(np.linalg.norm(np.array(off) - np.mean(off, axis=0), axis=1).mean())


def test_noisy_cameras_come_nearer_to_the_truth(toy_capture: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_capture)
    generator = np.random.default_rng(5)
    twists = generator.normal(size=(8, 6)) * [0.01, 0.01, 0.01, 0.02, 0.02, 0.005]
    noisy = with_noise(capture, twists)
    train(noisy, tmp_path / "given", replace(LEARNING, refine_poses=False), silent)
    train(noisy, tmp_path / "learned", LEARNING, silent)
    before, after = pixels_off(capture, tmp_path / "given"), pixels_off(capture, tmp_path / "learned")
    assert before > 0.5
    assert after < 0.5 * before


def test_off_by_default_and_without_a_trace(toy_capture: Path, tmp_path: Path) -> None:
    config = replace(LEARNING, refine_poses=False, coarse_iterations=3, fine_iterations=3)
    config = replace(config, model=replace(config.model, temporal_resolution=4))
    run = Run(training_frames(read_capture(toy_capture), torch.device("cpu")), tmp_path / "run", config)
    assert run.initial_state().poses is None
    assert not AdaAnchor4DSettings(preset="x", coarse_iterations=1, fine_iterations=1).refine_poses


def test_interrupted_and_continued_equals_uninterrupted_with_poses(toy_capture: Path, tmp_path: Path) -> None:
    import os
    import signal

    capture = read_capture(toy_capture)
    config = replace(LEARNING, coarse_iterations=30, fine_iterations=20)
    train(capture, tmp_path / "whole", config, silent)

    def interrupt(stage: str, iteration: int, *_: object) -> None:
        if (stage, iteration) == ("fine", 7):
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted):
        train(capture, tmp_path / "parts", config, interrupt)
    train(capture, tmp_path / "parts", config, silent)
    whole, parts = (load_model(tmp_path / name / "model.safetensors") for name in ("whole", "parts"))
    for a, b in zip(whole.frames, parts.frames, strict=True):
        assert np.array_equal(a.viewmat, b.viewmat), a.name
    assert not np.array_equal(whole.frames[1].viewmat, capture.frames[1].viewmat)
    for name, value in whole.model.state_dict().items():
        assert torch.equal(value, parts.model.state_dict()[name]), name
