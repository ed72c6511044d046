"""The rasteriser and the field's kernels share one pool of threads."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

BOTH = """
import torch
from aa4d import _native
from aa4d.kernels.plane_penalty import plane_penalty
from aa4d.raster import Camera, Gaussians, rasterize

assert _native.worker_count() == 0

def field(threads):
    torch.set_num_threads(threads)
    plane_penalty([torch.rand(400, 400, 16)] * 6, [1.0] * 6, [1.0] * 6)
    return _native.worker_count()

def raster(threads):
    torch.set_num_threads(threads)
    n = 4000
    ahead = torch.cat([torch.rand(n, 2) - 0.5, torch.full((n, 1), 2.0)], dim=1)
    turned = torch.tensor([1.0, 0, 0, 0]).repeat(n, 1)
    gaussians = Gaussians(ahead, turned, torch.full((n, 3), 0.02), torch.full((n,), 0.5), torch.rand(n, 3))
    K = torch.tensor([[200.0, 0, 128], [0, 200, 128], [0, 0, 1]])
    rasterize(gaussians, Camera(torch.eye(4), K, 256, 256), background=torch.zeros(3), backend="native")
    return _native.worker_count()

print(field(3), raster(3), raster(4), field(4), field(2))
"""


def test_both_halves_use_the_same_threads() -> None:
    result = subprocess.run(
        [sys.executable, "-c", BOTH],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == ["2", "2", "3", "3", "3"]
