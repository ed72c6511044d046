"""What a person meets of the packaged extension: presets, texts, tooltips, and no traceback."""

import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, go_to, imported, set_input
from model_files import make_model, write_model

LOOK = "AdaAnchor4D"


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


CONTENT = 176  # pixels across a panel at the sidebar's default width, of a screenshot
ICON, FIELD = 20, 24  # pixels that an icon takes, and the arrows of a number field


def width_of(text: str) -> float:
    """Pixels of a text in Blender's own font at its own size."""
    import blf

    blf.size(0, 11)
    return blf.dimensions(0, text)[0]


class Layout:
    """A stand-in that notes how wide what is drawn must be: without a window Blender draws no panels."""

    def __init__(self, room: float, found: list[tuple[str, float, float]]) -> None:
        self.room, self.found = room, found

    def note(self, text: str, taken: float) -> None:
        self.found.append((text, width_of(text) + taken, self.room))

    def column(self, **_: Any) -> Any:
        return Layout(self.room, self.found)

    def row(self, **_: Any) -> Any:
        return Layout(self.room / 2, self.found)  # the rows of these panels hold two

    def box(self) -> Any:
        return Layout(self.room - 6, self.found)

    def label(self, text: str, icon: str = "NONE", **_: Any) -> None:
        self.note(text, ICON * (icon != "NONE"))

    def operator(self, name: str, text: str = "", icon: str = "NONE", **_: Any) -> Any:
        import bpy

        label = getattr(bpy.ops.aa4d, name.removeprefix("aa4d.")).get_rna_type().name
        self.note(text or label, ICON * (icon != "NONE"))
        return SimpleNamespace()

    def operator_menu_enum(self, name: str, _: str) -> None:
        self.operator(name, icon="MENU")

    def prop(self, owner: Any, path: str, text: str | None = None, **_: Any) -> None:
        value = owner.path_resolve(path)
        kind = owner.bl_rna.properties.get(path)
        name = kind.name if text is None and kind is not None else text or ""
        if path == "filepath" or path == "name":  # a field to type into
            return
        number = f"{value:.7g} m" if isinstance(value, float) else ""
        self.note(name + number, FIELD)

    def prop_search(self, *_: Any, text: str, **__: Any) -> None:
        self.note(text, 100)

    def template_color_ramp(self, *_: Any, **__: Any) -> None:
        pass


@pytest.mark.parametrize("shown", ["Trained Colour", "Plane Weight", "Speed", "Activity"])
def test_labels_are_whole_at_the_default_width(bpy: Any, extension: str, model_path: Path, shown: str) -> None:
    panel = importlib.import_module(f"{extension}.panel")
    obj = imported(bpy, model_path, carrier="GAUSSIANS", harmonics=3)
    set_input(extension, obj, LOOK, "Colour By", shown)
    set_input(extension, obj, LOOK, "Crop", "Inside")
    assert bpy.ops.aa4d.measure_selection() == {"FINISHED"}
    found: list[tuple[str, float, float]] = []
    for cls in (panel.ImportPanel, panel.TimePanel, panel.LookPanel, panel.InspectionPanel, panel.OutputPanel):
        stand_in = SimpleNamespace(layout=Layout(CONTENT, found))
        stand_in.draw_legend = lambda *given: panel.InspectionPanel.draw_legend(None, *given)
        cls.draw(stand_in, bpy.context)
    expected = {"Outside the Clip", "Seen From"}
    if hasattr(bpy.types, "GeometryNodePointsSetType"):
        expected.add("Harmonics")
    assert expected <= {text for text, _, _ in found}
    assert [entry for entry in found if entry[1] > entry[2]] == []
    assert len(found) > 35


def test_first_sight_is_in_colour_and_frames_the_scene(bpy: Any, model_path: Path) -> None:
    """The view's own numbers, projected by hand: most of the points lie in it, and they fill it."""
    from mathutils import Matrix

    area = next(area for area in bpy.context.screen.areas if area.type == "VIEW_3D")
    space, window = area.spaces.active, next(region for region in area.regions if region.type == "WINDOW")
    assert space.shading.type == "SOLID"
    obj = imported(bpy, model_path)
    assert space.shading.type == "MATERIAL"
    assert bpy.context.active_object == obj
    assert not obj.select_get()  # the outline of thousands of points would hide their colours
    view = space.region_3d
    matrix = Matrix.Translation(view.view_location) @ view.view_rotation.to_matrix().to_4x4()
    matrix = np.array((matrix @ Matrix.Translation((0, 0, view.view_distance))).inverted())
    places = attribute(obj.data, "position") @ matrix[:3, :3].T + matrix[:3, 3]
    seen = places[:, :2] / -places[:, 2:] * space.lens / 36 * max(window.width, window.height)
    share = np.abs(seen) / (window.width, window.height)
    assert (places[:, 2] < 0).all()
    assert (share.max(axis=1) <= 1).mean() >= 0.9
    assert share.max() > 0.8
    assert -places[:, 2].min() < space.clip_end
    _, information = make_model(60, 5)  # from the side of the drone in the middle of the clip
    backwards = np.array(information["frames"][2]["viewmat"])[2, :3] * -1
    np.testing.assert_allclose(view.view_rotation.to_matrix().col[2], backwards, atol=1e-4)


def test_view_stays_where_that_is_wanted(bpy: Any, model_path: Path) -> None:
    space = next(area for area in bpy.context.screen.areas if area.type == "VIEW_3D").spaces.active
    before = space.shading.type, space.region_3d.view_distance
    imported(bpy, model_path, show=False)
    assert (space.shading.type, space.region_3d.view_distance) == before
    assert bpy.context.active_object.select_get()
    space.shading.type = "RENDERED"
    imported(bpy, model_path)
    assert space.shading.type == "RENDERED"
    assert space.region_3d.view_distance != before[1]


@pytest.mark.parametrize("groups", [0, 3])
def test_motion_of_anchors_alone_is_said_to_be_that(bpy: Any, extension: str, tmp_path: Path, groups: int) -> None:
    panel = importlib.import_module(f"{extension}.panel")
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", *make_model(60, 5, groups=groups)))

    def said() -> bool:
        found: list[tuple[str, float, float]] = []
        stand_in = SimpleNamespace(layout=Layout(CONTENT, found), draw_legend=lambda *_: None)
        panel.InspectionPanel.draw(stand_in, bpy.context)
        return "knows no vehicles" in " ".join(text for text, _, _ in found)

    assert not said()
    for modifier, name, value in (
        (LOOK, "Colour By", "Speed"),
        (LOOK, "Moved at Least", 1.0),
        ("AdaAnchor4D Time", "Trail", 3),
    ):
        before = importlib.import_module(f"{extension}.modifiers").get(obj.modifiers[modifier], name)
        set_input(extension, obj, modifier, name, value)
        assert said() == (groups == 0)
        set_input(extension, obj, modifier, name, before)
    set_input(extension, obj, LOOK, "Colour By", "Speed")
    assert bpy.ops.aa4d.measure_selection() == {"FINISHED"}
    lines = importlib.import_module(f"{extension}.operators.inspection").statistics[obj.session_uid]
    assert any("of the anchors" in line for line in lines) == (groups == 0)


def test_dropped_file_is_imported_by_what_a_drop_calls(bpy: Any, model_path: Path) -> None:
    """Blender's own operator of a drop, with the area under the pointer; where no model belongs, nothing happens."""
    dropped = {"directory": str(model_path.parent), "files": [{"name": model_path.name}]}
    for kind in ("VIEW_3D", "OUTLINER", "PROPERTIES"):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        window = bpy.context.window_manager.windows[0]
        area = next(area for area in window.screen.areas if area.type == kind)
        region = next(region for region in area.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=area, region=region):
            result = bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", **dropped)
        assert result == ({"FINISHED"} if kind != "PROPERTIES" else {"CANCELLED"})
        assert any(obj.aa4d.filepath for obj in bpy.data.objects) == (kind != "PROPERTIES")
