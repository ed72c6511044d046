"""What a person meets of the packaged extension: presets, texts, tooltips, and no traceback."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from driving import attribute, clip_positions, go_to, imported


def test_presets_set_what_exists(bpy: Any, extension: str) -> None:
    """Blender finds them, and each names properties and values that the operator has."""
    operators = importlib.import_module(f"{extension}.operators")
    for name, count in (("aa4d.import_model", 3), ("aa4d.bake", 2)):
        folders = [Path(path) for path in bpy.utils.preset_paths(f"operator/{name}")]
        presets = [preset for folder in folders for preset in folder.glob("*.py")]
        assert len(presets) == count
        cls = next(cls for cls in operators.CLASSES if getattr(cls, "bl_idname", "") == name)
        known = getattr(bpy.ops.aa4d, name.removeprefix("aa4d.")).get_rna_type().properties
        assert "PRESET" in cls.bl_options
        for preset in presets:
            settings = [line for line in preset.read_text().splitlines() if line.startswith("op.")]
            assert settings
            for line in settings:
                key, value = line.removeprefix("op.").split(" = ")
                if known[key].type == "ENUM":
                    assert value.strip('"') in known[key].enum_items
                else:
                    assert value in ("True", "False") or float(value) > 0


def test_translations_are_of_texts_that_exist(bpy: Any, extension: str) -> None:
    table = importlib.import_module(f"{extension}.translations").GERMAN
    folder = Path(importlib.import_module(extension).__file__).parent
    source = "".join(path.read_text() for path in folder.rglob("*.py") if path.name != "translations.py")
    assert [text for text in table if f'"{text}"' not in source and f'"""{text}"""' not in source] == []
    view = bpy.context.preferences.view
    before = view.language, view.use_translate_interface
    if "de_DE" in view.bl_rna.properties["language"].enum_items:
        try:
            view.language, view.use_translate_interface = "de_DE", True
            assert bpy.app.translations.pgettext_iface("Import Model") in ("Modell importieren", "Import Model")
        finally:
            view.language, view.use_translate_interface = before


def test_everything_has_a_tooltip(bpy: Any, extension: str, model_path: Path) -> None:
    operators = importlib.import_module(f"{extension}.operators")
    own = {name for cls in operators.CLASSES for base in cls.__mro__ for name in getattr(base, "__annotations__", {})}
    assert {"carrier", "use_range", "mode"} <= own
    own.discard("filter_glob")
    for cls in operators.CLASSES:
        if not issubclass(cls, bpy.types.Operator):
            continue
        rna = getattr(bpy.ops.aa4d, cls.bl_idname.removeprefix("aa4d.")).get_rna_type()
        assert rna.description
        assert all(
            rna.properties[name].description for name in own - {"filepath", "directory"} if name in rna.properties
        )
    obj = imported(bpy, model_path)
    modifiers = importlib.import_module(f"{extension}.modifiers")
    for modifier in obj.modifiers:
        assert all(item.description for item in modifiers.inputs_of(modifier.node_group))
    assert all(p.description for p in obj.aa4d.bl_rna.properties if p.identifier not in ("rna_type", "name"))


def test_what_a_person_took_apart_gives_no_traceback(bpy: Any, model_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [2])[0]
    go_to(bpy, 1)
    foreign = bpy.data.node_groups.new("foreign", "GeometryNodeTree")
    for modifier in obj.modifiers:
        modifier.node_group = foreign
    capfd.readouterr()
    go_to(bpy, 3)
    np.testing.assert_array_equal(attribute(obj.data, "position"), expected)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    obj.modifiers.clear()
    go_to(bpy, 2)
    obj.data.attributes.remove(obj.data.attributes["aa_id"])
    go_to(bpy, 3)
    go_to(bpy, 4)
    output = "".join(capfd.readouterr())
    assert output.count("has lost its attribute aa_id") == 1
    assert "Traceback" not in output
