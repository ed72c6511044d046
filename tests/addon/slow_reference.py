"""docs/formats.md, "Evaluating a model at time t", transcribed step by step in float64, one anchor at a time."""

from typing import Any

import numpy as np

PLANES = ("xy", "xz", "yz", "xt", "yt", "zt")


def linear(tensors: dict[str, np.ndarray], name: str, x: np.ndarray) -> np.ndarray:
    return tensors[f"{name}.weight"].astype(np.float64) @ x + tensors[f"{name}.bias"].astype(np.float64)


def mlp(tensors: dict[str, np.ndarray], name: str, x: np.ndarray) -> np.ndarray:
    return linear(tensors, f"{name}.output", np.maximum(linear(tensors, f"{name}.hidden", x), 0))


def bilinear(plane: np.ndarray, first: float, second: float) -> np.ndarray:
    """plane [C, R2, R1] at (first along R1, second along R2)."""
    value = np.zeros(len(plane))
    rows, columns = plane.shape[1:]
    x = min(max((first + 1) / 2 * (columns - 1), 0), columns - 1)
    y = min(max((second + 1) / 2 * (rows - 1), 0), rows - 1)
    for row in range(rows):
        for column in range(columns):
            weight = max(0, 1 - abs(row - y)) * max(0, 1 - abs(column - x))
            value += weight * plane[:, row, column]
    return value


def warp(u: float, boundaries: np.ndarray) -> float:
    bins = len(boundaries) - 1
    for b in range(bins):
        low, high = -1 + 2 * b / bins, -1 + 2 * (b + 1) / bins
        if u <= high or b == bins - 1:
            return float(boundaries[b] + (u - low) / (high - low) * (boundaries[b + 1] - boundaries[b]))
    raise AssertionError


def spline(controls: np.ndarray, t: float) -> np.ndarray:
    """controls [C, ...] at t."""
    n = len(controls) - 3
    t = min(max(t, 0.0), 1.0)
    i = min(int(np.floor(t * n)), n - 1)
    f = t * n - i
    weights = ((1 - f) ** 3 / 6, (3 * f**3 - 6 * f**2 + 4) / 6, (-3 * f**3 + 3 * f**2 + 3 * f + 1) / 6, f**3 / 6)
    return sum(weight * controls[i + k].astype(np.float64) for k, weight in enumerate(weights))


def about(up: np.ndarray, psi: float) -> np.ndarray:
    """The quaternion w x y z of a turn by psi about `up`."""
    return np.array([np.cos(psi / 2), *(np.sin(psi / 2) * up)])


def times(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton's product."""
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return times(times(q, np.array([0.0, *v])), q * [1, -1, -1, -1])[1:]


def factor(shown: np.ndarray, t: float) -> float:
    a, b, c, d = shown.astype(np.float64)
    return float(np.clip(min((t - a) / ((b - a) or 1e-9), (d - t) / ((d - c) or 1e-9)), 0, 1))


def evaluate(
    tensors: dict[str, np.ndarray], information: dict[str, Any], t: float, camera_center: np.ndarray
) -> dict[str, np.ndarray]:
    """Everything at time t, in world metres: anchors [N, ...] and local Gaussians [N, K, ...].

    `canonical` has the anchors as no time moves them: those of a group at its reference.
    """
    config = information["config"]
    K, C = config["offsets"], config["plane_dim"]
    to_world = np.array(information["model_to_world"])
    unit = to_world[0, 0]
    center = (camera_center - to_world[:3, 3]) / unit
    names = ("canonical", "anchors", "positions", "colors", "opacities", "scales", "quaternions")
    result: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for i, x in enumerate(tensors["anchors.position"].astype(np.float64)):
        f = tensors["anchors.feature"][i].astype(np.float64)
        O = tensors["anchors.offset"][i].astype(np.float64)  # noqa: E741 - the paper's letter
        log_s = tensors["anchors.log_scale"][i].astype(np.float64)
        group = int(tensors["anchors.group"][i]) if "anchors.group" in tensors else -1
        shift, q, rest, share = np.zeros(3), np.array([1.0, 0, 0, 0]), x, 1.0
        if group >= 0:
            up = tensors["groups.up"].astype(np.float64)
            at = tensors["groups.reference"][group].astype(np.float64)
            shift, q = at[:3], about(up, at[3])
            rest = turned(q, x) + shift
            if information["stage"] == "fine":
                shift = spline(tensors["groups.position"][group], t)
                q = about(up, float(spline(tensors["groups.heading"][group], t)))
                share = factor(tensors["groups.shown"][group], t)
        eye = turned(q * [1, -1, -1, -1], center - shift)
        if information["stage"] == "fine":
            lower, upper = tensors["field.box"].astype(np.float64)
            u = np.clip(2 * (rest - lower) / (upper - lower) - 1, -1, 1)
            query = {axis: warp(u[a], tensors["warp.boundaries"][a].astype(np.float64)) for a, axis in enumerate("xyz")}
            query["t"] = 2 * t - 1
            aggregation = config.get("aggregation", "acfa")
            weights = np.full((6, C), 1 / 6)
            if aggregation in ("acfa", "anchor_only", "time_only"):
                seen = np.empty(0) if aggregation == "time_only" else tensors["anchors.embedding_acfa"][i]
                seen = seen if aggregation == "anchor_only" else np.append(seen, t)
                scores = mlp(tensors, "acfa", seen).reshape(6, C)
                weights = np.exp(scores) / np.exp(scores).sum(axis=0)
            levels = []
            for level in range(config["levels"]):
                planes = [tensors[f"field.planes.{level}.{p}"].astype(np.float64) for p in PLANES]
                samples = [bilinear(plane, query[p[0]], query[p[1]]) for p, plane in zip(PLANES, planes, strict=True)]
                product = aggregation == "product"
                levels.append(np.prod(samples, axis=0) if product else (weights * np.array(samples)).sum(axis=0))
            z = np.maximum(linear(tensors, "encoder", np.concatenate(levels)), 0)
            x = x + mlp(tensors, "head_position", z)
            f = f + mlp(tensors, "head_feature", z)
            if config["dlgd"]:
                O = O + mlp(tensors, "dlgd_offset", np.append(tensors["anchors.embedding_offset"][i], t)).reshape(K, 3)  # noqa: E741
                log_s = log_s + mlp(tensors, "dlgd_scale", np.append(tensors["anchors.embedding_scale"][i], t))
        s = np.exp(log_s)
        direction = (x - eye) / np.linalg.norm(x - eye)
        inputs = np.concatenate([f, direction])
        covariance = mlp(tensors, "decoder_covariance", inputs).reshape(K, 7)
        result["canonical"].append(unit * rest + to_world[:3, 3])
        result["anchors"].append(unit * (turned(q, x) + shift) + to_world[:3, 3])
        places = np.array([turned(q, place) + shift for place in x + O * s[:3]])
        result["positions"].append(unit * places + to_world[:3, 3])
        result["colors"].append(1 / (1 + np.exp(-mlp(tensors, "decoder_color", inputs).reshape(K, 3))))
        result["opacities"].append(share * np.tanh(mlp(tensors, "decoder_opacity", inputs)))
        result["scales"].append(unit * s[3:] / (1 + np.exp(-covariance[:, :3])))
        own = covariance[:, 3:] / np.linalg.norm(covariance[:, 3:], axis=1, keepdims=True)
        result["quaternions"].append([times(q, r) for r in own] if group >= 0 else own)
    return {name: np.array(values) for name, values in result.items()}
