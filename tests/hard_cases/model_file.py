"""The model file: what both readers, aa4d's and the extension's, make of headers and tensors at their limits."""

from __future__ import annotations

import json
import math
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from model_files import header_and_data, make_model, write_file, write_model

from aa4d.errors import InputError
from aa4d.methods.model_file import load_model
from aa4d.stress.cases import Part
from addon.container import ModelFileError
from addon.model import read_model
from tests.hard_cases.errors import refusal

PART = Part("model_file")


def refused_by_both(write: Callable[[Path], object], *words: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        write(path)
        return max(
            refusal(InputError, lambda: load_model(path), "model.safetensors", *words),
            refusal(ModelFileError, lambda: read_model(path), "model.safetensors", *words),
        )


def with_metadata(**changes: Any) -> Callable[[Path], object]:
    def write(path: Path) -> object:
        tensors, information = make_model(20)
        return write_model(path, tensors, information | changes)

    return write


@PART.case(
    why="numbers that JSON can hold and no clip can have",
    done="refused by both readers",
    each={
        "fps = 1e999": {"fps": 1e999},
        "fps = 10^400": {"fps": 10**400},
        "fps = 0": {"fps": 0},
        "fps = true": {"fps": True},
        "background = NaN": {"background": [math.nan] * 3},
        "no frames": {"frames": []},
        "a scale of 0": {"model_to_world": np.diag([0.0, 0, 0, 1]).tolist()},
        "a scale of 1e-320": {"model_to_world": np.diag([1e-320, 1e-320, 1e-320, 1]).tolist()},
        "a scale of 1e-30": {"model_to_world": np.diag([1e-30, 1e-30, 1e-30, 1]).tolist()},
    },
)
def impossible_metadata(changes: dict[str, Any]) -> float:
    return refused_by_both(with_metadata(**changes))


@PART.case(
    why="one value of millions that is not finite spoils every frame",
    done="refused with the tensor's name",
    each={"NaN": math.nan, "infinity": math.inf},
)
def a_value_that_is_not_finite(value: float) -> float:
    def write(path: Path) -> None:
        tensors, information = make_model(20)
        tensors["head_feature.output.weight"].flat[7] = value
        write_model(path, tensors, information)

    return refused_by_both(write, "head_feature.output.weight")


@PART.case(
    why="a header that promises terabytes, nests without end or repeats itself",
    done="refused before memory is asked for",
    each={"terabytes": 0, "nesting": 1, "a length beyond the file": 2, "no JSON": 3},
)
def headers_that_lie(kind: int) -> float:
    def write(path: Path) -> None:
        header, data = header_and_data(*make_model(4))
        if kind == 0:
            header["anchors.position"] = {"dtype": "F32", "shape": [2**40, 3], "data_offsets": [0, 12 * 2**40]}
            write_file(path, header, data)
        elif kind == 1:
            header["__metadata__"]["aa4d"] = "[" * 100_000
            write_file(path, header, data)
        else:
            text = json.dumps(header).encode()
            length = 2**62 if kind == 2 else len(text)
            path.write_bytes(struct.pack("<Q", length) + (text if kind == 2 else b"\xff" * len(text)) + data)

    return refused_by_both(write)


@PART.case(why="cut at any byte", done="refused at every length", each={"sixty lengths": 60})
def cut_short(count: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        content = write_model(Path(folder) / "model.safetensors", *make_model(4, frames=2)).read_bytes()
    lengths = np.linspace(0, len(content) - 1, count).astype(int)
    return max(refused_by_both(lambda path, n=n: path.write_bytes(content[:n])) for n in lengths)  # type: ignore[misc]


@PART.case(why="an anchor 1e9 m away: float32 has no metre there", done="refused by both readers")
def an_anchor_out_of_the_world() -> float:
    def write(path: Path) -> None:
        tensors, information = make_model(20)
        tensors["anchors.position"][3, 0] = 1e9
        write_model(path, tensors, information)

    return refused_by_both(write, "from the origin")


@PART.case(why="one frame: the clip's time is 0 / 0", done="time zero", each={"fine": "fine", "coarse": "coarse"})
def a_clip_of_one_frame(stage: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = write_model(Path(folder) / "model.safetensors", *make_model(20, frames=1, stage=stage))
        ours, theirs = read_model(path), load_model(path)
        return 0.0 if ours.frame_count == len(theirs.frames) == 1 and theirs.frames[0].t == 0 else math.inf
