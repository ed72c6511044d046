"""The same held-out frame as every method draws it, the truth first: whole, and cut out where vehicles move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from aa4d.capture.reader import Capture, read_image
from aa4d.capture.truth import boxes_of, instance_ids_of, moving_mask, object_tracks

Picture = NDArray[np.uint8]  # [H, W, 3]
Window = tuple[int, int, int, int]  # left, top, right, bottom, pixels

CROPS = 2  # of a frame
PANEL_WIDTH = 480  # pixels of the composed picture; its other sizes follow from it
GAP, MARGIN, TITLE = 6, 18, 34
SMALLEST_PX = 20  # visible pixels of a vehicle that is worth a crop
AROUND = 1.7  # of a crop's width to its vehicle's longer side
LEAST_SHARE = 0.11  # of the frame's width, that a crop is wide
ASPECT = 4 / 3  # of a crop
BACKGROUND, INK, FAINT = (255, 255, 255), (26, 28, 34), (120, 124, 132)
FRAMES = ((255, 196, 0), (0, 200, 255))  # colors of the crops' frames


@dataclass(frozen=True)
class Panel:
    """What one method drew of the frame; None where its run failed or is not there."""

    title: str
    picture: Picture | None
    note: str = ""  # beside the title


def frames_to_show(capture: Capture, count: int) -> list[int]:
    """The held-out frames with most moving pixels, in order of time; without any, the middle ones."""
    held_out = capture.of_split("test")
    masks = [moving_mask(capture, index) for index in held_out]
    middle = (len(held_out) - 1) / 2
    moving = [0 if mask is None else int(mask.sum()) for mask in masks]
    ranked = sorted(range(len(held_out)), key=lambda n: (-moving[n], abs(n - middle)))
    return sorted(held_out[n] for n in ranked[:count])


def crops_of(capture: Capture, index: int, count: int = CROPS) -> list[Window]:
    """Windows around what moves most in a frame, of one size, none over another; a single one is wide.

    What moves is an instance of the truth, an annotated box that holds moving pixels, or a patch of the mask of movers;
    it moves most by its visible pixels times its speed, where that is known. What the frame's edge cuts comes last.
    """
    width, height = capture.camera.width, capture.camera.height
    things = _moving_things(capture, index)
    whole = [t for t in things if t[0] > 1 and t[1] > 1 and t[2] < width - 1 and t[3] < height - 1]
    chosen: list[Window] = []
    longest = max((max(t[2] - t[0], t[3] - t[1]) for t in (whole or things)[:count]), default=0)
    across = round(min(max(AROUND * longest, LEAST_SHARE * width), width, ASPECT * height))
    size = (across, round(across / ASPECT))
    for thing in (*whole, *(t for t in things if t not in whole)):
        window = _around(thing, size, width, height)
        if len(chosen) < count and not any(_overlap(window, other) for other in chosen):
            chosen.append(window)
    if len(chosen) == 1:  # in the place of all
        return [_around(chosen[0], (min(count * across, width), size[1]), width, height)]
    return sorted(chosen)


def _moving_things(capture: Capture, index: int) -> list[Window]:
    """Boxes of what moves in a frame, the one that moves most first."""
    moving = moving_mask(capture, index)
    if moving is None or not moving.any():
        return []
    ids, boxes = instance_ids_of(capture, index), boxes_of(capture)
    found: list[tuple[float, Window]] = []
    if ids is None and boxes is not None:
        for left, top, right, bottom in boxes.box_px[boxes.frame == index].round().astype(int).tolist():
            if (pixels := int(moving[top:bottom, left:right].sum())) >= SMALLEST_PX:
                found.append((pixels, (left, top, right, bottom)))
    else:
        labels = ndimage.label(moving)[0] if ids is None else np.where(moving, ids, 0)
        names, labels = np.unique(labels, return_inverse=True)
        labels = labels.reshape(moving.shape) + (names[0] != 0)  # from 1, without gaps; 0 is what stands still
        speed = {} if ids is None else _travel(capture, index)
        for number, (rows, columns) in enumerate(ndimage.find_objects(labels), 1):
            pixels = int((labels[rows, columns] == number).sum())
            if pixels >= SMALLEST_PX:
                name = int(names[number - (names[0] != 0)])
                found.append((pixels * speed.get(name, 1.0), (columns.start, rows.start, columns.stop, rows.stop)))
    return [window for _, window in sorted(found, key=lambda entry: -entry[0])]


def _travel(capture: Capture, index: int) -> dict[int, float]:
    """How far each instance goes from the frame before to the one after, in metres."""
    tracks = object_tracks(capture)
    if tracks is None:
        return {}
    before, after = max(index - 1, 0), min(index + 1, len(capture.frames) - 1)
    way = tracks.object_to_world[after, :, :3, 3] - tracks.object_to_world[before, :, :3, 3]
    return dict(zip(tracks.instance_id.tolist(), np.linalg.norm(way, axis=1).tolist(), strict=True))


def _around(thing: Window, size: tuple[int, int], width: int, height: int) -> Window:
    """A window of `size` with the thing in its middle, moved into the frame."""
    left = min(max(round((thing[0] + thing[2] - size[0]) / 2), 0), width - size[0])
    top = min(max(round((thing[1] + thing[3] - size[1]) / 2), 0), height - size[1])
    return left, top, left + size[0], top + size[1]


def _overlap(a: Window, b: Window) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def compose(panels: Sequence[Panel], crops: Sequence[Window], caption: str) -> Image.Image:
    """One picture of all panels, each the whole frame over its crops, framed in the same colors."""
    shown = next(panel.picture for panel in panels if panel.picture is not None)
    height, width = shown.shape[:2]
    frame_height = round(PANEL_WIDTH * height / width)
    crop_height = round((PANEL_WIDTH - GAP) / CROPS / ASPECT) if crops else 0
    crop_width = (PANEL_WIDTH - GAP * (len(crops) - 1)) // max(len(crops), 1)
    panel_height = TITLE + frame_height + (GAP + crop_height if crops else 0)
    columns = _columns(len(panels))
    rows = -(-len(panels) // columns)
    size = (
        2 * MARGIN + columns * PANEL_WIDTH + (columns - 1) * MARGIN,
        MARGIN + rows * (panel_height + MARGIN) + TITLE,
    )
    sheet = Image.new("RGB", size, BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for number, panel in enumerate(panels):
        row, column = divmod(number, columns)
        left = MARGIN + column * (PANEL_WIDTH + MARGIN)
        top = MARGIN + row * (panel_height + MARGIN)
        draw.text((left, top), panel.title, INK, _font(22, bold=True))
        draw.text((left + PANEL_WIDTH, top + 25), panel.note, FAINT, _font(17), anchor="rs")
        top += TITLE
        if panel.picture is None:
            below = panel_height - TITLE
            draw.rectangle((left, top, left + PANEL_WIDTH - 1, top + below - 1), (240, 241, 243))
            middle = (left + PANEL_WIDTH // 2, top + below // 2)
            draw.text(middle, "no result", FAINT, _font(20), anchor="mm")
            continue
        picture = Image.fromarray(panel.picture)
        sheet.paste(picture.resize((PANEL_WIDTH, frame_height), Image.Resampling.BICUBIC), (left, top))
        scale = PANEL_WIDTH / width
        for window, color in zip(crops, FRAMES, strict=False):
            box = [round(scale * edge) for edge in window]
            draw.rectangle((left + box[0], top + box[1], left + box[2], top + box[3]), outline=color, width=2)
        top += frame_height + GAP
        for place, (window, color) in enumerate(zip(crops, FRAMES, strict=False)):
            x = left + place * (crop_width + GAP)
            cut = picture.crop(window).resize((crop_width, crop_height), Image.Resampling.BICUBIC)
            sheet.paste(cut, (x, top))
            draw.rectangle((x, top, x + crop_width - 1, top + crop_height - 1), outline=color, width=3)
    draw.text((MARGIN, size[1] - MARGIN - 4), caption, FAINT, _font(17), anchor="ls")
    return sheet


def _columns(panels: int) -> int:
    """Three or four panels a row, whichever leaves fewer places empty; few panels are two a row."""
    return 2 if panels in (2, 4) else min((3, 4), key=lambda columns: -panels % columns)


def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The one that comes with matplotlib: there on every machine, with all letters."""
    from matplotlib.font_manager import FontProperties, findfont

    return ImageFont.truetype(findfont(FontProperties(weight="bold" if bold else "normal")), size)


def truth_of(capture: Capture, index: int) -> Picture:
    return read_image(capture, capture.frames[index])


def drawn_by(run: Path, capture: Capture, index: int) -> Picture | None:
    """What evaluation wrote of a held-out frame; None where it is not there."""
    path = run / "eval" / f"{capture.frames[index].name}.png"
    if not path.is_file():
        return None
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
