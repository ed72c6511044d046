"""Iterations and frames a second, and memory, of a whole training step and the whole pipeline as scenes grow."""

from __future__ import annotations

import time
from dataclasses import asdict
from functools import partial
from typing import Any

import torch

from aa4d.methods import DEFAULT, METHODS, presets_of
from aa4d.methods.settings import AnchorSettings
from aa4d.training.bench import STANDARD, Workload
from aa4d.training.bench import measure as measure_iteration
from tests.device.asked import Asked, Keep, attempt

SIZES = ((320, 180), (960, 540), (1920, 1080))
ANCHORS = (5_000, 50_000, 200_000)
PER_ANCHOR = 10  # Gaussians; methods of free ones are given so many more units
GROWS = 3.0  # a workload takes less than so many times as long as the one before


def measure(asked: Asked, keep: Keep) -> None:
    device = torch.device(asked.device)
    seconds = 0.0 if asked.is_tiny else 1.0
    sizes = ((64, 36),) if asked.is_tiny else SIZES
    anchors = (60,) if asked.is_tiny else ANCHORS
    # The other methods come first: the largest workloads are what may not fit into the time.
    methods: dict[str, Any] = {}
    for method in ("fourdgs", "d3dgs") if asked.is_tiny else METHODS:
        if asked.seconds_left < 8:
            break
        units = min(anchors) if asked.is_tiny else _units(method)
        workload = Workload(units, *min(sizes))
        methods[method] = attempt(partial(_row, workload, seconds, device, method))
        keep("methods", methods)
    rows: list[dict[str, Any]] = []
    last_s = 0.0
    for width, height in sizes:
        for count in anchors:
            if asked.seconds_left < GROWS * last_s:
                keep("not_measured", f"from {count} anchors at {width}x{height}: no time was left")
                return
            started = time.perf_counter()
            workload = Workload(count, width, height)
            asked_for = {"asked": asdict(workload)}
            rows.append(asked_for | attempt(partial(_row, workload, seconds, device, DEFAULT)))
            last_s = time.perf_counter() - started
            keep("growth", rows)


def _row(workload: Workload, seconds: float, device: torch.device, method: str) -> dict[str, Any]:
    return asdict(measure_iteration(workload, seconds, device, method))


def _units(method: str) -> int:
    is_of_anchors = isinstance(presets_of(method)["paper"], AnchorSettings)
    return STANDARD.anchors * (1 if is_of_anchors else PER_ANCHOR)
