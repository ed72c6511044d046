"""SUMO's floating car data: rows of who is where, and which body a vehicle type stands for."""

import csv
import math
import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from synth.errors import InputError
from synth.traffic.fleet import BODIES
from synth.traffic.rows import Row, number, require

# The bodies of SUMO's abstract vehicle classes (vClass), and of other whole words that types are named by.
BODY_OF = {
    "saloon": ("passenger", "private", "car", "veh", "vehicle", "vehtype", "sedan", "saloon", "taxi", "taxitype", "hov",
               "evehicle", "vip", "authority", "custom"),
    "hatchback": ("hatchback",),
    "suv": ("suv", "jeep"),
    "van": ("delivery", "van", "emergency", "ambulance", "minibus"),
    "bus": ("bus", "coach"),
    "truck": ("truck", "trailer", "lorry", "hgv", "army"),
    "cyclist": ("bicycle", "bike", "biketype", "cyclist"),
    "pedestrian": ("pedestrian", "ped", "pedtype", "person"),
}  # fmt: skip
STAND_INS = {
    "cyclist": ("motorcycle", "motorbike", "moto", "moped", "scooter"),
    "pedestrian": ("wheelchair",),
    "bus": ("tram", "rail", "railtype", "train", "subway", "cable"),
}
KIND_OF_WORD = {word: kind for table in (BODY_OF, STAND_INS) for kind, words in table.items() for word in words}
STANDING_IN = {word for words in STAND_INS.values() for word in words}
OTHERWISE = "saloon"


def kind_of_type(name: str) -> tuple[str, str]:
    """The body for a vehicle type or class, by whole words of its name, and a doubt: "" for a body of its own,
    "stands in" for one of another, "unknown" where no word says what it is."""
    for word in re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()):
        for known in (word, word.removesuffix("s")):
            if known in KIND_OF_WORD:
                return KIND_OF_WORD[known], "stands in" if known in STANDING_IN else ""
    return OTHERWISE, "unknown"


def read_vehicle_classes(path: Path) -> dict[str, str]:
    """The vClass of every vehicle type of a SUMO file; SUMO's default is "passenger".

    Raises:
        InputError: the file has none.
        OSError, ElementTree.ParseError: it cannot be read.
    """
    types = {each.get("id", ""): each.get("vClass", "passenger") for each in ElementTree.parse(path).iter("vType")}
    if not types:
        raise InputError(f"{path}: holds no <vType>; name the file with the types that SUMO read (-r or -a).")
    return types


def read_fcd(path: Path, classes: Mapping[str, str]) -> tuple[dict[str, list[Row]], tuple[str, ...]]:
    """Rows by id, and notes on types whose body is a guess. SUMO gives the middle of the front bumper, and angles
    clockwise from north. A type's class is that of `classes`, or else said by its own name.

    Raises:
        InputError: a column is missing, or a number is none.
        OSError, UnicodeDecodeError, ElementTree.ParseError: the file cannot be read.
    """
    table = _Table(path, classes)
    (table.read_xml if path.suffix.lower() == ".xml" else table.read_csv)()
    return table.rows, table.notes()


class _Table:
    """Rows while they are read; `doubts` are the types without a body of their own, with what they became."""

    def __init__(self, path: Path, classes: Mapping[str, str]) -> None:
        self.path, self.classes = path, classes
        self.rows: dict[str, list[Row]] = {}
        self.kinds: dict[tuple[str, str], str] = {}
        self.doubts: dict[str, dict[str, str]] = {"stands in": {}, "unknown": {}}

    def read_xml(self) -> None:
        time = "0"
        for event, element in ElementTree.iterparse(self.path, events=("start", "end")):
            if event == "start" and element.tag == "timestep":
                time = element.get("time", "0")
            elif event == "end" and element.tag in ("vehicle", "person"):
                get = element.get
                on_foot = element.tag == "person"
                kind = "pedestrian" if on_foot else self._kind(get("type", ""), get("vClass", ""))
                self._add(get("id", ""), time, get("x", ""), get("y", ""), get("angle", ""), kind, f"time {time}")
                element.clear()

    def read_csv(self) -> None:
        with self.path.open(encoding="utf-8-sig", newline="") as stream:
            sample = stream.readline()
            stream.seek(0)
            reader = csv.DictReader(stream, delimiter=";" if ";" in sample else ",")
            needed = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle")
            require(self.path, reader.fieldnames or [], needed)
            for line, row in enumerate(reader, start=2):
                for who in ("vehicle", "person"):
                    if not row.get(f"{who}_id"):
                        continue
                    kind = "pedestrian"
                    if who == "vehicle":
                        kind = self._kind(row.get("vehicle_type") or "", row.get("vehicle_vClass") or "")
                    x, y, angle = (row.get(f"{who}_{name}") or "" for name in ("x", "y", "angle"))
                    self._add(row[f"{who}_id"], row["timestep_time"], x, y, angle, kind, f"line {line}")

    def _add(self, name: str, time: str, x: str, y: str, angle: str, kind: str, where: str) -> None:
        heading = math.radians(90.0 - number(angle, f"{self.path}: {where}: angle"))
        ahead = 0.5 * BODIES[kind].length_m if kind != "pedestrian" else 0.0
        px, py = number(x, f"{self.path}: {where}: x"), number(y, f"{self.path}: {where}: y")
        row = Row(number(time, f"{self.path}: {where}: time"), px, py, heading, kind, ahead)
        self.rows.setdefault(name, []).append(row)

    def _kind(self, type_name: str, vehicle_class: str) -> str:
        """The body for a type: by its class where one is known, else by its name."""
        found = self.kinds.get((type_name, vehicle_class))
        if found is None:
            found, doubt = kind_of_type(vehicle_class or self.classes.get(type_name, type_name))
            self.kinds[type_name, vehicle_class] = found
            if doubt:
                self.doubts[doubt][type_name or vehicle_class] = found
        return found

    def notes(self) -> tuple[str, ...]:
        """One sentence for each kind of doubt."""
        notes = []
        if self.doubts["stands in"]:
            said = ", ".join(f"a {kind} for {name!r}" for name, kind in self.doubts["stands in"].items())
            notes.append(f"{self.path}: types without a body of their own, for which another stands in: {said}.")
        if self.doubts["unknown"]:
            said = ", ".join(repr(name) for name in self.doubts["unknown"])
            notes.append(
                f"{self.path}: types of unknown class, shown as a {OTHERWISE}: {said}; set tracks.types to SUMO's file "
                "with their vClass."
            )
        return tuple(notes)
