"""Shadows of clouds that drift over the ground: a sheet above the scene that only dims light on its way down."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.seeds import generator
from synth.spec import Light
from synth.staging import Staging

STAGE = "scene"
COST = "one more surface for every shadow ray"
TRUTH = "activity: what a shadow's edge passes is appearance-only"

Array = NDArray[np.float64]
RESOLUTION = 256  # texels of the repeating pattern on each side
REPEATS_AFTER = 6  # times the size of a cloud
HEIGHT_M, REACH_M = 2500.0, 40_000.0  # above every camera; wide enough for a sun at five degrees


@dataclass(frozen=True, kw_only=True)
class Settings:
    size_m: float = key("typical distance between clouds", unit="meters", range=(10, 2000), default=80.0)
    cover: float = key("share of the ground that is in shadow", range=(0.05, 0.95), default=0.4)
    darkness: float = key("share of the sunlight that a cloud takes", range=(0, 1), default=0.8)
    velocity_mps: tuple[float, float] = key(
        "drift of the shadows to the east and the north", unit="m/s", range=(-50, 50), default=(6.0, 2.0)
    )


class Clouds(Staging):
    def __init__(self, settings: Settings, light: Light, seed: int) -> None:
        self.settings = settings
        self.period_m = REPEATS_AFTER * settings.size_m
        self.transmission = pattern(settings, generator(seed, "clouds"))
        elevation, azimuth = math.radians(light.sun_elevation_deg), math.radians(light.sun_azimuth_deg)
        self.per_height = np.array([math.cos(azimuth), math.sin(azimuth)]) / math.tan(elevation)

    def drift(self, time_s: float) -> Array:
        """Where the pattern's corner has moved to [2], within one period, metres."""
        return np.asarray(np.array(self.settings.velocity_mps) * time_s % self.period_m)

    def brightness(self, points: Array, time_s: float) -> Array:
        """Share of the sunlight that arrives at world points [..., 3]."""
        above = points[..., :2] + self.per_height * (HEIGHT_M - points[..., 2:])
        at = (above - self.drift(time_s)) / self.period_m * RESOLUTION - 0.5
        corner = np.floor(at).astype(np.int64)
        (x, y), (fx, fy) = np.moveaxis(corner, -1, 0), np.moveaxis(at - corner, -1, 0)
        texel = [[self.transmission[(y + j) % RESOLUTION, (x + i) % RESOLUTION] for i in (0, 1)] for j in (0, 1)]
        below, over = (row[0] * (1 - fx) + row[1] * fx for row in texel)
        return np.asarray(below * (1 - fy) + over * fy)

    def build(self, stage: Any) -> None:
        data = stage.data
        image = data.images.new("clouds", RESOLUTION, RESOLUTION, float_buffer=True, is_data=True)
        grey = self.transmission.astype(np.float32)[..., None]
        image.pixels.foreach_set(np.concatenate([grey, grey, grey, np.ones_like(grey)], axis=-1).ravel())
        image.pack()
        material = data.materials.new("clouds")
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        self.mapping = tree.nodes.new("ShaderNodeMapping")
        self.mapping.inputs["Scale"].default_value = (1 / self.period_m, 1 / self.period_m, 1.0)
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image, texture.extension, texture.interpolation = image, "REPEAT", "Linear"
        shader, output = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeOutputMaterial")
        position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
        tree.links.new(position, self.mapping.inputs["Vector"])
        tree.links.new(self.mapping.outputs["Vector"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        mesh = data.meshes.new("clouds")
        corners = [(x * REACH_M, y * REACH_M, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        mesh.materials.append(material)
        sheet = data.objects.new("clouds", mesh)
        sheet.location = (0, 0, HEIGHT_M)
        for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter"):
            setattr(sheet, f"visible_{ray}", False)
        stage.scene.collection.objects.link(sheet)

    def place(self, time_s: float) -> None:
        x, y = -self.drift(time_s) / self.period_m  # the node adds after it scales
        self.mapping.inputs["Location"].default_value = (x, y, 0.0)


def pattern(settings: Settings, rng: np.random.Generator) -> Array:
    """Share of the light that passes [R, R], repeating: smooth noise, cut so that `cover` of it is cloud."""
    frequency = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(RESOLUTION, 1 / RESOLUTION)]))
    spectrum = np.exp(-(((frequency - REPEATS_AFTER) / (0.5 * REPEATS_AFTER)) ** 2)) * (frequency > 0)
    noise = np.fft.ifft2(np.fft.fft2(rng.normal(size=(RESOLUTION, RESOLUTION))) * spectrum).real
    edge = np.quantile(noise, 1 - settings.cover)
    soft = np.clip((noise - edge) / (0.5 * noise.std()) + 0.5, 0, 1)
    return np.asarray(1 - settings.darkness * soft * soft * (3 - 2 * soft))


def stage(settings: Settings, plan: Any) -> Clouds:
    return Clouds(settings, plan.scene.light, plan.scene.seed)
