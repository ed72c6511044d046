"""From linear light to the frame on disk: the effects on light, sRGB, eight bits, PNG."""

import struct
import zlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.lens import pixel_rays
from synth.plan import Frame, Plan


@dataclass(frozen=True)
class Shot:
    """What an effect on light may ask about the frame."""

    plan: Plan
    frame: Frame
    read_depth: Callable[[], NDArray[np.float32]]

    @property
    def seed(self) -> int:
        return self.plan.scene.seed

    def distance_m(self) -> NDArray[np.float64]:
        """Length of the ray to what each pixel shows [H, W]; infinite in the sky."""
        depth = self.read_depth().astype(np.float64)
        height, width = depth.shape
        return depth * np.asarray(np.linalg.norm(pixel_rays(self.plan.lens, (width, height)), axis=-1))


def develop(
    linear: NDArray[np.float32], shot: Shot, timed: Callable[[str], AbstractContextManager[None]]
) -> NDArray[np.uint8]:
    """The 8-bit sRGB frame [H, W, 3] from linear light; `timed` is entered with the name of each effect."""
    for effect in shot.plan.film_effects():
        with timed(effect.name):
            linear = effect.module.expose(effect.settings, linear, shot)
    return srgb_from_linear(linear)


def srgb_from_linear(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode linear RGB [..., 3] as 8-bit sRGB (IEC 61966-2-1), clipped; Blender's "Standard" view transform."""
    x = np.clip(linear.astype(np.float64), 0.0, 1.0)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)


def png(image: NDArray[np.uint8]) -> bytes:
    """A PNG file of an RGB image [H, W, 3] or of labels [H, W]: no metadata, so equal pixels are equal bytes."""
    height, width = image.shape[:2]
    colour_type = 2 if image.ndim == 3 else 0
    rows = image.reshape(height, -1)
    differences = np.diff(rows, axis=0, prepend=np.zeros((1, rows.shape[1]), np.uint8))  # filter type 2, "up"
    filtered = np.concatenate([np.full((height, 1), 2, np.uint8), differences], axis=1)

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0)
    pixels = zlib.compress(filtered.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def read_png(content: bytes) -> NDArray[np.uint8]:
    """The image of a file that `png` wrote.

    Raises:
        ValueError: it is something else.
    """
    if content[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError("not a PNG file")
    at, header, pixels = 8, b"", b""
    while at + 12 <= len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        if at + 12 + length > len(content):
            raise ValueError("a PNG file that is cut short")
        kind, data = content[at + 4 : at + 8], content[at + 8 : at + 8 + length]
        if struct.pack(">I", zlib.crc32(kind + data)) != content[at + 8 + length : at + 12 + length]:
            raise ValueError("a damaged PNG file")
        header, pixels = (data, pixels) if kind == b"IHDR" else (header, pixels + data if kind == b"IDAT" else pixels)
        at += length + 12
    if len(header) != 13:
        raise ValueError("a PNG file without a header")
    width, height, depth, colour_type, *_ = struct.unpack(">IIBBBBB", header)
    if depth != 8 or colour_type not in (0, 2):
        raise ValueError("a PNG file of another kind")
    channels = 3 if colour_type == 2 else 1
    try:
        rows = np.frombuffer(zlib.decompress(pixels), np.uint8).reshape(height, 1 + width * channels)
    except (zlib.error, ValueError) as error:
        raise ValueError(f"a damaged PNG file: {error}") from None
    if (rows[:, 0] != 2).any():
        raise ValueError("a PNG file of another program")
    image = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8)  # wraps at 256, as the filter does
    return image.reshape((height, width, 3) if channels == 3 else (height, width))
