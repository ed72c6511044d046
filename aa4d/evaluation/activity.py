"""PSNR over what moves, what moved and what never does: the capture's activity labels (docs/formats.md)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from aa4d.capture.reader import Capture
from aa4d.errors import InputError

CLASSES = ("static", "intermittent", "persistent", "appearance-only", "unseen")  # by label


def activity_labels(capture: Capture, index: int) -> NDArray[np.uint8] | None:
    """[H, W] labels of a frame, or None where the capture has none for it.

    Raises:
        InputError: the picture cannot be read, has another size, or holds a label that is not known.
    """
    path = capture.folder / "truth" / "activity" / f"{capture.frames[index].name}.png"
    if not path.exists():
        return None
    try:
        with Image.open(path) as image:
            labels = np.array(image)
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: activity labels cannot be read ({error}); make the capture again") from None
    expected = (capture.camera.height, capture.camera.width)
    if labels.shape != expected or labels.dtype != np.uint8:
        raise InputError(f"{path}: expected 8-bit labels of shape {expected}, found {labels.dtype} {labels.shape}")
    if labels.max() >= len(CLASSES):
        raise InputError(f"{path}: holds label {labels.max()}, known are 0 to {len(CLASSES) - 1}; update aa4d")
    return labels


class PooledError:
    """Squared errors by class, summed over frames.

    A class may cover three pixels of one frame and half of the next: a mean of the frames' decibels would weigh both
    alike, so errors are pooled before the logarithm.
    """

    def __init__(self, classes: tuple[str, ...] = CLASSES) -> None:
        self._classes = classes
        self._sum = np.zeros(len(classes))
        self._count = np.zeros(len(classes), np.int64)

    def add(self, image: Tensor, target: Tensor, labels: NDArray[np.uint8]) -> None:
        """image, target: [H, W, 3] in [0, 1]; labels [H, W]."""
        squared = (image.double() - target.double()).square().mean(dim=2).numpy()
        self._sum += np.bincount(labels.ravel(), weights=squared.ravel(), minlength=len(self._classes))
        self._count += np.bincount(labels.ravel(), minlength=len(self._classes))

    def psnr(self) -> dict[str, float]:
        """In dB, of the classes that occur; infinity where a class is reproduced exactly."""
        return {
            name: math.inf if total == 0 else -10 * math.log10(total / count)
            for name, total, count in zip(self._classes, self._sum, self._count, strict=True)
            if count
        }

    def share(self) -> dict[str, float]:
        """Fraction of all pixels, by class."""
        total = max(int(self._count.sum()), 1)
        return {name: float(count / total) for name, count in zip(self._classes, self._count, strict=True) if count}
