import math
from dataclasses import fields

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from aa4d.anchors.canonical import Anchors
from aa4d.methods.adaanchor4d.model import AdaAnchor4D
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.rendering import render
from aa4d.motion.groups import Groups, Pose, carry, pose_of
from aa4d.motion.tracks import ALWAYS
from aa4d.raster.types import Camera, Gaussians

UP = torch.nn.functional.normalize(torch.tensor([0.2, -0.3, 1.0], dtype=torch.float64), dim=0)
HEADINGS = torch.tensor([2.5, -0.7, 9.0, 0.0], dtype=torch.float64)


def random_pose(groups: int) -> Pose:
    generator = torch.Generator().manual_seed(5)
    position = torch.randn(groups, 3, generator=generator).double()
    return pose_of(position, HEADINGS[:groups], UP)


def scipy_rotation(group: int) -> Rotation:
    return Rotation.from_rotvec((UP * HEADINGS[group]).numpy())


def gaussians(count: int) -> Gaussians:
    generator = torch.Generator().manual_seed(1)
    one = lambda *shape: torch.rand(*shape, generator=generator, dtype=torch.float64)  # noqa: E731
    return Gaussians(one(count, 3), one(count, 4) - 0.5, one(count, 3), one(count), one(count, 3))


def test_points_and_rotations_ride_as_scipy_turns_them() -> None:
    pose = random_pose(4)
    x = torch.randn(4, 3, 3, dtype=torch.float64)
    q = torch.nn.functional.normalize(torch.randn(4, 3, 4, dtype=torch.float64), dim=-1)
    moved, turned = pose.to_world(x), pose.turn(q)
    for g in range(4):
        R = scipy_rotation(g)
        np.testing.assert_allclose(moved[g], R.apply(x[g].numpy()) + pose.position[g].numpy(), atol=1e-12)
        expected = R * Rotation.from_quat(q[g].numpy()[:, [1, 2, 3, 0]])
        found = Rotation.from_quat(turned[g].numpy()[:, [1, 2, 3, 0]])
        np.testing.assert_allclose(found.as_matrix(), expected.as_matrix(), atol=1e-12)
    torch.testing.assert_close(pose.to_group(moved), x)


def test_carry_moves_grouped_anchors_alone_and_fades_them() -> None:
    pose, before = random_pose(2), gaussians(4 * 3)
    rows = torch.tensor([1, 3])
    after = carry(before, 4, rows, pose, torch.tensor([0.25, 1.0], dtype=torch.float64))
    world = [0, 1, 2, 6, 7, 8]
    for field in fields(Gaussians):
        value, old = getattr(after, field.name), getattr(before, field.name)
        if value is not None:
            assert torch.equal(value[world], old[world])
    torch.testing.assert_close(after.opacities[3:6], before.opacities[3:6] * 0.25)
    assert torch.equal(after.opacities[9:], before.opacities[9:])
    torch.testing.assert_close(after.means[9:], pose.at(torch.tensor([1])).to_world(before.means[None, 9:])[0])


def test_gradients_of_the_ride_agree_with_finite_differences() -> None:
    before, rows = gaussians(3 * 2), torch.tensor([0, 2])

    def ride(position: Tensor, heading: Tensor, means: Tensor) -> tuple[Tensor, Tensor]:
        pose = pose_of(position, heading, UP)
        moved = Gaussians(means, before.quaternions, before.scales, before.opacities, before.colors)
        after = carry(moved, 3, rows, pose, torch.ones(2, dtype=torch.float64))
        return after.means, after.quaternions

    pose = random_pose(2)
    inputs = [v.clone().requires_grad_() for v in (pose.position, HEADINGS[:2], before.means)]
    assert torch.autograd.gradcheck(ride, inputs)


def make_groups(*shown: tuple[float, ...]) -> Groups:
    count = len(shown)
    control = torch.zeros(count, 6, 4)
    control[..., 0] = torch.linspace(-0.2, 0.2, 6)
    return Groups(
        tuple(f"mover {g}" for g in range(count)),
        control,
        torch.zeros(count, 4),
        torch.tensor(shown),
        torch.tensor([0.0, 0, 1]),
    )


def test_presence_rises_and_falls_over_half_a_frame() -> None:
    groups = make_groups((0.1, 0.2, 0.6, 0.8), ALWAYS, (0.5, 0.5, 0.5, 0.5))
    for t, expected in ((0.0, (0, 1, 0)), (0.15, (0.5, 1, 0)), (0.4, (1, 1, 0)), (0.7, (0.5, 1, 0)), (1.0, (0, 1, 0))):
        torch.testing.assert_close(groups.presence(t), torch.tensor(expected, dtype=torch.float32))


def riding_model() -> tuple[AdaAnchor4D, Camera]:
    """A world anchor and one that slides along x, before a camera that looks down."""
    torch.manual_seed(0)
    config = ModelConfig(
        offsets=2, feature_dim=4, embedding_dim=4, plane_dim=4, spatial_resolutions=(8,), temporal_resolution=25
    )
    anchors = Anchors(torch.tensor([[0.0, 0.3, 0], [0.0, 0, 0]]), torch.full((2, 6), -3.0), 2, 4, 4)
    model = AdaAnchor4D(config, anchors)
    model.ride(make_groups((0.0, 0.1, 2.0, 3.0)), torch.tensor([-1, 0]))
    viewmat = torch.diag(torch.tensor([1.0, -1, -1, 1]))
    viewmat[2, 3] = 1
    return model, Camera(viewmat, torch.tensor([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40)


def test_anchors_are_visible_where_they_are_and_while_they_are_there() -> None:
    model, camera = riding_model()
    background = torch.zeros(3)
    assert render(model, 0.5, camera, background).visible.tolist() == [0, 1]
    assert render(model, 0.0, camera, background).visible.tolist() == [0]
    with torch.no_grad():
        assert model.groups is not None
        model.groups.position[..., 0] += 5.0  # far out of the picture, though its reference is in it
    assert render(model, 0.5, camera, background).visible.tolist() == [0]
    assert render(model, None, camera, background).visible.tolist() == [0, 1]


def test_what_rides_is_drawn_where_its_trajectory_is() -> None:
    model, camera = riding_model()
    for t in (0.2, 0.7):
        drawn = model.gaussians(t, camera)
        assert model.groups is not None
        expected = model.groups.pose(t).position[0]
        torch.testing.assert_close(drawn.means[2:], expected.expand(2, 3) + model.anchors.offset[1])
        torch.testing.assert_close(model.centers(t)[1], expected)


def test_a_ride_does_not_change_how_a_mover_looks_from_its_own_side() -> None:
    """The decoder sees the camera from the group's frame: mover and camera turned alike give the same colors."""
    model, camera = riding_model()
    groups = model.groups
    assert groups is not None
    with torch.no_grad():
        still = model.gaussians(0.5, camera)
        position, eye = groups.pose(0.5).position[0], -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
        groups.heading += math.pi / 2
        quarter = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        viewmat = torch.eye(4)
        viewmat[:3, 3] = -(quarter @ (eye - position) + position)
        turned = model.gaussians(0.5, Camera(viewmat, camera.K, 40, 40))
    torch.testing.assert_close(turned.colors[2:], still.colors[2:])
    torch.testing.assert_close(turned.opacities[2:], still.opacities[2:])
