"""Optional parts of a Blender build are asked for before anything is written."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from synth.errors import InputError
from synth.models import Model
from synth.plan import Plan, make_plan
from synth.spec import read_scene


class Settings:
    """Takes of its enumerations what this build has, as Blender's own do."""

    def __init__(self, **choices: tuple[str, ...]) -> None:
        object.__setattr__(self, "choices", choices)
        object.__setattr__(self, "taken", {})

    def __setattr__(self, name: str, value: str) -> None:
        if value not in self.choices[name]:
            raise TypeError(f"bpy_struct: item.attr = val: enum {value!r} not found in {self.choices[name]}")
        self.taken[name] = value


def build(engine: str = "CYCLES", denoiser: str = "OPENIMAGEDENOISE", picture: str = "OPEN_EXR_MULTILAYER",
          ffmpeg: bool = True, importers: tuple[str, ...] = ("gltf", "fbx", "obj_import")) -> Any:  # fmt: skip
    """A Blender with these parts."""
    render = Settings(engine=(engine,))
    object.__setattr__(render, "image_settings", Settings(file_format=(picture,)))
    scene = SimpleNamespace(render=render, cycles=Settings(denoiser=(denoiser,)))
    group = SimpleNamespace(**dict.fromkeys(importers))
    return SimpleNamespace(
        context=SimpleNamespace(scene=scene),
        app=SimpleNamespace(build_options=SimpleNamespace(codec_ffmpeg=ffmpeg)),
        ops=SimpleNamespace(import_scene=group, wm=group),
    )


@pytest.fixture(scope="module")
def plan(tiny_scene: Path) -> Plan:
    scene = read_scene(tiny_scene)
    return make_plan(replace(scene, render=replace(scene.render, denoise=True), effects={"video_compression": {}}))


def refuse(plan: Plan, bpy: Any) -> None:
    from synth.blender.requirements import refuse_what_is_missing

    refuse_what_is_missing(plan, bpy)


def asked_for(bpy: Any) -> dict[str, str]:
    scene = bpy.context.scene
    return {**scene.render.taken, **scene.cycles.taken, **scene.render.image_settings.taken}


def test_a_whole_build_is_taken(plan: Plan) -> None:
    bpy = build()
    refuse(plan, bpy)
    needed = {"engine": "CYCLES", "denoiser": "OPENIMAGEDENOISE", "file_format": "OPEN_EXR_MULTILAYER"}
    assert asked_for(bpy) == needed


def test_each_missing_part_is_one_sentence(plan: Plan) -> None:
    cases = {
        "without Cycles": build(engine="BLENDER_WORKBENCH"),
        r"render\.denoise: .* without OpenImageDenoise; set render\.denoise = false": build(denoiser=""),
        "without OpenEXR": build(picture="PNG"),
        r"effects\.video_compression: .* without FFmpeg": build(ffmpeg=False),
    }
    for words, bpy in cases.items():
        with pytest.raises(InputError, match=words) as caught:
            refuse(plan, bpy)
        assert "\n" not in str(caught.value)


def test_what_the_scene_does_not_use_may_be_missing(plan: Plan) -> None:
    plain = replace(plan, scene=replace(plan.scene, render=replace(plan.scene.render, denoise=False)), effects=())
    bpy = build(denoiser="", ffmpeg=False, importers=())
    refuse(plain, bpy)
    assert asked_for(bpy) == {"engine": "CYCLES", "file_format": "OPEN_EXR_MULTILAYER"}
    with pytest.raises(InputError, match="OpenImageDenoise"):
        refuse(plan, bpy)


@pytest.mark.parametrize(("suffix", "importer"), [(".glb", "gltf"), (".fbx", "fbx"), (".obj", "obj_import")])
def test_importers_are_asked_for(plan: Plan, suffix: str, importer: str) -> None:
    model = Model("bus", Path("bus" + suffix), 0.0, "")
    alone = build(importers=(importer,))
    refuse(replace(plan, models=(model,)), alone)
    assert asked_for(alone)["engine"] == "CYCLES"
    others = tuple({"gltf", "fbx", "obj_import"} - {importer})
    with pytest.raises(InputError, match=f"bus{suffix}: this Blender has no importer"):
        refuse(replace(plan, models=(model,)), build(importers=others))
