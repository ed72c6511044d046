"""A plan as a Blender scene: meshes, vehicles, light, camera. Meshes and materials are shared between copies."""

import math
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from synth.blender.materials import INSTANCE, TINT, material
from synth.camera import OPENCV_TO_OPENGL, invert_rigid
from synth.city.mesh import Mesh
from synth.city.vehicles import vehicle_mesh
from synth.plan import Frame, Plan
from synth.spec import Camera, Light

CLIP_END_M = 5000.0
HORIZON = (1.0, 0.98, 0.73)  # mixed into the sky's colour where it meets the ground


@dataclass(frozen=True)
class Stage:
    """What is placed anew for every frame."""

    scene: Any
    camera: Any
    vehicles: tuple[Any, ...]

    def place(self, plan: Plan, frame: Frame) -> None:
        """Put the camera and the vehicles where they are at the frame's instant: no keyframes, no interpolation."""
        self.camera.matrix_world = Matrix((invert_rigid(frame.viewmat) @ OPENCV_TO_OPENGL).tolist())
        poses, present = plan.fleet.object_to_world(frame.time_s), plan.fleet.present(frame.time_s)
        for vehicle, pose, here in zip(self.vehicles, poses, present, strict=True):
            vehicle.matrix_world = Matrix(pose.tolist())
            if vehicle.hide_render == bool(here):
                vehicle.hide_render = not here


def build_stage(plan: Plan) -> Stage:
    """Build everything into the current, empty scene."""
    scene = bpy.context.scene
    collection = scene.collection
    collection.objects.link(bpy.data.objects.new("city", mesh_data("city", plan.city.static)))
    if plan.city.land.faces:
        collection.objects.link(_land(plan.city.land))
    props = {name: mesh_data(name, mesh) for name, mesh in plan.city.props.items()}
    for index, placement in enumerate(plan.city.placements):
        prop = bpy.data.objects.new(f"{placement.mesh}.{index:03d}", props[placement.mesh])
        prop.location, prop.scale = placement.position, (placement.scale,) * 3
        prop.rotation_euler = (0, 0, placement.angle)
        collection.objects.link(prop)
    kinds = sorted({instance.kind for instance in plan.fleet.instances})
    models = {model.kind: model for model in plan.models if model.kind in kinds}
    bodies = {kind: mesh_data(kind, vehicle_mesh(kind)) for kind in kinds if kind not in models}
    if models:
        from synth.blender.assets import import_model

        bodies |= {kind: import_model(model) for kind, model in models.items()}
    vehicles = []
    for instance in plan.fleet.instances:
        vehicle = bpy.data.objects.new(instance.name, bodies[instance.kind])
        vehicle[INSTANCE] = float(instance.id)
        vehicle.color = (*instance.paint, 1)
        collection.objects.link(vehicle)
        vehicles.append(vehicle)
    _light(scene, plan.scene.light)
    farthest = max((max(map(abs, vertex)) for vertex in plan.city.land.vertices), default=0.0)
    return Stage(scene, _camera(scene, plan.scene.camera, max(CLIP_END_M, 2 * farthest)), tuple(vehicles))


def _land(mesh: Mesh) -> Any:
    """Seen by the camera alone: the light of what stands in the scene is the same with and without it."""
    thing = bpy.data.objects.new("land", mesh_data("land", mesh))
    thing.visible_diffuse = thing.visible_glossy = thing.visible_transmission = False
    thing.visible_volume_scatter = thing.visible_shadow = False
    return thing


def mesh_data(name: str, mesh: Mesh) -> Any:
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh.vertices, [], mesh.faces)
    surfaces = sorted(set(mesh.surfaces))
    for surface in surfaces:
        data.materials.append(material(surface))
    slots = {surface: slot for slot, surface in enumerate(surfaces)}
    data.polygons.foreach_set("material_index", [slots[surface] for surface in mesh.surfaces])
    tint = data.attributes.new(TINT, "FLOAT_COLOR", "CORNER")
    sizes = [len(face) for face in mesh.faces]
    colours = np.concatenate([np.array(mesh.tints), np.ones((len(sizes), 1))], axis=1)
    tint.data.foreach_set("color", np.repeat(colours, sizes, axis=0).astype(np.float32).ravel())
    data.update()
    return data


def _camera(scene: Any, camera: Camera, clip_end_m: float) -> Any:
    data = bpy.data.cameras.new("drone")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = 36.0
    data.lens = 0.5 * data.sensor_width / math.tan(0.5 * math.radians(camera.hfov_deg))
    data.clip_end = clip_end_m
    drone = bpy.data.objects.new("drone", data)
    scene.collection.objects.link(drone)
    scene.camera = drone
    return drone


def _light(scene: Any, light: Light) -> None:
    """A sun lamp, and a sky that pales towards the horizon (the same nodes in every version of Blender)."""
    data = bpy.data.lights.new("sun", "SUN")
    data.energy, data.angle, data.color = light.sun_strength, math.radians(light.sun_angle_deg), light.sun_colour
    sun = bpy.data.objects.new("sun", data)
    # A sun lamp shines along its -z; turned so that it comes from the azimuth (counter-clockwise from east).
    sun.rotation_euler = (0, math.radians(90 - light.sun_elevation_deg), math.radians(light.sun_azimuth_deg))
    scene.collection.objects.link(sun)

    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = light.sky_strength
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    pale = [0.6 * channel + 0.4 * top for channel, top in zip(light.sky_colour, HORIZON, strict=True)]
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[0].color = 0.0, (*pale, 1)
    ramp.color_ramp.elements[1].position, ramp.color_ramp.elements[1].color = 0.6, (*light.sky_colour, 1)
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    tree.links.new(split.outputs["Z"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], background.inputs["Color"])
