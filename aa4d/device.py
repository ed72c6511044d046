"""The device that a command runs on."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal, get_args

from aa4d.errors import InputError

if TYPE_CHECKING:
    import torch

DeviceName = Literal["auto", "cpu", "cuda"]
DEVICES: tuple[DeviceName, ...] = get_args(DeviceName)


def choose_device(name: DeviceName) -> torch.device:
    """`auto` is CUDA where both a GPU and gsplat are there, else the CPU.

    Raises:
        InputError: "cuda" without a GPU that this PyTorch can use, or without gsplat.
    """
    import torch  # names of devices are wanted without waiting for it

    gpu, rasteriser = torch.cuda.is_available(), find_spec("gsplat") is not None
    if name == "cuda" and not gpu:
        raise InputError(
            f"--device cuda: PyTorch {torch.__version__} finds no CUDA GPU here; install a CUDA build of PyTorch on a "
            "machine with an NVIDIA GPU, or use --device cpu"
        )
    if name == "cuda" and not rasteriser:
        raise InputError("--device cuda: needs the rasteriser gsplat; pip install gsplat, or use --device cpu")
    return torch.device("cuda" if name != "cpu" and gpu and rasteriser else "cpu")
