"""The device that a command runs on."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal, get_args

from aa4d.errors import InputError

if TYPE_CHECKING:
    import torch

UNUSED_GPU = "device: the CPU; a GPU is here, but CUDA has not trained on a real one yet (--device cuda tries it)"

DeviceName = Literal["auto", "cpu", "cuda"]
DEVICES: tuple[DeviceName, ...] = get_args(DeviceName)


def note_on_device(name: DeviceName) -> str | None:
    """A note for a person who has a GPU and did not choose; None where there is nothing to tell."""
    import torch

    return UNUSED_GPU if name == "auto" and torch.cuda.is_available() else None


def choose_device(name: DeviceName) -> torch.device:
    """The device of that name; `auto` is the CPU, since no training has run on a real GPU yet.

    Raises:
        InputError: "cuda" without a GPU that this PyTorch can use, or without gsplat.
    """
    import torch  # names of devices are wanted without waiting for it

    if name != "cuda":
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise InputError(
            f"--device cuda: PyTorch {torch.__version__} finds no CUDA GPU here; install a CUDA build of PyTorch on a "
            "machine with an NVIDIA GPU, or use --device cpu"
        )
    if find_spec("gsplat") is None:
        raise InputError("--device cuda: needs the rasterizer gsplat; pip install gsplat, or use --device cpu")
    # SSIM's variances and LPIPS's distances are small differences: ten bits of mantissa are too few.
    torch.backends.cudnn.allow_tf32 = False
    return torch.device("cuda")


def wait_for(device: torch.device) -> None:
    """Return when the device has done all that it was asked for; a clock that is read earlier lies."""
    import torch

    if device.type == "cuda":
        torch.cuda.synchronize(device)
