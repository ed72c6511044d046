"""SpeeDe3DGS's scores and schedule, and its groups through training, files and continued runs."""

import json
import math
import os
import signal
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.contract import Look
from aa4d.methods.d3dgs.settings import ModelConfig
from aa4d.methods.gaussians.model import blank_rows
from aa4d.methods.model_file import load_model, read_tensors
from aa4d.methods.speede.method import METHOD
from aa4d.methods.speede.model import Speede
from aa4d.methods.speede.sensitivity import most_sensitive, sensitivities
from aa4d.methods.speede.settings import PRESETS, FlowSettings, Pruning, SpeedeSettings
from aa4d.raster import Camera, Gaussians
from aa4d.raster.cutoffs import CUTOFFS
from aa4d.raster.reference import project
from aa4d.training.trainer import train
from tests.methods.test_every_method import ROOT, short, silent
from tests.toy_capture import write_toy_capture

CONFIG = ModelConfig(width=8, depth=3, skip=1, place_frequencies=2, time_frequencies=2)


def small_model(n: int = 30) -> Speede:
    torch.manual_seed(0)
    model = Speede(CONFIG, blank_rows(n), grouped=False)
    with torch.no_grad():
        model.free.position.copy_(torch.randn(n, 3) * torch.tensor([0.3, 0.2, 0.1]) + torch.tensor([0.0, 0, 1]))
        model.free.log_scale.normal_(-3, 0.3)
        model.free.quaternion.normal_()
        model.free.opacity.normal_()
        model.free.sh_constant.normal_()
    return model


def looks(count: int = 3) -> list[Look]:
    K = torch.tensor([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]])
    views = []
    for number in range(count):
        viewmat = torch.eye(4)
        viewmat[0, 3] = 0.05 * number
        views.append(Look(number / count, Camera(viewmat, K, 32, 24), torch.tensor([0.2, 0.5, 0.4])))
    return views


def score_of_pixel(alphas: list[float], colors: list[float], opacities: list[float], background: float) -> list[float]:
    """(o_i dI / d(alpha_i))^2 of Gaussians near to far, I and colors being sums of channels."""
    scores = []
    for i, alpha in enumerate(alphas):
        front, behind, left = 1.0, 0.0, 1.0
        for j, other in enumerate(alphas):
            if j < i:
                front *= 1 - other
            elif j > i:
                behind += left * other * colors[j]
                left *= 1 - other
        behind += left * background
        assert alpha < 0.99
        scores.append((opacities[i] * front * (colors[i] - behind)) ** 2)
    return scores


def test_scores_are_squares_of_single_pixels_summed_over_pixels_and_views() -> None:
    model, views = small_model(9), looks()
    cutoff = CUTOFFS["fast"].alpha
    expected = [0.0] * len(model)
    for look in views:
        with torch.no_grad():
            drawn = model.gaussians(look.t, look.camera)
        doubles = (drawn.means, drawn.quaternions, drawn.scales, drawn.opacities, drawn.colors)
        seen = project(Gaussians(*(value.double() for value in doubles)), look.camera, False, CUTOFFS["fast"])
        inverse = seen.covariances.inverse().tolist()
        centers, opacity, index = seen.centers.tolist(), seen.opacities.tolist(), seen.index.tolist()
        for y in range(24):
            for x in range(32):
                drawn_here: list[tuple[int, float]] = []
                for n, (cx, cy) in enumerate(centers):
                    dx, dy = x + 0.5 - cx, y + 0.5 - cy
                    (a, b), (_, c) = inverse[n]
                    alpha = opacity[n] * math.exp(-(a * dx * dx + 2 * b * dx * dy + c * dy * dy) / 2)
                    if alpha >= cutoff:
                        drawn_here.append((n, alpha))
                colors = [float(drawn.colors[index[n]].sum()) for n, _ in drawn_here]
                shares = [opacity[n] for n, _ in drawn_here]
                scores = score_of_pixel([a for _, a in drawn_here], colors, shares, float(look.background.sum()))
                for (n, _), score in zip(drawn_here, scores, strict=True):
                    expected[index[n]] += score
    assert sensitivities(model, views).tolist() == pytest.approx(expected, rel=1e-3)


def test_the_lowest_share_goes_and_ties_with_it() -> None:
    scores = torch.tensor([5.0, 1, 4, 2, 3, 0, 7, 6, 9, 8])
    assert most_sensitive(scores, 0.6).tolist() == [False] * 6 + [True, True, True, True]
    ties = torch.tensor([0.0, 0, 0, 0, 1])
    assert most_sensitive(ties, 0.3).tolist() == [False] * 4 + [True]


def test_what_hides_nothing_and_adds_nothing_goes_first() -> None:
    model = small_model(4)
    with torch.no_grad():
        model.free.position.copy_(torch.tensor([[0.0, 0, 1], [0.1, 0, 1], [9, 9, 1], [0.2, 0.1, 1]]))
        model.free.opacity.copy_(torch.tensor([3.0, -7, 3, 3]))
        model.free.log_scale.fill_(-3)
    scores = sensitivities(model, looks())
    assert scores[2] == 0
    assert scores[1] < 1e-3 * scores[[0, 3]].min()


def paper_settings() -> SpeedeSettings:
    return PRESETS["paper"]


def test_pruning_comes_when_the_publication_says() -> None:
    settings = paper_settings()
    coarse, fine = METHOD.stages(settings)
    times = {3000 + done: METHOD.pruned_share(fine, done, settings) for done in range(1, fine.iterations + 1)}
    assert {time: share for time, share in times.items() if share is not None} == {
        **dict.fromkeys((6000, 9000, 12_000), 0.6),
        **dict.fromkeys((15_000, 18_000, 21_000, 24_000, 27_000), 0.3),
    }
    assert METHOD.pruned_share(coarse, 3000, settings) is None


def test_groups_begin_half_way_and_stop_growth() -> None:
    settings = replace(paper_settings(), flow=FlowSettings())
    stages = METHOD.stages(settings)
    assert [(s.name, s.iterations, s.decay, s.changes_units) for s in stages] == [
        ("coarse", 3000, (0.0, 0.1), True),
        ("fine", 12_000, (0.1, 0.5), True),
        ("flow", 15_000, (0.5, 1.0), False),
    ]
    assert METHOD.done_of_run(stages[2], 3000, settings) == 18_000
    assert METHOD.pruned_share(stages[2], 3000, settings) == 0.3


def test_a_pruning_keeps_the_rows_that_matter_and_what_d3dgs_changes() -> None:
    model, settings = small_model(), replace(short("speede"), coarse_iterations=20, fine_iterations=80)
    assert isinstance(settings, SpeedeSettings)
    settings = replace(
        settings,
        pruning=Pruning(growing=0.5, noise=False),
        densification=replace(settings.densification, reset_every=19, until=60),
    )
    _, fine = METHOD.stages(settings)
    edit = METHOD.revise(fine, 20, model, settings, looks)  # iteration 40 of 100
    assert edit is not None
    scores = sensitivities(model, looks())
    expected = (scores > scores.sort().values[int(0.5 * 29)]).nonzero()[:, 0]
    assert torch.equal(edit.keep, expected)
    assert edit.parent.tolist() == []


def test_a_pruning_keeps_the_reset_that_comes_with_it() -> None:
    model, settings = small_model(), replace(short("speede"), coarse_iterations=20, fine_iterations=80)
    assert isinstance(settings, SpeedeSettings)
    settings = replace(settings, densification=replace(settings.densification, reset_every=39, until=60))
    edit = METHOD.revise(METHOD.stages(settings)[1], 20, model, settings, looks)  # iteration 40 = 39 + 1
    assert edit is not None
    assert len(edit.anew["free.opacity"]) == len(edit.keep) < 30
    assert torch.equal(edit.anew["free.opacity"], model.free.opacity.detach()[edit.keep].clamp_max(math.log(1 / 99)))


def grouped_settings() -> SpeedeSettings:
    settings = short("speede")
    assert isinstance(settings, SpeedeSettings)
    return replace(settings, model=replace(CONFIG, width=16), flow=FlowSettings(groups=40, members=10, times=6))


KILL = """
import os, signal, sys
from pathlib import Path
from aa4d.capture.reader import read_capture
from aa4d.training.trainer import train
from tests.methods.speede.test_speede import grouped_settings
import torch
torch.set_num_threads(1)
def progress(stage, iteration, *_):
    if (stage, iteration) == ("flow", 21):
        os.kill(os.getpid(), signal.SIGKILL)
train(read_capture(Path(sys.argv[1])), Path(sys.argv[2]), grouped_settings(), progress)
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run with groups, beside its capture."""
    folder = tmp_path_factory.mktemp("groups")
    train(read_capture(write_toy_capture(folder / "capture")), folder / "run", grouped_settings(), silent)
    return folder / "run"


def test_groups_survive_kill_and_are_read_back(run: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILL, str(run.parent / "capture"), str(tmp_path / "run")]
    killed = subprocess.run(command, cwd=ROOT, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=False)
    assert killed.returncode == -signal.SIGKILL
    train(read_capture(run.parent / "capture"), tmp_path / "run", grouped_settings(), silent)
    whole, parts = (read_tensors(folder / "model.safetensors")[1] for folder in (run, tmp_path / "run"))
    assert whole.keys() == parts.keys()
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name


def test_after_groups_the_first_view_rests_and_the_network_is_not_asked(run: Path) -> None:
    model = load_model(run / "model.safetensors").model
    assert isinstance(model, Speede)
    assert model.flow is not None
    assert model.flow.turn.shape == (40, 5, 3)
    first = float(model.flow.time[0])
    with torch.no_grad():
        assert torch.equal(model.centers(first), model.centers(None))
        moved = model.centers(0.9) - model.centers(None)
        for parameter in model.network.parameters():
            parameter.fill_(torch.nan)
        assert torch.equal(model.centers(0.9) - model.centers(None), moved)
    assert moved.abs().max() > 0


def test_the_static_stage_has_no_groups_yet(run: Path) -> None:
    model = load_model(run / "coarse.safetensors").model
    assert isinstance(model, Speede)
    assert model.flow is not None
    assert len(model.flow) == 0


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("label", lambda v: v + 1000, "label names a group that is not there"),
        ("flow.time", lambda v: -v, "flow.time goes back"),
        ("flow.turn", lambda v: v[:, :2].contiguous(), "the groups' tensors differ in size"),
    ],
)
def test_groups_that_no_training_writes_are_refused(
    run: Path, tmp_path: Path, name: str, change: object, message: str
) -> None:
    from safetensors.torch import save_file

    _, tensors = read_tensors(run / "model.safetensors")
    raw = (run / "model.safetensors").read_bytes()
    header = json.loads(raw[8 : 8 + struct.unpack("<Q", raw[:8])[0]])["__metadata__"]
    tensors[name] = change(tensors[name])
    save_file(tensors, str(tmp_path / "model.safetensors"), metadata=header)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path / "model.safetensors")
