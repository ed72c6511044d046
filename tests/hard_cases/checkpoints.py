"""Checkpoints and tracks of a run: files cut short, of another shape, or that hold what no training could."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from aa4d.anchors.canonical import Anchors
from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.methods.adaanchor4d.model import AdaAnchor4D
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings, ModelConfig
from aa4d.motion.tracks import Tracks
from aa4d.motion.tracks_file import load_tracks, save_tracks
from aa4d.stress.cases import Part
from aa4d.training.checkpoints import TrainingState, load_checkpoint, save_checkpoint
from aa4d.training.optimiser import make_optimiser
from aa4d.training.spent import Spent
from tests.hard_cases.errors import refusal

PART = Part("checkpoints")
SETTINGS = AdaAnchor4DSettings(
    preset="test",
    coarse_iterations=10,
    fine_iterations=10,
    model=ModelConfig(offsets=2, plane_dim=4, spatial_resolutions=(4,), temporal_resolution=3),
)
CPU = torch.device("cpu")


@cache
def checkpoint() -> bytes:
    """A whole one, of five anchors after one step."""
    torch.manual_seed(0)
    anchors = Anchors(torch.randn(5, 3), torch.zeros(5, 6), 2, 32, 32)
    model = AdaAnchor4D(SETTINGS.model, anchors)
    optimiser = make_optimiser(model, SETTINGS.rates, canonical=False)
    sum(p.square().sum() for p in model.parameters()).backward()  # type: ignore[union-attr]
    optimiser.step()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.safetensors"
        save_checkpoint(path, TrainingState("fine", 7, Spent(1.5, 1.5), model, optimiser, Statistics.zeros(5, 2)))
        return path.read_bytes()


def loaded(change: Callable[[Path], object]) -> TrainingState:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.safetensors"
        path.write_bytes(checkpoint())
        change(path)
        return load_checkpoint(path, SETTINGS, CPU)


def rewritten(state: Callable[[dict[str, Any]], object], tensors: Callable[[dict[str, torch.Tensor]], object]) -> Any:
    def change(path: Path) -> None:
        with safe_open(str(path), framework="pt") as file:
            position = json.loads(file.metadata()["state"])
            held = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118, not a dict
        state(position)
        tensors(held)
        save_file(held, str(path), metadata={"state": json.dumps(position)})

    return change


def nothing(_: object) -> None:
    pass


@PART.case(why="a round trip that loses a bit changes the run that goes on", done="every tensor as it was")
def round_trip() -> float:
    first, second = loaded(nothing), loaded(nothing)
    assert (first.stage, first.iteration, first.spent.seconds) == ("fine", 7, 1.5)
    pairs = zip(first.model.state_dict().values(), second.model.state_dict().values(), strict=True)
    return max(float((a.double() - b.double()).abs().max()) for a, b in pairs)


@PART.case(
    why="killed while it was written, or a disk that was full",
    done="refused in one sentence",
    each={f"the first {n} bytes": n for n in (0, 7, 8, 200, 5000)},
)
def cut_short(size: int) -> float:
    return refusal(InputError, lambda: loaded(lambda path: path.write_bytes(path.read_bytes()[:size])), "checkpoint")


@PART.case(
    why="something else under its name",
    done="refused in one sentence; nothing is unpickled",
    each={"a pickle": b"\x80\x05cos\nsystem\n.", "zeros": bytes(4096), "a huge header": b"\xff" * 64},
)
def another_file(content: bytes) -> float:
    return refusal(InputError, lambda: loaded(lambda path: path.write_bytes(content)), "checkpoint")


@PART.case(
    why="a run that goes on with other anchors' moments",
    done="refused with what does not fit",
    each={"a parameter of fewer rows": "model.anchors.feature", "statistics of fewer rows": "statistics.seen"},
)
def tensors_of_another_shape(name: str) -> float:
    def change(tensors: dict[str, torch.Tensor]) -> None:
        tensors[name] = tensors[name][:3].clone()

    return refusal(InputError, lambda: loaded(rewritten(nothing, change)), "checkpoint")


@PART.case(
    why="a tensor that is missing",
    done="refused with its name",
    each={
        "a parameter": "model.anchors.offset",
        "a moment": "adam.exp_avg.anchors.offset",
        "statistics": "statistics.drawn",
    },
)
def a_tensor_is_missing(name: str) -> float:
    return refusal(InputError, lambda: loaded(rewritten(nothing, lambda tensors: tensors.pop(name))), "checkpoint")


def tracks(movers: int = 2) -> Tracks:
    labels = np.zeros((3, 4, 5), np.uint16)
    labels[:, 1, 1] = min(movers, 1)
    return Tracks(
        names=tuple(f"mover {i}" for i in range(movers)),
        control=np.zeros((movers, 4, 4)),
        shown=np.tile([-2.0, -1, 2, 3], (movers, 1)),
        up=np.array([0.0, 0, 1]),
        labels=labels,
        moving=labels > 0,
    )


def read_back(content: Callable[[bytes], bytes], movers: int = 2) -> Tracks:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tracks.npz"
        save_tracks(path, tracks(movers))
        path.write_bytes(content(path.read_bytes()))
        return load_tracks(path)


@PART.case(why="nobody moves: arrays of no rows", done="kept as such")
def tracks_of_nobody() -> float:
    return float(len(read_back(lambda b: b, movers=0)) + read_back(lambda b: b, movers=0).labels.max())


@PART.case(why="a track file cut short", done="refused in one sentence", each={f"{n} bytes": n for n in (0, 10, 400)})
def tracks_cut_short(size: int) -> float:
    return refusal(InputError, lambda: read_back(lambda b: b[:size]), "tracks")


@PART.case(
    why="tracks at infinity, or pixels of a mover that is not there",
    done="refused: they do not fit together",
    each={"infinite": ("control", math.inf), "NaN": ("up", math.nan), "label 9": ("labels", 9)},
)
def tracks_that_do_not_fit(change: tuple[str, float]) -> float:
    name, value = change

    def spoiled() -> Tracks:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "tracks.npz"
            changed = tracks()
            getattr(changed, name).flat[0] = value
            save_tracks(path, changed)
            return load_tracks(path)

    return refusal(InputError, spoiled, "tracks")
