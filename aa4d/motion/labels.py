"""Which pixels show which mover: labels grown from the followed points of bodies, shadows and rims taken off."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aa4d.motion.bodies import BESIDE, LARGER, Body
from aa4d.motion.points import Points

LABEL_PX = 2.5  # from a followed point to a pixel that differs: both show the same mover
GROWTH_PX = 4  # from a label over what differs and is no shadow
AROUND_PX = 2  # what `moving` adds around a label
SHADOW_PX = 6  # how far from a label what differs may be its shadow
SHADE_MOST = 0.6  # of a label; beyond, the mover itself is grey and dark

Mask = NDArray[np.bool_]
Labels = NDArray[np.uint16]


def labels_of(bodies: list[Body], points: Points, differs: Mask, shade: Mask) -> Labels:
    """[V, H, W]: of pixels that show a body, its number from 1.

    Args:
        differs: [V, H, W], from the static scene.
        shade: [V, H, W], pixels that show the static scene, only darker.
    """
    labels = np.stack([_near_points(bodies, points, v, differs[v]) for v in range(len(differs))])
    dark = _shadows(labels, shade)
    labels[dark] = 0
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for v, label in enumerate(labels):
        # The outermost pixels differ because the residual is blurred.
        free = (cv2.erode(differs[v].astype(np.uint8), cross) > 0) & ~shade[v]
        for _ in range(GROWTH_PX):
            label = np.where((label == 0) & free, cv2.dilate(label, cross), label)
        labels[v] = label
    return labels


def _near_points(bodies: list[Body], points: Points, v: int, differs: Mask) -> Labels:
    """[H, W]: what differs beside the points of a body."""
    height, width = differs.shape
    label = np.zeros((height, width), np.uint16)
    here = [g for g, body in enumerate(bodies) if body.number[v]]
    if not here:
        return label
    at = [bodies[g].pixels(points, v) for g in here]
    every, owner = np.concatenate(at), np.repeat(here, [len(a) for a in at])
    near = np.zeros((height, width), np.uint8)
    column, row = np.floor(every).astype(int).T
    near[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = 1
    rows, columns = np.nonzero(cv2.dilate(near, np.ones((7, 7), np.uint8)))
    distance, nearest = cKDTree(every).query(np.stack([columns, rows], axis=1) + 0.5)
    mine = (distance < LABEL_PX) & differs[rows, columns]
    label[rows[mine], columns[mine]] = owner[nearest[mine]] + 1
    return label


def footprints(bodies: list[Body], points: Points, shape: tuple[int, ...]) -> Mask:
    """Of `shape` [V, H, W]: pixels on and beside the points of bodies, whether they differ or not.

    A mover that stands for long is in the static scene: it differs from nothing there.
    """
    result = np.zeros(shape, bool)
    for v in range(shape[0]):
        on = np.zeros(shape[1:], np.uint8)
        for body in bodies:
            column, row = np.floor(body.pixels(points, v)).astype(int).T
            on[np.clip(row, 0, shape[1] - 1), np.clip(column, 0, shape[2] - 1)] = 1
        result[v] = cv2.dilate(on, np.ones((3, 3), np.uint8)) > 0
    return result


def _shadows(labels: Labels, shade: Mask) -> Mask:
    """[V, H, W]: shaded pixels of labels, except of a mover most of whose pixels in a frame are: it is itself dark."""
    result = shade & (labels > 0)
    for v, label in enumerate(labels):
        total = np.bincount(label.ravel())
        dark = np.bincount(label.ravel(), result[v].ravel(), minlength=len(total))
        result[v] &= (dark < SHADE_MOST * total)[label]
    return result


def apart_from_larger(labels: Labels) -> list[int]:
    """Bodies, from 0, whose labels do not lie mostly beside far larger ones: those are their shadows and rims."""
    count = int(labels.max())
    near, total = np.zeros(count + 1), np.zeros(count + 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SHADOW_PX + 1,) * 2)
    for label in labels:
        size = np.bincount(label.ravel(), minlength=count + 1)
        size[0] = 0
        total += size
        here = np.flatnonzero(size)
        for g in here:
            larger = here[size[here] >= LARGER * size[g]]
            if len(larger):
                around = cv2.dilate(np.isin(label, larger).astype(np.uint8), kernel) > 0
                near[g] += (around & (label == g)).sum()
    return [g - 1 for g in range(1, count + 1) if near[g] < BESIDE * total[g]]


def renumbered(labels: Labels, keep: list[int]) -> Labels:
    table = np.zeros(int(labels.max()) + 1, np.uint16)
    for new, old in enumerate(keep):
        table[old + 1] = new + 1
    return np.asarray(table[labels])


def may_move(tracked: Mask, differs: Mask, moves: Mask) -> Mask:
    """[V, H, W]: labels with a rim, what differs beside them, and what differs and moves elsewhere."""
    result = np.zeros_like(tracked)
    rim = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * AROUND_PX + 1,) * 2)
    beside = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SHADOW_PX + 1,) * 2)
    for v in range(len(tracked)):
        label = tracked[v].astype(np.uint8)
        _, regions = cv2.connectedComponents(differs[v].astype(np.uint8), connectivity=8)
        size = np.bincount(regions.ravel())
        share = np.bincount(regions.ravel(), moves[v].ravel()) / np.maximum(size, 1)
        untracked = (size >= 12) & (share > 0.2)
        untracked[0] = False
        loose = untracked[regions] | (differs[v] & (cv2.dilate(label, beside) > 0))
        result[v] = cv2.dilate((tracked[v] | loose).astype(np.uint8), rim) > 0
    return result
