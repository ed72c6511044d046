"""The numpy evaluation against the torch model that writes the files."""

from pathlib import Path

import numpy as np
import pytest
from model_files import add_groups, make_model, write_model

from addon.field import anchor_positions, anchor_state, local_gaussians, prepare, to_world
from addon.model import read_model

torch = pytest.importorskip("torch")
model_file = pytest.importorskip("aa4d.methods.model_file")
files = pytest.importorskip("aa4d.methods.adaanchor4d.files")


@pytest.mark.parametrize("t", [0.0, 0.25, 0.37, 0.5, 0.7625, 1.0])
@pytest.mark.parametrize("up", [None, (0.0, 0.0, 1.0), (0.3, -0.5, 0.7)])  # None: no groups
def test_numpy_agrees_with_torch(t: float, up: tuple[float, float, float] | None, tmp_path: Path) -> None:
    from aa4d.anchors.canonical import Anchors
    from aa4d.methods.adaanchor4d.model import AdaAnchor4D
    from aa4d.methods.adaanchor4d.settings import ModelConfig
    from aa4d.raster.types import Camera

    config = ModelConfig(
        offsets=4,
        feature_dim=8,
        embedding_dim=6,
        plane_dim=5,
        spatial_resolutions=(6, 11),
        temporal_resolution=4,
        bins=8,
    )
    generator = torch.Generator().manual_seed(3)
    count = 300
    anchors = Anchors(
        torch.empty(count, 3).uniform_(-1.1, 1.1, generator=generator),
        torch.empty(count, 6).uniform_(-4, -2, generator=generator),
        config.offsets,
        config.feature_dim,
        config.embedding_dim,
    )
    model = AdaAnchor4D(config, anchors)
    state = {name: value.clone() for name, value in model.state_dict().items()}
    for name, value in state.items():
        if name not in ("anchors.position", "anchors.log_scale", "field.box", "warp.boundaries"):
            value.normal_(0, 0.25, generator=generator)
    state["field.box"] = torch.tensor([[-1.0, -0.9, -1.2], [1.0, 1.1, 0.8]])
    steps = torch.empty(3, config.bins).uniform_(0.3, 1, generator=generator).cumsum(1)
    state["warp.boundaries"] = torch.cat([-torch.ones(3, 1), 2 * steps / steps[:, -1:] - 1], 1)

    _, information = make_model()
    sizes = ("offsets", "feature_dim", "embedding_dim", "plane_dim", "bins")
    information["config"].update({name: getattr(config, name) for name in sizes})
    tensors = {
        files.file_name_of(name): files.as_in_file(name, value).contiguous().numpy() for name, value in state.items()
    }
    if up is not None:
        add_groups(tensors, information, 3, up, np.random.default_rng(2))
    path = write_model(tmp_path / "model.safetensors", tensors, information)

    numpy_model = read_model(path)
    center = np.array([60.0, -30.0, 25.0])
    now = anchor_state(prepare(numpy_model), t)
    gaussians = local_gaussians(prepare(numpy_model), now, center)
    viewmat = torch.eye(4)
    viewmat[:3, 3] = -torch.from_numpy((center - numpy_model.translation) / numpy_model.scale)
    with torch.no_grad():
        torch_model = model_file.load_model(path).model
        expected = torch_model.gaussians(t, Camera(viewmat, torch.eye(3), 1, 1))
        anchors = torch_model.centers(t).numpy()
    extent = np.ptp(tensors["anchors.position"], axis=0).max()
    np.testing.assert_allclose(anchor_positions(prepare(numpy_model), t), anchors, atol=1e-5)
    assert np.abs(now.positions - tensors["anchors.position"]).max() > 0.01 * extent
    means = to_world(numpy_model, expected.means.numpy()).reshape(gaussians.positions.shape)
    assert np.abs(gaussians.positions - means).max() < 1e-5 * extent * numpy_model.scale
    np.testing.assert_allclose(gaussians.colors.reshape(-1, 3), expected.colors.numpy(), atol=1e-5)
    np.testing.assert_allclose(np.maximum(gaussians.opacities, 0).ravel(), expected.opacities.numpy(), atol=1e-5)
    scales = gaussians.scales.reshape(-1, 3) / numpy_model.scale
    np.testing.assert_allclose(scales, expected.scales.numpy(), rtol=1e-4)
    quaternions = expected.quaternions.numpy()
    quaternions = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    np.testing.assert_allclose(gaussians.quaternions.reshape(-1, 4), quaternions, atol=2e-5)
