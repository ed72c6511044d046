"""The picture for a camera, a second, a layer and a number of pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from aa4d.capture.schema import PinholeCamera
from aa4d.filming.camera_path import View
from aa4d.filming.layers import LAYERS, NAMES, Ramp, colored, draw, scale_of
from aa4d.viewer.arrangement import DIFFERENCE, ONE, SIDE_BY_SIDE, Cell, cells
from aa4d.viewer.cameras import Array, Eye, inside
from aa4d.viewer.footage import Photo
from aa4d.viewer.ribbons import with_ribbons
from aa4d.viewer.shown import OF_FOOTAGE, Shown

SCALE_VIEWS = 5  # frames, evenly over the clip, that a colour scale is measured on
SCALE_WIDTH = 160  # pixels
ERROR_SCALE = (0.0, 0.25)
GAP_PX = 2  # between models side by side
NO_TRACKS = "tracks: not over a difference"
LETTER = 1 / 28  # height of a label, of the window's

LAYER_NAMES: tuple[str, ...] = (*NAMES, *OF_FOOTAGE)
RAMPS: Mapping[str, Ramp] = {**LAYERS, "error": Ramp("distance from the capture's picture", "of 1", "inferno")}
COLOR_DIFFERENCE = Ramp("difference of colors", "of 1", "inferno")

Pixels = NDArray[np.uint8]
Values = NDArray[np.float32]


@dataclass(frozen=True)
class Wanted:
    """Everything that a picture depends on but its size and the models themselves."""

    eye: Eye
    aspect: float  # of the window, width over height
    second: float  # of the clip
    layer: str = "color"  # one of `LAYER_NAMES`
    models: tuple[int, ...] = (0,)  # numbers of those that are shown; the difference is the first less the second
    arrangement: str = ONE
    ribbons: bool = False

    def camera(self, cell: Cell) -> PinholeCamera:
        return inside(self.eye.fov, self.aspect, cell.width, cell.height)


@dataclass(frozen=True)
class Scale:
    """What the colours of a picture mean."""

    ramp: Ramp
    bounds: tuple[float, float]

    def colored(self, values: Values) -> Pixels:
        return colored(self.ramp, values, self.bounds)


@dataclass(frozen=True)
class Picture:
    pixels: Pixels  # [H, W, 3]
    scale: Scale | None  # None where it shows colours as they are
    notes: tuple[str, ...]  # what it shows other than was asked for


class Painter:
    """Draws; remembers each colour scale, so that it stays as the camera moves."""

    def __init__(self) -> None:
        self._scales: dict[tuple[str, bool, tuple[int, ...]], Scale] = {}

    def picture(self, shown: tuple[Shown, ...], wanted: Wanted, width: int, height: int) -> Picture:
        """
        Raises:
            InputError: a picture of the capture cannot be read.
        """
        chosen = [shown[i] for i in wanted.models]
        whole = Cell(0, 0, width, height)
        scale = self.scale(shown, wanted)
        if wanted.arrangement == DIFFERENCE:
            bare = replace(wanted, ribbons=False)
            one, other = (drawn(its, bare, whole) for its in chosen[:2])
            notes = one.notes + other.notes + ((NO_TRACKS,) if wanted.ribbons else ())
            assert scale is not None
            return Picture(scale.colored(difference(one, other)), scale, notes)
        if wanted.arrangement == ONE:
            one = drawn(chosen[0], wanted, whole)
            return Picture(one.finished(chosen[0], wanted, whole, scale), scale, one.notes)
        pixels, notes = np.zeros((height, width, 3), np.uint8), ()
        for its, cell in zip(chosen, cells(len(chosen), width, height), strict=True):
            part = drawn(its, wanted, cell)
            labelled = with_label(part.finished(its, wanted, cell, scale), its.name, round(height * LETTER))
            labelled[-GAP_PX:], labelled[:, -GAP_PX:] = 0, 0
            pixels[cell.top : cell.top + cell.height, cell.left : cell.left + cell.width] = labelled
            notes += part.notes
        return Picture(pixels, scale, notes)

    def prepare(self, shown: tuple[Shown, ...], wanted: Wanted) -> None:
        """All that is computed once and takes longer than a picture."""
        self.scale(shown, wanted)
        for its in (shown[i] for i in wanted.models):
            _ = its.lacking, its.ribbons if wanted.ribbons else None

    def scale(self, shown: tuple[Shown, ...], wanted: Wanted) -> Scale | None:
        """The scale of a layer over some frames of all models that are shown; None where colours are colours."""
        is_difference = wanted.arrangement == DIFFERENCE
        if wanted.layer not in RAMPS and not is_difference:
            return None
        if wanted.layer == "error" and not is_difference:
            return Scale(RAMPS["error"], ERROR_SCALE)
        key = (wanted.layer, is_difference, wanted.models)
        if key not in self._scales:
            chosen = [shown[i] for i in wanted.models]
            self._scales[key] = (difference_scale if is_difference else layer_scale)(chosen, wanted.layer)
        return self._scales[key]


@dataclass(frozen=True)
class Drawn:
    """What one model looks like in a cell: a picture, or values that are still to be coloured."""

    pixels: Pixels | None = None  # [H, W, 3]
    values: Values | None = None  # [H, W], NaN where nothing is
    depth_m: Values | None = None  # [H, W], where ribbons are asked for
    notes: tuple[str, ...] = ()

    def finished(self, shown: Shown, wanted: Wanted, cell: Cell, scale: Scale | None) -> Pixels:
        pixels = self.pixels
        if pixels is None:
            assert self.values is not None
            assert scale is not None
            pixels = scale.colored(self.values)
        if self.depth_m is None:
            return pixels
        t = shown.t_at(wanted.second)
        return with_ribbons(pixels, self.depth_m, wanted.eye.viewmat, wanted.camera(cell), shown.ribbons, t)


def drawn(shown: Shown, wanted: Wanted, cell: Cell) -> Drawn:
    """A layer of one model; its colours where it has nothing of the layer."""
    name, t, camera, viewmat = wanted.layer, shown.t_at(wanted.second), wanted.camera(cell), wanted.eye.viewmat
    notes: tuple[str, ...] = ()
    if name in shown.lacking:
        name, notes = "color", (f"{shown.name}: {shown.lacking[name]}",)
    if name in OF_FOOTAGE:
        assert shown.footage is not None
        if name == "error":
            camera = shown.footage.as_sharp(camera)
        photo = shown.footage.seen(viewmat, t, camera)
        if photo is not None:
            return _compared(shown, wanted, cell, camera, photo)
        name, camera, notes = "color", wanted.camera(cell), (f"{wanted.layer}: only from where a frame was taken",)
    rendered = draw(shown.loaded, View("", t, viewmat), camera, [name, *(["depth"] if wanted.ribbons else [])])
    depth_m = rendered.values["depth"] if wanted.ribbons else None
    if name in LAYERS:
        return Drawn(values=rendered.values[name], depth_m=depth_m, notes=notes)
    return Drawn(rendered.picture(name, None), depth_m=depth_m, notes=notes)


def _compared(shown: Shown, wanted: Wanted, cell: Cell, camera: PinholeCamera, photo: Photo) -> Drawn:
    """The capture's picture, or how far the model is from it."""
    if wanted.layer == "frame":
        return Drawn(photo.pixels)
    names = ["color", *(["depth"] if wanted.ribbons else [])]
    rendered = draw(shown.loaded, View("", photo.t, wanted.eye.viewmat), camera, names)
    error = np.where(photo.is_there, distance(rendered.color, photo.pixels), np.float32(np.nan))
    depth_m = _resized(rendered.values["depth"], cell) if wanted.ribbons else None
    return Drawn(values=_resized(error, cell), depth_m=depth_m)


def _resized(values: Values, cell: Cell) -> Values:
    return np.asarray(cv2.resize(values, (cell.width, cell.height), interpolation=cv2.INTER_NEAREST), np.float32)


def distance(one: Pixels, other: Pixels) -> Values:
    """[H, W] mean over red, green and blue of the absolute difference, of 1."""
    return np.asarray(np.abs(one.astype(np.float32) - other).mean(axis=2) / 255, np.float32)


def difference(one: Drawn, other: Drawn) -> Values:
    """[H, W]: of pictures their distance, of values the first less the second, NaN where only one is of the layer."""
    if one.values is not None and other.values is not None:
        return one.values - other.values
    if one.pixels is not None and other.pixels is not None:
        return distance(one.pixels, other.pixels)
    has = one.values if one.values is not None else other.values
    assert has is not None
    return np.full_like(has, np.nan)


def layer_scale(shown: list[Shown], name: str) -> Scale:
    layer = LAYERS[name]
    have = [its for its in shown if name not in its.lacking]
    samples = [part.values for its in have for part in _samples(its, name)]
    return Scale(layer, scale_of(layer, [values for values in samples if values is not None]))


def difference_scale(shown: list[Shown], name: str) -> Scale:
    """From zero for pictures; for values even to both sides of it."""
    one, other = (_samples(its, name) for its in shown[:2])
    values = [difference(a, b) for a, b in zip(one, other, strict=False)]
    finite = np.abs(np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(0)]))
    largest = max(float(np.percentile(finite, 99)) if len(finite) else 1.0, 1e-3)
    if name in RAMPS:
        ramp = Ramp(f"first less second: {RAMPS[name].meaning}", RAMPS[name].unit, "coolwarm")
        return Scale(ramp, (-largest, largest))
    return Scale(COLOR_DIFFERENCE, (0.0, largest))


def _samples(shown: Shown, name: str) -> list[Drawn]:
    """The layer at some of the frames, small."""
    loaded = shown.loaded
    height = max(round(SCALE_WIDTH * loaded.camera.height / loaded.camera.width), 1)
    fov = 2 * float(np.arctan(loaded.camera.height / 2 / loaded.camera.K[1, 1]))
    frames = [loaded.frames[i] for i in np.linspace(0, len(loaded.frames) - 1, SCALE_VIEWS).round().astype(int)]
    whole = Cell(0, 0, SCALE_WIDTH, height)
    return [
        drawn(shown, Wanted(Eye(frame.viewmat, fov), SCALE_WIDTH / height, frame.time_s, name), whole)
        for frame in frames
    ]


def with_label(pixels: Pixels, text: str, height: int) -> Pixels:
    """A copy with a line of text in its upper left corner, `height` pixels high."""
    image = Image.fromarray(pixels)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(max(height, 6))
    pen.text(
        (height, height // 2), text, (255, 255, 255), font, stroke_width=max(height // 8, 1), stroke_fill=(0, 0, 0)
    )
    return np.array(image)


def legend(scale: Scale, width: int = 256, height: int = 10) -> Pixels:
    """[height, width, 3] of a scale from its lower to its upper end."""
    return scale.colored(np.linspace(*scale.bounds, width, dtype=np.float32)[None].repeat(height, axis=0))


def nothing(width: int, height: int, note: str) -> Picture:
    return Picture(np.zeros((height, width, 3), np.uint8), None, (note,))


def point_under(shown: tuple[Shown, ...], wanted: Wanted, x: float, y: float) -> Array | None:
    """[3] metres: what is drawn at a place of the window, x and y in [0, 1]; None for nothing."""
    width, height = 1000, max(round(1000 / wanted.aspect), 1)
    count = len(wanted.models) if wanted.arrangement == SIDE_BY_SIDE else 1
    for number, cell in enumerate(cells(count, width, height)):
        if cell.holds(x * width, y * height):
            its, camera = shown[wanted.models[number]], wanted.camera(cell)
            pixel = (x * width - cell.left, y * height - cell.top)
            return its.point_at(pixel, wanted.eye.viewmat, camera, its.t_at(wanted.second))
    return None
