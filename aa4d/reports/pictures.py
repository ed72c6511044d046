"""Pictures inside a page: encoded small, animated, cut to size."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Pixels = NDArray[np.uint8]  # [H, W, 3] sRGB

ERROR_GAIN = 4  # an error of a quarter of the range is the top of the color scale
GAP_PX = 2  # between the cells of a grid


@dataclass(frozen=True)
class Picture:
    """An image that stands in the page itself."""

    source: str  # data: URI
    width: int
    height: int
    alt: str
    caption: str = ""


@dataclass(frozen=True)
class Detail:
    """How much of the pictures a page holds."""

    longest_px: int  # of a frame
    quality: int  # of WebP, 100 at most
    views: int  # frames of a capture
    loop_px: int  # width of a loop

    def fitted(self, image: Image.Image) -> Image.Image:
        return scaled(image, self.longest_px / max(image.size))


def scaled(image: Image.Image, factor: float) -> Image.Image:
    """Smaller by the factor; never larger."""
    if factor >= 1:
        return image
    size = (max(round(factor * image.width), 1), max(round(factor * image.height), 1))
    return image.resize(size, Image.Resampling.LANCZOS)


def picture_of(pixels: Pixels, detail: Detail, alt: str, caption: str = "") -> Picture:
    image = detail.fitted(Image.fromarray(pixels))
    return Picture(_webp(image, detail.quality), image.width, image.height, alt, caption)


def cut_out(pixels: Pixels, window: tuple[int, int, int, int], px: int, alt: str, caption: str = "") -> Picture:
    """A window (left, top, right, bottom) at a width of `px`."""
    cut = Image.fromarray(pixels).crop(window)
    height = max(round(px * cut.height / cut.width), 1)
    image = cut.resize((px, height), Image.Resampling.BICUBIC)
    return Picture(_webp(image, 85), image.width, image.height, alt, caption)


def loop_of(
    moments: Sequence[Sequence[Pixels]], seconds: Sequence[float], columns: int, detail: Detail, alt: str
) -> tuple[Picture, Picture]:
    """An animation and its first frame.

    Args:
        moments: for each moment the cells of a grid, row by row, all of one size.
        seconds: how long each moment stands.
    """
    frames = [_grid(cells, columns, detail.loop_px) for cells in moments]
    buffer = io.BytesIO()
    milliseconds = [round(1000 * s) for s in seconds]
    frames[0].save(
        buffer, "WEBP", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, quality=80, method=3
    )
    width, height = frames[0].size
    moving = Picture(_uri(buffer.getvalue(), "webp"), width, height, alt)
    return moving, Picture(_webp(frames[0], 80), width, height, f"{alt}, held still")


def _grid(cells: Sequence[Pixels], columns: int, width: int) -> Image.Image:
    images = [Image.fromarray(cell) for cell in cells]
    images = [scaled(image, width / columns / image.width) for image in images]
    across, down = images[0].width, images[0].height
    lines = -(-len(images) // columns)
    sheet = Image.new("RGB", (columns * across, lines * down))
    for number, image in enumerate(images):
        line, column = divmod(number, columns)
        sheet.paste(image, (column * across, line * down))
        # A dark edge to the neighbors on the right and below.
        sheet.paste(0, ((column + 1) * across - GAP_PX, line * down, (column + 1) * across, (line + 1) * down))
        sheet.paste(0, (column * across, (line + 1) * down - GAP_PX, (column + 1) * across, (line + 1) * down))
    return sheet


def error_picture(truth: Pixels, render: Pixels) -> Pixels:
    """The mean error of the channels as a color, magnified `ERROR_GAIN` times."""
    import matplotlib

    error = np.abs(truth.astype(np.float32) - render).mean(axis=2) / 255
    colors = matplotlib.colormaps["inferno"](np.clip(error * ERROR_GAIN, 0, 1))
    return (colors[..., :3] * 255).round().astype(np.uint8)


def png_uri(pixels: Pixels) -> str:
    """Without a loss."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    return _uri(buffer.getvalue(), "png")


def _webp(image: Image.Image, quality: int) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=quality, method=3)
    return _uri(buffer.getvalue(), "webp")


def _uri(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
