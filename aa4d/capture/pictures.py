"""Reading and writing pictures of every common kind as 8-bit sRGB."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, ImageOps

from aa4d.errors import InputError
from aa4d.files import whole_file

EXTENSIONS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
UPRIGHT = 1  # EXIF orientation
ORIENTATION = 0x0112
EIGHT_BITS = ("RGB", "RGBA", "L", "LA", "P", "1", "CMYK", "YCbCr")  # Pillow's modes


def read_picture(path: Path) -> NDArray[np.uint8]:
    """[H, W, 3] 8-bit sRGB, upright: 16-bit is scaled, grey is repeated, CMYK is converted, alpha is dropped.

    Raises:
        InputError: the file is damaged or holds no picture.
    """
    try:
        with Image.open(path) as opened:
            image = ImageOps.exif_transpose(opened)
            if image.mode.startswith(("I", "F")):  # 16-bit grey, or floating point
                values = np.asarray(image, np.float64)
                top = 65535.0 if image.mode.startswith("I") else 1.0
                grey = np.clip(values * (255 / top), 0, 255).round().astype(np.uint8)
                return np.repeat(grey[..., None], 3, axis=2)
            return np.array(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: cannot be read as a picture ({error}); copy it again or remove it") from None


def read_gray(path: Path) -> NDArray[np.uint8]:
    """[H, W] brightness of a picture that this program wrote."""
    return np.asarray(cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_GRAYSCALE))


def pixel_format(image: ImageFile.ImageFile) -> str:
    """How a file that was only just opened stores its pixels, in Pillow's words: "RGB;16B" is read as mode "RGB"."""
    stored = image.tile[0][3] if image.tile else None
    raw = stored if isinstance(stored, str) else stored[0] if isinstance(stored, tuple) and stored else None
    return raw if isinstance(raw, str) else image.mode


def has_eight_bits(image: ImageFile.ImageFile) -> bool:
    """False for a file, only just opened, of more bits a channel."""
    return image.mode in EIGHT_BITS and not pixel_format(image).endswith((";16B", ";16L", ";16N"))


def is_plain(path: Path) -> bool:
    """True for an upright 8-bit RGB JPEG or PNG: what every other program reads as the same pixels."""
    try:
        with Image.open(path) as image:
            upright = image.getexif().get(ORIENTATION, UPRIGHT) == UPRIGHT
            return upright and image.mode == "RGB" and has_eight_bits(image) and image.format in ("JPEG", "PNG")
    except (OSError, SyntaxError, ValueError):
        return False


def save_png(path: Path, pixels: NDArray[np.uint8]) -> Path:
    """Write [H, W, 3] or [H, W]; returns `path`."""
    with whole_file(path) as temporary:
        # Level 1: a fifth larger than the default, and several times faster.
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=1)
    return path
