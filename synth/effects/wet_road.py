"""After rain: the road is darker and shines, and puddles mirror the sky."""

from dataclasses import dataclass
from typing import Any

from synth.checking import key
from synth.staging import Staging

STAGE = "scene"
COST = "reflections on the road: a little more noise"
TRUTH = "none"

SURFACES = ("asphalt", "patch", "marking", "iron", "pavement", "kerb")


@dataclass(frozen=True, kw_only=True)
class Settings:
    wetness: float = key("0 is dry, 1 is soaked", range=(0, 1), default=0.8)
    puddles: float = key("share of the ground under standing water", range=(0, 1), default=0.25)
    puddle_m: float = key("typical distance between puddles", unit="meters", range=(0.5, 100), default=6.0)


class WetRoad(Staging):
    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def build(self, stage: Any) -> None:
        for name in SURFACES:
            material = stage.data.materials.get(name)
            if material is not None:
                self._wet(material.node_tree)

    def _wet(self, tree: Any) -> None:
        shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        colour, roughness = shader.inputs["Base Color"], shader.inputs["Roughness"]
        darker = tree.nodes.new("ShaderNodeVectorMath")
        darker.operation = "MULTIPLY"
        darker.inputs[1].default_value = (1 - 0.5 * self.settings.wetness,) * 3  # water fills the pores
        tree.links.new(colour.links[0].from_socket, darker.inputs[0])
        tree.links.new(darker.outputs[0], colour)
        noise = tree.nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value = 1 / self.settings.puddle_m
        tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], noise.inputs["Vector"])
        # Blender's noise lies around 0.5 with a spread of about 0.15.
        shore = tree.nodes.new("ShaderNodeMapRange")
        edge = 0.5 + 0.4 * (0.5 - self.settings.puddles)
        damp = roughness.default_value * (1 - 0.5 * self.settings.wetness)
        limits = {"From Min": edge - 0.03, "From Max": edge + 0.03, "To Min": damp, "To Max": 0.03}
        for name, limit in limits.items():
            shore.inputs[name].default_value = limit
        tree.links.new(noise.outputs[0], shore.inputs["Value"])
        tree.links.new(shore.outputs["Result"], roughness)


def stage(settings: Settings, plan: Any) -> WetRoad:  # noqa: ARG001
    return WetRoad(settings)
