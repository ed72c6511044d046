"""The whole model, anchor by anchor and number by number, as the paper writes it; gradients by finite differences."""

import math

import numpy as np
import pytest
import torch

from aa4d.anchors.canonical import Anchors
from aa4d.field.mlp import TwoLayer
from aa4d.methods.adaanchor4d.model import AdaAnchor4D, embeddings_of
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.adaanchor4d.warping import density_adaptive_boundaries
from aa4d.raster.types import Camera, Gaussians

CONFIG = ModelConfig(
    offsets=2,
    feature_dim=3,
    embedding_dim=4,
    plane_dim=3,
    spatial_resolutions=(4, 7),
    temporal_resolution=5,
    bins=8,
    weight_hidden=6,
    geometry_hidden=5,
    encoder_width=6,
    decoder_hidden=5,
)
AXIS = {"x": 0, "y": 1, "z": 2, "t": 3}
PAIRS = ("xy", "xz", "yz", "xt", "yt", "zt")


def random_model(config: ModelConfig, anchors: int = 5) -> AdaAnchor4D:
    """Nothing in it is zero, uniform or at rest; some anchors stand outside the field's box."""
    torch.manual_seed(3)
    c = config
    model = AdaAnchor4D(
        c,
        Anchors(
            torch.randn(anchors, 3),
            0.3 * torch.randn(anchors, 6) - 1,
            c.offsets,
            c.feature_dim,
            c.embedding_dim,
            embeddings=embeddings_of(c),
            embedding_std=1.0,
        ),
    ).double()
    for parameter in model.parameters():
        if parameter.ndim > 1 and (parameter == parameter.flatten()[0]).all():
            torch.nn.init.normal_(parameter, std=0.4)
    for plane in model.field.parameters():
        torch.nn.init.uniform_(plane, -1, 1)
    model.field.box.copy_(torch.tensor([[-0.9, -1.1, -1.0], [1.2, 0.8, 0.7]]))
    if c.dacw:
        u = torch.randn(50, 3).clamp(-1, 1)
        model.warp.boundaries.copy_(density_adaptive_boundaries(u, c.bins, 1.0, 0.7, 0.1, 0.9))
    return model


def camera() -> Camera:
    viewmat = torch.eye(4, dtype=torch.float64)
    angle = 0.4
    viewmat[0, 0] = viewmat[1, 1] = math.cos(angle)
    viewmat[0, 1], viewmat[1, 0] = -math.sin(angle), math.sin(angle)
    viewmat[:3, 3] = torch.tensor([0.3, -0.2, 4.0])
    K = torch.tensor([[50.0, 0, 16], [0, 50, 12], [0, 0, 1]], dtype=torch.float64)
    return Camera(viewmat, K, 32, 24)


def network(layers: TwoLayer, x: np.ndarray) -> np.ndarray:
    w1, b1, w2, b2 = (
        p.detach().numpy() for p in (layers.hidden.weight, layers.hidden.bias, layers.output.weight, layers.output.bias)
    )
    return w2 @ np.maximum(w1 @ x + b1, 0) + b2


def texel(model: AdaAnchor4D, level: int, pair: str, row: int, column: int) -> np.ndarray:
    return model.field.by_level()[level][pair].detach().numpy()[row, column]


def read_plane(model: AdaAnchor4D, level: int, pair: str, query: list[float]) -> np.ndarray:
    rows, columns = model.field.by_level()[level][pair].shape[:2]
    x = (query[AXIS[pair[0]]] + 1) / 2 * (columns - 1)
    y = (query[AXIS[pair[1]]] + 1) / 2 * (rows - 1)
    c, r = min(math.floor(x), columns - 2), min(math.floor(y), rows - 2)
    a, b = x - c, y - r
    return (
        (1 - b) * (1 - a) * texel(model, level, pair, r, c)
        + (1 - b) * a * texel(model, level, pair, r, c + 1)
        + b * (1 - a) * texel(model, level, pair, r + 1, c)
        + b * a * texel(model, level, pair, r + 1, c + 1)
    )


def warped(model: AdaAnchor4D, u: float, axis: int) -> float:
    bins = model.warp.boundaries.shape[1] - 1
    edges = [-1 + 2 * b / bins for b in range(bins + 1)]
    output = model.warp.boundaries[axis].tolist()
    for b in range(1, bins + 1):
        if u <= edges[b]:
            return output[b - 1] + (u - edges[b - 1]) / (edges[b] - edges[b - 1]) * (output[b] - output[b - 1])
    raise AssertionError


def gaussians_of_anchor(model: AdaAnchor4D, i: int, t: float, centre: np.ndarray) -> list[list[float]]:
    """Mean, scale, opacity, colour and quaternion of each local Gaussian of anchor i."""
    c, a = model.config, model.anchors
    x, f = a.position[i].numpy(), a.feature[i].detach().numpy()
    offset, s = a.offset[i].detach().numpy(), np.exp(a.log_scale[i].detach().numpy())
    lower, upper = model.field.box.numpy()
    u = [min(max(2 * (x[d] - lower[d]) / (upper[d] - lower[d]) - 1, -1), 1) for d in range(3)]
    query = [*(warped(model, u[d], d) for d in range(3)), 2 * t - 1]

    e = a.embedding_acfa[i].detach().numpy()
    z = network(model.aggregation.predictor, np.append(e, t))
    h = []
    for level in range(len(c.spatial_resolutions)):
        g = {pair: read_plane(model, level, pair, query) for pair in PAIRS}
        for channel in range(c.plane_dim):
            scores = [math.exp(z[p * c.plane_dim + channel]) for p in range(6)]
            h.append(sum(scores[p] / sum(scores) * g[pair][channel] for p, pair in enumerate(PAIRS)))
    encoded = model.encoder.weight.detach().numpy() @ np.array(h) + model.encoder.bias.detach().numpy()
    encoded = np.maximum(encoded, 0)
    x, f = x + network(model.head_position, encoded), f + network(model.head_feature, encoded)
    if c.dlgd:
        e_o, e_s = (getattr(a, f"embedding_{name}")[i].detach().numpy() for name in ("offset", "scale"))
        offset = offset + network(model.dlgd_offset, np.append(e_o, t)).reshape(c.offsets, 3)
        s = s * np.exp(network(model.dlgd_scale, np.append(e_s, t)))

    view = np.append(f, (x - centre) / math.sqrt(sum((x - centre) ** 2)))
    opacity = [math.tanh(v) for v in network(model.decoder.opacity, view)]
    color = [1 / (1 + math.exp(-v)) for v in network(model.decoder.color, view)]
    covariance = network(model.decoder.covariance, view).reshape(c.offsets, 7)
    found = []
    for k in range(c.offsets):
        mean = [x[d] + offset[k][d] * s[d] for d in range(3)]
        scale = [s[3 + d] / (1 + math.exp(-covariance[k][d])) for d in range(3)]
        q = covariance[k][3:] / math.sqrt(sum(covariance[k][3:] ** 2))
        found.append([*mean, *scale, max(opacity[k], 0), *color[3 * k : 3 * k + 3], *q])
    return found


@pytest.mark.parametrize("t", [0.0, 0.31, 1.0])
@pytest.mark.parametrize(("dlgd", "dacw"), [(True, True), (False, True), (True, False)])
def test_the_model_agrees_with_the_paper_number_by_number(dlgd: bool, dacw: bool, t: float) -> None:
    model = random_model(ModelConfig(**{**vars(CONFIG), "dlgd": dlgd, "dacw": dacw}))
    view = camera()
    centre = (-view.viewmat[:3, :3].T @ view.viewmat[:3, 3]).numpy()
    with torch.no_grad():
        g = model.gaussians(t, view)
    ours = torch.cat(
        [g.means, g.scales, g.opacities[:, None], g.colors, torch.nn.functional.normalize(g.quaternions)], dim=1
    )
    expected = [row for i in range(5) for row in gaussians_of_anchor(model, i, t, centre)]
    assert ((g.opacities > 0) & (g.opacities < 1)).any()
    np.testing.assert_allclose(ours.numpy(), expected, rtol=1e-9, atol=1e-9)


def test_gradients_of_the_whole_model_agree_with_finite_differences() -> None:
    model = random_model(CONFIG, anchors=2)
    names, values = zip(*model.named_parameters(), strict=True)

    def run(*parameters: torch.Tensor) -> tuple[torch.Tensor, ...]:
        g: Gaussians = torch.func.functional_call(
            _Shown(model), {f"model.{name}": p for name, p in zip(names, parameters, strict=True)}, ()
        )
        return g.means, g.scales, g.opacities, g.colors, g.quaternions

    assert torch.autograd.gradcheck(run, tuple(v.detach().requires_grad_() for v in values), atol=1e-6, fast_mode=True)


class _Shown(torch.nn.Module):
    """`gaussians` as a forward pass, which `functional_call` asks for."""

    def __init__(self, model: AdaAnchor4D) -> None:
        super().__init__()
        self.model = model

    def forward(self) -> Gaussians:
        return self.model.gaussians(0.37, camera())


@pytest.mark.parametrize("aggregation", ["acfa", "anchor_only", "time_only"])
def test_training_starts_at_uniform_weights_and_the_canonical_geometry(aggregation: str) -> None:
    torch.manual_seed(0)
    config = ModelConfig(spatial_resolutions=(4,), temporal_resolution=4, aggregation=aggregation)
    model = AdaAnchor4D(config, Anchors(torch.randn(6, 3), torch.zeros(6, 6), 10, 32, 32, embedding_std=3.0))
    rows = model.anchors.rows()
    weights = model.aggregation.weights(rows.embedding_acfa, 0.7)
    assert torch.equal(weights, torch.full_like(weights, 1 / 6))
    deformed, canonical = model.deformed(rows, 0.7), model.canonical(rows)
    for name in ("position", "feature", "offset", "scale"):
        assert torch.equal(getattr(deformed, name), getattr(canonical, name)), name


def test_variants_of_one_seed_start_from_the_same_planes_and_decoder() -> None:
    models = []
    for change in ({}, {"dlgd": False}, {"aggregation": "product", "dacw": False}):
        torch.manual_seed(1)
        config = ModelConfig(**{**vars(CONFIG), **change})
        models.append(AdaAnchor4D(config, Anchors(torch.zeros(2, 3), torch.zeros(2, 6), 2, 3, 4)).state_dict())
    for name, value in models[0].items():
        if name.startswith(("field.", "decoder.", "encoder.", "head_")):
            assert torch.equal(value, models[1][name]), name
            assert torch.equal(value, models[2][name]), name
