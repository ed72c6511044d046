"""gsplat, built from its own source archive with the kernels that the project can ask for, and no others."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import time
from importlib import invalidate_caches
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tests.device.asked import Asked, Keep, files_in

VERSION = "1.5.3"
ARCHIVE = f"gsplat-{VERSION}.tar.gz"
# gsplat compiles each of its kernels for these numbers of channels, and pads others to a power of two. What has more
# than 32 it draws in chunks of 32 (`channel_chunk`).
CHANNELS = (1, 2, 3, 4, 5, 8, 9, 16, 17, 32, 33, 64, 65, 128, 129, 256, 257, 512, 513)
MOST_CHANNELS = 32
INSTANCE = re.compile(r"^[ \t]*__(?:INS|LAUNCH_KERNEL)__\((\d+)\)[ \t]*\n", re.MULTILINE)


def measure(asked: Asked, keep: Keep) -> None:
    keep("native", native())
    work = Path(asked.work)
    archives = files_in(asked.carried, ARCHIVE)
    if asked.device == "cpu":
        if archives:
            keep("left_out", prune(unpacked(archives[0], work)))
        return
    if find_spec("gsplat") is None:
        wheels = files_in(asked.carried, f"gsplat-{VERSION}-*.whl")
        keep("wheel", "carried" if wheels else "built here")
        if not wheels:
            if not archives:
                raise FileNotFoundError(f"gsplat is not installed, and there is no {ARCHIVE} in --carried")
            source = unpacked(archives[0], work)
            keep("left_out", prune(source))
            started = time.perf_counter()
            wheels = [built(source, work / "wheels")]
            keep("build_s", time.perf_counter() - started)
        keep("wheel_mib", wheels[0].stat().st_size / 2**20)
        _pip("install", "--no-deps", "--no-index", "--target", str(work / "site"), str(wheels[0]))
    keep("gsplat", first_picture())


def native() -> dict[str, Any]:
    """The CPU's rasteriser, which the GPU's is compared with."""
    from aa4d import _native

    return {"instruction_set": _native.raster.instruction_set()}


def unpacked(archive: Path, work: Path) -> Path:
    """The source tree; a former one is used again, with what was compiled of it."""
    source = work / f"gsplat-{VERSION}"
    if not source.exists():
        with tarfile.open(archive) as file:
            file.extractall(work, filter="data")
    return source


def prune(source: Path) -> dict[str, int]:
    """Leave out kernels for more channels than the project draws. Returns how many instances of each file went."""
    left_out = {}
    for path in sorted((source / "gsplat/cuda/csrc").glob("Rasteriz*.c*")):
        text = path.read_text()
        kept = INSTANCE.sub(lambda match: match[0] if int(match[1]) <= MOST_CHANNELS else "", text)
        if kept != text:
            path.write_text(kept)
        left_out[path.name] = len(INSTANCE.findall(text)) - len(INSTANCE.findall(kept))
    return left_out


def built(source: Path, wheels: Path) -> Path:
    """gsplat's wheel for this machine's card alone. Raises CalledProcessError; the compilers' words are in the log."""
    import torch

    major, minor = torch.cuda.get_device_capability()
    jobs = os.environ.get("MAX_JOBS", str(os.cpu_count() or 1))
    arch = os.environ.get("TORCH_CUDA_ARCH_LIST", f"{major}.{minor}")
    _pip(
        *("wheel", "--no-deps", "--no-index", "--no-build-isolation", "--verbose", "-w", str(wheels), str(source)),
        environment={"MAX_JOBS": jobs, "TORCH_CUDA_ARCH_LIST": arch},
    )
    return next(wheels.glob("gsplat-*.whl"))


def first_picture() -> dict[str, Any]:
    """Draw one Gaussian: gsplat is found, loads, and runs on the card."""
    invalidate_caches()  # its folder was not there when this process began
    import torch

    from aa4d.raster import Gaussians, rasterize
    from tests.hard_cases import raster as scenes

    given = {name: value.float().cuda() for name, value in vars(scenes.one_gaussian()).items() if value is not None}
    started = time.perf_counter()
    image = rasterize(Gaussians(**given), scenes.straight_camera(), background=torch.zeros(3, device="cuda"))
    return {"largest_alpha": image.alpha.max().item(), "first_call_s": time.perf_counter() - started}


def _pip(*arguments: str, environment: dict[str, str] | None = None) -> None:
    subprocess.run([sys.executable, "-m", "pip", *arguments], check=True, env=os.environ | (environment or {}))
