"""What the machine is: processor, card, driver, versions, compilers."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tests.device.asked import Asked, Keep

PROGRAMS = {
    "nvcc": ["nvcc", "--version"],
    "gcc": ["gcc", "--version"],
    "cmake": ["cmake", "--version"],
    "ninja": ["ninja", "--version"],
    "card": ["nvidia-smi", "--query-gpu=name,driver_version,memory.total,clocks.sm", "--format=csv,noheader"],
}
PACKAGES = ("torch", "triton", "numpy", "gsplat", "nanobind", "scipy", "safetensors", "aa4d")


def measure(asked: Asked, keep: Keep) -> None:
    keep("machine", {"system": platform.platform(), "python": platform.python_version(), "cores": os.cpu_count()})
    keep("processor", _processor())
    keep("load", list(os.getloadavg()))
    keep("programs", {name: said(command) for name, command in PROGRAMS.items()})
    keep("packages", {name: _version(name) for name in PACKAGES})
    keep("torch", _torch(asked.device))


def said(command: list[str]) -> str:
    """What a program says of itself, or why it does not."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__}: {error}"
    lines = (done.stdout or done.stderr).strip().splitlines()
    return lines[-2].strip() if command[0] == "nvcc" and len(lines) > 1 else (lines or [""])[0].strip()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _torch(device: str) -> dict[str, Any]:
    import torch

    found: dict[str, Any] = {
        "version": torch.__version__,
        "cuda": torch.version.cuda,
        "threads": torch.get_num_threads(),
    }
    if device == "cuda":
        properties = torch.cuda.get_device_properties(0)
        found |= {
            "card": properties.name,
            "capability": [properties.major, properties.minor],
            "multiprocessors": properties.multi_processor_count,
            "memory_mib": properties.total_memory / 2**20,
        }
        found["sum_of_ones"] = torch.ones(1000, device="cuda").sum().item()  # it computes
    return found
