"""MoRel's windows, weights, levels and growth against their formulas, written out number by number in float64."""

import math
import statistics
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from aa4d.anchors.densification import Statistics
from aa4d.capture.reader import read_capture
from aa4d.evaluation.evaluate import evaluate
from aa4d.methods.contract import Stage
from aa4d.methods.morel.levels import growth_weight, levels_of
from aa4d.methods.morel.method import METHOD
from aa4d.methods.morel.model import MoRel, Phase, blank_model
from aa4d.methods.morel.settings import PRESETS, ModelConfig, MoRelSettings
from aa4d.methods.morel.windows import SOFTPLUS_OF_ONE, key_time, learned_weight, local_time, nearest, neighbours
from aa4d.methods.settings import with_iterations
from aa4d.raster.types import Camera
from aa4d.training.frames import training_frames
from aa4d.training.trainer import Run, train
from tests.methods.formulas import linear, relu, texel
from tests.toy_capture import write_toy_capture

CONFIG = ModelConfig(
    offsets=2,
    feature_dim=4,
    decoder_hidden=5,
    keys=3,
    plane_dim=3,
    spatial_resolutions=(4, 6),
    temporal_resolution=5,
    width=6,
)
CAMERA = Camera(torch.eye(4).double(), torch.tensor([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]]).double(), 48, 32)


def random_model(config: ModelConfig = CONFIG, n: int = 6, phase: Phase = Phase.BLENDED) -> MoRel:
    torch.manual_seed(0)
    model = blank_model(config, n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
        model.anchors.position.uniform_(-1, 1)
        model.key.copy_(torch.arange(n) % model.keys)
        model.phase.fill_(int(phase))
        for window in model.deformations():
            window.field.box.copy_(torch.tensor([[-1.0, -2, -3], [2, 1, 0.5]]))
    return model


def test_key_frames_cover_the_clip_and_an_instant_has_its_two_neighbours() -> None:
    assert [key_time(n, 5) for n in range(5)] == [0, 0.25, 0.5, 0.75, 1]
    assert [neighbours(t, 5) for t in (0, 0.1, 0.25, 0.999, 1)] == [(0, 1), (0, 1), (1, 2), (3, 4), (3, 4)]
    assert [nearest(t, 5) for t in (0, 0.1, 0.13, 0.95, 1)] == [0, 0, 1, 4, 4]
    assert local_time(0.3, 1, 5) == pytest.approx(0.2)
    assert local_time(0.3, 2, 5) == pytest.approx(-0.8)
    assert local_time(0.0, 4, 5) == -1, "outside of its window it stays at the end"


@pytest.mark.parametrize("t", [0.0, 0.3, 0.5, 0.85])
def test_the_deformation_agrees_with_the_formulas_number_by_number(t: float) -> None:
    model = random_model().requires_grad_(False)
    with torch.no_grad():
        after = model.deformed(model.anchors.rows(), model.key, t)
    for i in range(len(model)):
        n = int(model.key[i])
        window, tau = model.deformations()[n], min(max((t - n / 2) / 0.5, -1), 1)
        corners = list(zip("xyz", *window.field.box.tolist(), strict=True))
        place = model.anchors.position[i].tolist()
        u = {
            axis: min(max(2 * (p - low) / (high - low) - 1, -1), 1)
            for (axis, low, high), p in zip(corners, place, strict=True)
        }
        u["t"] = tau
        features: list[float] = []
        for level in window.field.by_level():
            product = [1.0] * CONFIG.plane_dim
            for a, b in ("xy", "xz", "yz", "xt", "yt", "zt"):
                product = [p * v for p, v in zip(product, texel(level[a + b], u[a], u[b]), strict=True)]
            features += product
        z = relu(linear(window.encoder, features))

        def residual(head: nn.Module, z: list[float] = z) -> list[float]:
            return linear(head.output, relu(linear(head.hidden, z)))

        def moved(value: Tensor, head: nn.Module) -> list[float]:
            return [a + b for a, b in zip(value.flatten().tolist(), residual(head), strict=True)]

        own = model.anchors
        for name, got, expected in (
            ("position", after.position, moved(own.position[i], window.head_position)),
            ("feature", after.feature, moved(own.feature[i], window.head_feature)),
            ("offset", after.offset, moved(own.offset[i], window.head_offset)),
            ("scale", after.scale, [math.exp(v) for v in moved(own.log_scale[i], window.head_log_scale)]),
        ):
            assert got[i].flatten().tolist() == pytest.approx(expected, rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("t", [0.0, 0.2, 0.5, 0.9, 1.0])
def test_weights_agree_with_the_formula_and_multiply_the_opacities(t: float) -> None:
    model = random_model().requires_grad_(False)
    lower = min(int(2 * t), 1)
    expected = []
    for i in range(len(model)):
        n = int(model.key[i])
        if n not in (lower, lower + 1):
            expected.append(0.0)
            continue
        tau = 2 * t - n
        side = 1 if tau >= 0 else 0
        o, d = float(model.blend_center[i, side]), math.log1p(math.exp(float(model.blend_decay[i, side])))
        expected.append(math.exp(-CONFIG.decay_strength * d * abs(tau - o)))
    with torch.no_grad():
        weights = model.weights(model.key, t)
        some = torch.tensor([1, 2, 4])
        assert torch.equal(model.weights(model.key[some], t, some), weights[some])
        gaussians = model.gaussians(t, CAMERA)
        bare = model.decoder(model.deformed(model.anchors.rows(), model.key, t), torch.zeros(3).double())
    assert weights.tolist() == pytest.approx(expected, rel=1e-12)
    assert torch.allclose(gaussians.opacities, bare.opacities * weights.repeat_interleave(2))
    assert model.present(t).tolist() == [w > 0 for w in expected]


def test_before_anything_is_learned_a_key_frame_shows_itself_and_weights_fall_with_time() -> None:
    o, d = torch.zeros(1, 2).double(), torch.full((1, 2), SOFTPLUS_OF_ONE).double()
    assert learned_weight(0.0, o, d, 1.5).item() == 1
    assert learned_weight(-1.0, o, d, 1.5).item() == pytest.approx(math.exp(-1.5))
    model = random_model(phase=Phase.WINDOWS)
    assert model.weights(model.key, 0.35).tolist() == pytest.approx([0.3, 0.7, 0, 0.3, 0.7, 0])
    model.side = 1
    assert model.weights(model.key, 0.35).tolist() == [0, 1, 0, 0, 1, 0]
    model.phase.fill_(int(Phase.KEYS))
    assert model.weights(model.key, 0.2).tolist() == [1, 0, 0, 1, 0, 0]
    assert model.weights(model.key, None).tolist() == [1, 0, 0, 1, 0, 0]


def test_gradients_are_those_of_finite_differences() -> None:
    small = ModelConfig(
        offsets=1,
        feature_dim=2,
        decoder_hidden=3,
        keys=2,
        plane_dim=2,
        spatial_resolutions=(4,),
        temporal_resolution=3,
        width=3,
    )
    model = random_model(small, n=3)
    with torch.no_grad():
        model.blend_center.copy_(torch.tensor([[0.1, -0.2], [0.3, 0.15], [-0.4, 0.2]]))
    window = model.deformations()[0]
    owned = [
        model.anchors.feature,
        model.anchors.offset,
        model.anchors.log_scale,
        model.blend_center,
        model.blend_decay,
    ]
    shared = [*window.field.parameters(), *window.head_position.parameters(), *window.encoder.parameters()]

    def drawn(*_: Tensor) -> tuple[Tensor, ...]:
        state = model.deformed(model.anchors.rows(), model.key, 0.4)
        return state.position, state.feature, state.offset, state.scale, model.weights(model.key, 0.4)

    assert torch.autograd.gradcheck(drawn, (*owned, *shared))


def test_levels_are_by_the_variance_of_features_and_only_the_lowest_grows_at_once() -> None:
    torch.manual_seed(1)
    feature = torch.randn(30, 8).double() * torch.rand(30, 1).double()
    variance = [statistics.pvariance(row) for row in feature.tolist()]
    ranked = sorted(variance)
    low, high = (ranked[int(9.666)] * 1 / 3 + ranked[10] * 2 / 3, ranked[19] * 2 / 3 + ranked[20] / 3)
    expected = [0 if v < low else 1 if v < high else 2 for v in variance]
    assert levels_of(feature, (1 / 3, 2 / 3)).tolist() == expected
    assert growth_weight(torch.tensor([0, 1, 2]), 0.3, 0.0).tolist() == pytest.approx([1, 0.3, 0.3])
    assert growth_weight(torch.tensor([0, 1, 2]), 0.3, 0.5).tolist() == pytest.approx([1, 0.65, 0.65])
    assert growth_weight(torch.tensor([0, 1, 2]), 0.3, 1.0).tolist() == [1, 1, 1]


def grown(model: MoRel, progress: float) -> tuple[list[int], list[list[float]]]:
    """Parents and places of what grows where every Gaussian has a gradient of 1.5 times the first threshold."""
    settings, n = PRESETS["quick"], len(model)
    model.progress = progress
    gradient = 1.5 * settings.densification.gradient_threshold
    many = torch.full((n, model.per_unit), 1000.0)
    found = Statistics(torch.full((n,), 1000.0), torch.full((n,), 1000.0), gradient * many, many.clone())
    edit = METHOD.edit(model, found, settings, 0.02, torch.Generator().manual_seed(0))
    assert edit.keep.tolist() == list(range(n))
    return edit.parent.tolist(), edit.values["anchors.position"].tolist()


def test_growth_delays_high_levels_and_lets_each_key_frame_fill_the_same_place() -> None:
    model = random_model(n=12).float()
    with torch.no_grad():
        model.anchors.position.zero_()  # all key frames at the same place, with Gaussians of the same offsets
        model.anchors.offset.copy_(torch.linspace(1, 9, 2)[:, None].expand(12, 2, 3))
        model.anchors.log_scale.zero_()
    model.level.copy_(torch.tensor([0, 1] * 6))
    early, places = grown(model, 0.0)
    assert early
    assert {int(model.level[parent]) for parent in early} == {0}
    assert len({int(model.key[parent]) for parent in early}) > 1
    assert len(set(map(tuple, places))) < len(places), "the same voxel, filled by several key frames"
    late, _ = grown(model, 1.0)
    assert {int(model.level[parent]) for parent in late} == {0, 1}


def test_each_key_frame_begins_as_a_copy_of_the_global_anchors() -> None:
    model = random_model(n=4, phase=Phase.GLOBAL)
    model.key.zero_()
    before = {name: model.tensor(name).detach().clone() for name in model.unit_tensors()}
    settings = MoRelSettings(preset="x", coarse_iterations=1, fine_iterations=10, model=CONFIG)
    METHOD.enter(Stage("keys", 2, draws=1), model, settings)
    assert len(model) == 12
    assert model.key.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert model.level[:4].tolist() == levels_of(model.anchors.feature[:4], (0.333, 0.667)).tolist()
    for name in ("anchors.feature", "anchors.offset", "anchors.position"):
        for n in range(3):
            assert torch.equal(model.tensor(name)[4 * n : 4 * n + 4], before[name]), name
    with torch.no_grad():
        still = model.gaussians(None, CAMERA, model.visible(None, CAMERA))
    assert len(still.means) == 2 * int((model.visible(None, CAMERA) < 4).sum())


def test_stages_share_the_fine_iterations_and_keys_look_near_their_frames() -> None:
    settings = METHOD.resolved(PRESETS["quick"], 49)
    assert settings.model.keys == 5
    coarse, keys, windows, blending = METHOD.stages(settings)
    assert [s.iterations for s in (coarse, keys, windows, blending)] == [800, 600, 1800, 600]
    assert keys.looks_at(0.25 + 0.06)
    assert not keys.looks_at(0.25 + 0.07)
    assert windows.looks_at(0.37)
    model = blank_model(settings.model, 3)
    sides = []
    for iteration in range(40):
        METHOD.begin_step(windows, iteration, model, settings)
        sides.append(model.side)
    assert set(sides) == {0, 1}
    model.phase.fill_(int(Phase.BLENDED))
    assert model.parameter_groups(canonical=False).keys() == {"blending"}


def test_it_shows_what_moves_better_than_its_static_stage(tmp_path: Path) -> None:
    """By 3 dB over the moving pixels of held-out frames of the square that slides."""
    settings = with_iterations(PRESETS["quick"], 100, 800)
    growth = replace(settings.densification, statistics_from=20, start=40, interval=20, until=200)
    settings = replace(settings, voxel_px=1.5, densification=growth, model=replace(settings.model, keys=3))
    capture = read_capture(write_toy_capture(tmp_path / "capture"))
    train(capture, tmp_path / "run", settings, lambda *_: None)
    metrics = evaluate(tmp_path / "run", None, lambda *_: None)
    assert metrics.psnr_dynamic is not None
    assert metrics.psnr_dynamic_static is not None
    assert metrics.psnr_dynamic > metrics.psnr_dynamic_static + 3


def test_a_stage_learns_from_the_frames_of_its_spans_alone(tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture"))
    run = Run(training_frames(capture, torch.device("cpu")), tmp_path, METHOD.resolved(PRESETS["quick"], 10))
    near, none = (Stage("keys", 9, draws=1, spans=(span,)) for span in ((0.3, 0.5), (0.89, 0.9)))
    times = [run.frames.views[i].t for step in range(9) for i in run._view_indices(near, step)]
    assert sorted(set(times)) == pytest.approx([3 / 9, 4 / 9])
    every = {i for step in range(8) for i in run._view_indices(none, step)}
    assert every == set(range(8)), "a span without a frame is no reason to stop"
