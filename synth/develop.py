"""From linear light to the frame on disk: sRGB, eight bits, PNG."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray


def srgb_from_linear(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode linear RGB [..., 3] as 8-bit sRGB (IEC 61966-2-1), clipped; Blender's "Standard" view transform."""
    x = np.clip(linear.astype(np.float64), 0.0, 1.0)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)


def png(image: NDArray[np.uint8]) -> bytes:
    """A PNG file of an RGB image [H, W, 3]: no metadata, so equal pixels are equal bytes."""
    height, width, _ = image.shape
    rows = image.reshape(height, width * 3)
    differences = np.diff(rows, axis=0, prepend=np.zeros((1, width * 3), np.uint8))  # filter type 2, "up"
    filtered = np.concatenate([np.full((height, 1), 2, np.uint8), differences], axis=1)

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(filtered.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
