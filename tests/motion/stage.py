"""A closed-form stage: textured ground, boxes that move over it, a drone; and the observations of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from aa4d.motion.ground import project
from aa4d.motion.observations import Observations

WIDTH, HEIGHT = 256, 144
K = np.array([[200.0, 0, WIDTH / 2], [0, 200.0, HEIGHT / 2], [0, 0, 1]])
Way = Callable[[float], tuple[float, float, float] | None]  # clip frame -> x, y, heading; None: not there


@dataclass(frozen=True)
class Box:
    way: Way
    size: tuple[float, float, float] = (4.5, 1.8, 1.5)
    seed: int = 0


def texture(seed: int, size: int = 512, contrast: float = 40, base: float = 120, grain: float = 3) -> np.ndarray:
    generator = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(generator.normal(0, 1, (size, size, 3)), (0, 0), grain)
    tint = np.random.default_rng(seed + 99).uniform(-40, 40, 3) if seed else np.zeros(3)
    return np.clip(base + tint + contrast * noise / noise.std(), 0, 255).astype(np.uint8)


def drone(frame: float, frames: int, level: float = 0.0, sweep: float = 0.5, height: float = 42.0) -> np.ndarray:
    a = sweep * (frame / max(frames - 1, 1) - 0.5)
    eye = np.array([30 * np.sin(a), -30 * np.cos(a), height + level])
    forward = np.array([0, 0, level]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    view[:3, 3] = -view[:3, :3] @ eye
    return view


@dataclass(frozen=True)
class Stage:
    boxes: tuple[Box, ...] = ()
    frames: int = 24
    every: int = 1  # training frames among the clip's
    level: float = 0.0
    slope: float = 0.0  # along x
    sweep: float = 0.5  # radians of the arc; 0 hovers
    paint: Callable[[np.ndarray, float], np.ndarray] | None = None  # what else a frame shows, [H, W, 3] and clip frame

    def land(self, x: np.ndarray) -> np.ndarray:
        return self.level + self.slope * x

    def empty(self, view: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ground alone: colour and depth_z."""
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        local = np.stack([(u + 0.5 - K[0, 2]) / K[0, 0], (v + 0.5 - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
        rays, center = local @ view[:3, :3], -view[:3, :3].T @ view[:3, 3]
        depth = (self.level + self.slope * center[0] - center[2]) / (rays[..., 2] - self.slope * rays[..., 0])
        points = center + rays * depth[..., None]
        place = ((points[..., :2] + 60) / 120 * len(ground)).astype(np.float32)
        color = cv2.remap(ground, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return color, depth.astype(np.float32)

    def draw(self, image: np.ndarray, instance: np.ndarray, view: np.ndarray, frame: float) -> None:
        """The boxes, nearer ones over farther ones: every face a textured quadrilateral."""
        center = -view[:3, :3].T @ view[:3, 3]
        here = [(i, box, box.way(frame)) for i, box in enumerate(self.boxes)]
        here = [item for item in here if item[2] is not None]
        here.sort(key=lambda item: -np.hypot(item[2][0] - center[0], item[2][1] - center[1]))
        for i, box, (x, y, heading) in here:
            length, width, height = box.size
            c, s = np.cos(heading), np.sin(heading)
            corners = np.array([[a, b] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * [length / 2, width / 2]
            floor = corners @ np.array([[c, s], [-s, c]]) + [x, y]
            low = np.column_stack([floor, self.land(floor[:, 0])])
            high = low + np.array([0, 0, height])
            faces = [(high, 0), *((np.array([low[k], low[k - 3], high[k - 3], high[k]]), k + 1) for k in range(4))]
            for quad, k in faces[1:] + faces[:1]:
                normal = np.cross(quad[1] - quad[0], quad[2] - quad[0])
                middle = quad.mean(0)
                outward = middle - np.array([x, y, self.land(np.array(x)) + height / 2])
                normal = normal * np.sign(normal @ outward)
                if normal @ (center - middle) <= 0:
                    continue
                pixels = project(quad, view, K)[0].astype(np.float32)
                skin = texture(100 + 7 * box.seed + i, 32, 45, 60 + 130 * (i % 2) + 10 * k, 2)
                square = np.array([[0, 0], [32, 0], [32, 32], [0, 32]], np.float32)
                warp = cv2.getPerspectiveTransform(square, pixels - 0.5)
                face = cv2.warpPerspective(skin, warp, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
                mask = cv2.warpPerspective(np.ones((32, 32), np.float32), warp, (WIDTH, HEIGHT)) > 0.5
                image[mask] = face[mask]
                instance[mask] = i + 1

    def observe(self, noise: float = 0.01, pose_error_deg: float = 0.0) -> tuple[Observations, np.ndarray]:
        """The observations, and the truth [V, H, W]: 0, or the number of the box from 1."""
        ground = texture(0, 1024, 25, 110, 3)
        ranks = np.arange(0, self.frames, self.every)
        images, static, depths, views, truth = [], [], [], [], []
        generator = np.random.default_rng(5)
        for rank in ranks:
            view = drone(rank, self.frames, self.level, self.sweep)
            color, depth = self.empty(view, ground)
            image, instance = color.copy(), np.zeros(color.shape[:2], int)
            self.draw(image, instance, view, float(rank))
            if self.paint:
                image = self.paint(image, float(rank))
            images.append(image)
            static.append(np.clip(color / 255 + generator.normal(0, noise, color.shape), 0, 1))
            depths.append(depth)
            turn = cv2.Rodrigues(generator.normal(0, np.radians(pose_error_deg), 3))[0]
            view = view.copy()
            view[:3] = turn @ view[:3]
            views.append(view)
            truth.append(instance)
        observed = Observations(
            np.stack(images),
            np.stack(static).astype(np.float32),
            np.stack(depths),
            np.stack(views),
            K,
            ranks / max(self.frames - 1, 1),
            ranks,
            self.frames,
            10.0,
        )
        return observed, np.stack(truth)


def line(x: float, y: float, speed: float, heading: float = 0.0, start: float = 0, end: float = 1e9) -> Way:
    """A straight way that passes (x, y) in clip frame 0; there from `start` to `end` only."""

    def at(frame: float) -> tuple[float, float, float] | None:
        if not start <= frame <= end:
            return None
        return x + speed * frame * np.cos(heading), y + speed * frame * np.sin(heading), heading

    return at
