"""SUMO's floating car data: rows of who is where, and which body a vehicle type stands for."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

from synth.traffic.fleet import BODIES
from synth.traffic.rows import Row, number, require


def read_fcd(path: Path) -> dict[str, list[Row]]:
    """Rows by id. SUMO gives the middle of the front bumper, and angles clockwise from north.

    Raises:
        InputError: a column is missing, or a number is none.
        OSError, UnicodeDecodeError, ElementTree.ParseError: the file cannot be read.
    """
    rows: dict[str, list[Row]] = {}

    def add(name: str, time: str, x: str, y: str, angle: str, kind: str, where: str) -> None:
        heading = math.radians(90.0 - number(angle, f"{path}: {where}: angle"))
        ahead = 0.5 * BODIES[kind].length_m if kind != "pedestrian" else 0.0
        px, py = number(x, f"{path}: {where}: x"), number(y, f"{path}: {where}: y")
        row = Row(number(time, f"{path}: {where}: time"), px, py, heading, kind, ahead)
        rows.setdefault(name, []).append(row)

    (_from_xml if path.suffix.lower() == ".xml" else _from_csv)(path, add)
    return rows


def _from_xml(path: Path, add: Callable[..., None]) -> None:
    time = "0"
    for event, element in ElementTree.iterparse(path, events=("start", "end")):
        if event == "start" and element.tag == "timestep":
            time = element.get("time", "0")
        elif event == "end" and element.tag in ("vehicle", "person"):
            get = element.get
            kind = _sumo_kind(get("type", "")) if element.tag == "vehicle" else "pedestrian"
            add(get("id", ""), time, get("x", ""), get("y", ""), get("angle", ""), kind, f"time {time}")
            element.clear()


def _from_csv(path: Path, add: Callable[..., None]) -> None:
    with path.open(encoding="utf-8-sig", newline="") as stream:
        sample = stream.readline()
        stream.seek(0)
        reader = csv.DictReader(stream, delimiter=";" if ";" in sample else ",")
        needed = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle")
        require(path, reader.fieldnames or [], needed)
        for line, row in enumerate(reader, start=2):
            if row["vehicle_id"]:
                add(row["vehicle_id"], row["timestep_time"], row["vehicle_x"], row["vehicle_y"], row["vehicle_angle"],
                    _sumo_kind(row.get("vehicle_type") or ""), f"line {line}")  # fmt: skip


def _sumo_kind(type_name: str) -> str:
    """The body for a SUMO vehicle type: by its name or class."""
    words = {"bus": "bus", "coach": "bus", "truck": "truck", "trailer": "truck", "delivery": "van", "van": "van",
             "bicycle": "cyclist", "bike": "cyclist", "pedestrian": "pedestrian", "ped": "pedestrian", "suv": "suv",
             "hatchback": "hatchback"}  # fmt: skip
    return next((kind for word, kind in words.items() if word in type_name.lower()), "saloon")
