"""The interface in other languages. Texts that Blender itself translates (Bake, Speed, Opacity) are not repeated."""

import bpy

GERMAN = {
    "Import AdaAnchor4D": "AdaAnchor4D importieren",
    "Import Model": "Modell importieren",
    "Import a trained scene as points that follow the timeline, with the drone's camera": (
        "Eine trainierte Szene als Punkte importieren, die der Zeitleiste folgen, mit der Kamera der Drohne"
    ),
    "Carrier": "Träger",
    "What the points stand for": "Wofür die Punkte stehen",
    "Anchors": "Anker",
    "Gaussians": "Gaußfunktionen",
    "Look": "Aussehen",
    "Seen From": "Gesehen von",
    "Capture's Camera": "Kamera der Aufnahme",
    "Active Camera": "Aktive Kamera",
    "Frozen": "Eingefroren",
    "Drone Camera": "Kamera der Drohne",
    "Footage Behind": "Aufnahme dahinter",
    "Set Timeline": "Zeitleiste einstellen",
    "Set Up Scene": "Szene einrichten",
    "Most Points": "Höchstzahl der Punkte",
    "Live": "Live",
    "Baked": "Gebacken",
    "Stands Still": "Steht still",
    "Show at Once": "Gleich zeigen",
    "; {:.4g} frames a second in a scene of {:.4g}": "; {:.4g} Bilder pro Sekunde in einer Szene von {:.4g}",
    "Cycles is switched off: the render engine stays as it was": "Cycles ist aus: die Engine bleibt, wie sie war",
    "This Blender was built without USD": "Dieses Blender wurde ohne USD gebaut",
    "Live: {:.1f} ms a frame": "Live: {:.1f} ms pro Bild",
    "Playing: {:.1f} mm off": "Abspielen: {:.1f} mm daneben",
    "{} vehicles": "{} Fahrzeuge",
    "; {} vehicles": "; {} Fahrzeuge",
    "Vehicle {}": "Fahrzeug {}",
    "Vehicles": "Fahrzeuge",
    "Vehicles as Objects": "Fahrzeuge als Objekte",
    "An object for each vehicle, to select, hide, delete and colour, where the model knows vehicles": (
        "Ein Objekt für jedes Fahrzeug, zum Auswählen, Ausblenden, Löschen und Färben, wo das Modell Fahrzeuge kennt"
    ),
    "Apply Look to All": "Aussehen auf alle anwenden",
    "Give the world and all vehicles of this import the look, the filters and the trail of the active object": (
        "Der Welt und allen Fahrzeugen dieses Imports Aussehen, Filter und Spur des aktiven Objekts geben"
    ),
    "Paint": "Lack",
    "Paint Strength": "Stärke des Lacks",
    "; between them vehicles are at most {:.3f} m off their path": (
        "; dazwischen sind Fahrzeuge höchstens {:.3f} m neben ihrer Bahn"
    ),
    "Bake Range": "Bereich backen",
    "Free Bake": "Backen verwerfen",
    "Freeze View": "Blick einfrieren",
    "Trained Picture": "Trainiertes Bild",
    "The world stays yours: only one of Set Up Scene is the background": (
        "Die Welt bleibt die eigene: Hintergrund ist nur die von Szene einrichten"
    ),
    "Native Splats need Blender 5.3; here they are drawn as Gaussians, slower and without harmonics.": (
        "Eigene Splats braucht Blender 5.3; hier werden sie als Gaußfunktionen gezeichnet, langsamer und ohne "
        "Harmonische."
    ),
    "Harmonics": "Harmonische",
    "Colours off by {:.4f}": "Farben {:.4f} daneben",
    "Without: {:.4f}": "Ohne sie: {:.4f}",
    "; colours are off by {:.4f} with harmonics, {:.4f} without": (
        "; Farben sind mit Harmonischen um {:.4f} daneben, ohne um {:.4f}"
    ),
    "Harmonics are of Native Splats of a model, which this import does not show": (
        "Harmonische haben nur eigene Splats eines Modells, die dieser Import nicht zeigt"
    ),
    "Relink": "Neu verknüpfen",
    "Inspection": "Untersuchung",
    "Fit Legend": "Legende anpassen",
    "Measure Selection": "Auswahl vermessen",
    "Add DACW Grid": "DACW-Gitter hinzufügen",
    "Compositing and Export": "Compositing und Export",
    "Set Up Compositing": "Compositing einrichten",
    "All in One Render": "Alles in einem Bild",
    "Over the Footage": "Über der Aufnahme",
    "Cast Shadows": "Wirft Schatten",
    "Export 3DGS PLY": "3DGS-PLY exportieren",
    "Export USD Points": "USD-Punkte exportieren",
    "Start Frame": "Erstes Bild",
    "Outside the Clip": "Außerhalb des Clips",
    "Set Time by Hand": "Zeit von Hand",
    "Colour By": "Farbe nach",
    "Minimum Opacity": "Mindestdeckkraft",
    "Moved at Least": "Bewegt um mindestens",
    "Moved at Most": "Bewegt um höchstens",
    "Crop Object": "Zuschnittobjekt",
    "Trail": "Spur",
    "Ghost Distance": "Abstand der Spur",
    "Baking {} of {}; Esc cancels": "{} von {} gebacken; Esc bricht ab",
    "Bake cancelled; nothing has changed": "Backen abgebrochen; nichts wurde geändert",
    "Baked {} keys": "{} Schlüssel gebacken",
    "Choose a name for the file to write": "Einen Namen für die Datei wählen",
    "The name of the file must end in {}": "Der Name der Datei muss auf {} enden",
    "The object has no points left": "Das Objekt hat keine Punkte mehr",
    "The object belongs to another file; make it local first": (
        "Das Objekt gehört zu einer anderen Datei; zuerst lokal machen"
    ),
    "Imported {:,} points over {} frames; Material Preview shows their colours": (
        "{:,} Punkte über {} Bilder importiert; die Materialvorschau zeigt ihre Farben"
    ),
}
CONTEXTS = ("*", "Operator")
TABLE = {"de_DE": {(context, text): german for text, german in GERMAN.items() for context in CONTEXTS}}


def register() -> None:
    """Offer the translations to Blender."""
    bpy.app.translations.register(__package__, TABLE)


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(__package__)
