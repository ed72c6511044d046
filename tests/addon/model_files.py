"""Model files for the tests, written by hand as docs/formats.md says: struct, json, numpy."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

PLANES = ("xy", "xz", "yz", "xt", "yt", "zt")


def make_model(
    anchors: int = 200,
    frames: int = 5,
    seed: int = 0,
    *,
    stage: str = "fine",
    dlgd: bool = True,
    aggregation: str = "acfa",
    groups: int = 0,
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Random tensors with visible motion, and the metadata of a flight around them.

    With groups, three anchors in four ride on one, in turn: the first group is there over the whole clip, the second
    comes and goes within it, the third appears at an instant at two fifths of it, and so on.
    """
    random = np.random.default_rng(seed)
    K, F, E, C, L, B = 3, 8, 4, 6, 2, 5

    def normal(*shape: int, scale: float = 1.0) -> np.ndarray:
        return (scale * random.standard_normal(shape)).astype(np.float32)

    tensors = {
        "anchors.position": random.uniform(-1.1, 1.1, (anchors, 3)).astype(np.float32),
        "anchors.feature": normal(anchors, F),
        "anchors.offset": normal(anchors, K, 3),
        "anchors.log_scale": normal(anchors, 6, scale=0.3) - 3,
    }

    def layer(name: str, outputs: int, inputs: int, gain: float = 1.0) -> None:
        tensors[f"{name}.weight"] = normal(outputs, inputs, scale=gain / inputs**0.5)
        tensors[f"{name}.bias"] = normal(outputs, scale=0.2)

    def network(name: str, outputs: int, inputs: int, hidden: int, gain: float = 1.0) -> None:
        layer(f"{name}.hidden", hidden, inputs)
        layer(f"{name}.output", outputs, hidden, gain)

    for name, outputs in (("opacity", K), ("color", 3 * K), ("covariance", 7 * K)):
        network(f"decoder_{name}", outputs, F + 3, 32)
    for level in range(L):
        for name in PLANES:
            columns = 5 + 3 * level
            tensors[f"field.planes.{level}.{name}"] = normal(C, 4 if name[1] == "t" else columns, columns)
    tensors["field.box"] = np.array([[-1, -0.9, -1.2], [1, 1.1, 0.8]], np.float32)
    steps = random.uniform(0.3, 1.0, (3, B))
    boundaries = np.concatenate([np.zeros((3, 1)), np.cumsum(steps, axis=1)], axis=1)
    tensors["warp.boundaries"] = (2 * boundaries / boundaries[:, -1:] - 1).astype(np.float32)
    tensors["anchors.embedding_acfa"] = normal(anchors, E)
    conditions = {"acfa": E + 1, "anchor_only": E, "time_only": 1}
    if aggregation in conditions:
        network("acfa", 6 * C, conditions[aggregation], 24)
    layer("encoder", 20, L * C)
    network("head_position", 3, 20, 20, 0.3)
    network("head_feature", F, 20, 20)
    if dlgd:
        tensors["anchors.embedding_offset"] = normal(anchors, E)
        tensors["anchors.embedding_scale"] = normal(anchors, E)
        network("dlgd_offset", 3 * K, E + 1, 16)
        network("dlgd_scale", 6, E + 1, 16, 0.3)

    model_to_world = np.diag([12.0, 12.0, 12.0, 1.0])
    model_to_world[:3, 3] = [30.0, -20.0, 4.0]
    information = {
        "format": "aa4d-model",
        "version": 1,
        "generator": "tests",
        "stage": stage,
        "config": {
            "offsets": K,
            "feature_dim": F,
            "embedding_dim": E,
            "plane_dim": C,
            "levels": L,
            "bins": B,
            "aggregation": aggregation,
            "dlgd": dlgd,
            "dacw": True,
        },
        "model_to_world": model_to_world.tolist(),
        "fps": 29.97,
        "camera": {
            "model": "PINHOLE",
            "width": 320,
            "height": 180,
            "K": [[260.0, 0, 166.5], [0, 250.0, 81.25], [0, 0, 1]],
        },
        "frames": [
            {
                "name": f"{rank:06}",
                "image": f"frames/{rank:06}.png",
                "time_s": rank / 29.97,
                "t": rank / max(frames - 1, 1),
                "split": "train" if rank % 8 or frames == 1 else "test",
                "viewmat": look_at(
                    np.array([30.0 + 40 * np.cos(angle), -20.0 + 40 * np.sin(angle), 25.0]), model_to_world[:3, 3]
                ).tolist(),
            }
            for rank, angle in enumerate(np.linspace(2.4, 4.2, frames))
        ],
        "capture": None,
        "background": [0.1, 0.2, 0.3],
        "training": {"seconds": 1.0},
    }
    if groups:
        add_groups(tensors, information, groups, up, random)
    return tensors, information


def make_single(frames: int) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """A model of one large opaque Gaussian, grey unless told otherwise, in the middle of a small picture."""
    tensors, information = make_model(1, frames, stage="coarse")
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    tensors["anchors.position"][:] = tensors["anchors.offset"][:] = tensors["anchors.log_scale"][:] = 0
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    return tensors, information


def add_groups(
    tensors: dict[str, np.ndarray],
    information: dict[str, Any],
    groups: int,
    up: tuple[float, float, float],
    random: np.random.Generator,
) -> None:
    """Make it a file of version 2 whose anchors ride on cars that drive and turn."""
    anchors, controls = len(tensors["anchors.position"]), 7
    riders = np.arange(anchors) % 4 != 3
    group = np.where(riders, (np.cumsum(riders) - 1) % groups, -1)
    tensors["anchors.position"][riders] *= 0.15
    way = np.linspace(-0.8, 0.8, controls)[:, None] * random.standard_normal((groups, 1, 3)) * [1, 1, 0.1]
    shown = [(-2, -1, 2, 3), (0.2, 0.3, 0.7, 0.8), (0.4, 0.4, 2, 3)]
    tensors |= {
        "anchors.group": group.astype(np.float32),
        "groups.position": (way + random.uniform(-0.3, 0.3, (groups, 1, 3))).astype(np.float32),
        "groups.heading": (np.cumsum(random.uniform(0, 0.9, (groups, controls)), axis=1) + 2).astype(np.float32),
        "groups.reference": random.uniform(-0.5, 0.5, (groups, 4)).astype(np.float32),
        "groups.shown": np.array([shown[g % len(shown)] for g in range(groups)], np.float32),
        "groups.up": (np.array(up) / np.linalg.norm(up)).astype(np.float32),
    }
    tensors["groups.start"] = np.concatenate([tensors["groups.position"], tensors["groups.heading"][..., None]], axis=2)
    information["version"] = 2
    information["groups"] = [{"name": f"car {number + 1}"} for number in range(groups)]


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """A world-to-camera matrix in OpenCV axes, z up in the world."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [right, np.cross(forward, right), forward]
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat


def header_and_data(tensors: dict[str, np.ndarray], information: Any) -> tuple[dict[str, Any], bytes]:
    """The JSON header and the tensors' bytes."""
    header: dict[str, Any] = {"__metadata__": {"aa4d": json.dumps(information)}}
    data = b""
    for name, tensor in tensors.items():
        start = len(data)
        data += np.ascontiguousarray(tensor, "<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [start, len(data)]}
    return header, data


def write_file(path: Path, header: Any, data: bytes) -> Path:
    """A safetensors file of this header, whatever it says."""
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)
    return path


def write_model(path: Path, tensors: dict[str, np.ndarray], information: Any) -> Path:
    """A whole model file."""
    return write_file(path, *header_and_data(tensors, information))
