"""Satellite positions: EXIF of photographs, the subtitles (SRT) of DJI drones, and a local frame in metres."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aa4d.capture.clip import Position

GPS_IFD = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = 1, 2, 3, 4, 5, 6
# WGS 84.
SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563

# A number of any other kind, such as 1e9 or one of hundreds of digits, is none: no part of it is taken for one.
NUMBER = r"(-?\d{1,9}(?:\.\d{1,30})?)(?!\d|\.\d|[eE][-+]?\d)"
TIME = re.compile(r"(?<![\w.-])(\d{1,6}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
LATITUDE_FIELD = re.compile(rf"latitude\s*:\s*{NUMBER}", re.IGNORECASE)
# DJI's own misspelling stands in files of several years.
LONGITUDE_FIELD = re.compile(rf"longt?itude\s*:\s*{NUMBER}", re.IGNORECASE)
ALTITUDE_FIELDS = tuple(
    re.compile(rf"{name}\s*:?\s*{NUMBER}", re.IGNORECASE) for name in ("rel_alt", "barometer", r"\bH", "altitude")
)
# Older drones: GPS (longitude, latitude, number of satellites or altitude).
GPS_FIELD = re.compile(rf"GPS\s*\(\s*{NUMBER}\s*,\s*{NUMBER}\s*,\s*{NUMBER}")


@dataclass(frozen=True)
class Track:
    """Positions over time."""

    time_s: NDArray[np.float64]  # [N] rising
    values: NDArray[np.float64]  # [N, 3] latitude, longitude, altitude

    def at(self, time_s: float) -> Position | None:
        """Linear between entries; None a second or more outside of them."""
        if not self.time_s[0] - 1 < time_s < self.time_s[-1] + 1:
            return None
        latitude, longitude, altitude = (float(np.interp(time_s, self.time_s, column)) for column in self.values.T)
        return Position(latitude, longitude, altitude)


def read_subtitles(path: Path) -> Track | None:
    """The positions in a DJI drone's subtitles; None where there are none (no fix reads as 0, 0)."""
    times: list[float] = []
    values: list[tuple[float, float, float]] = []
    text = path.read_text(encoding="utf-8", errors="replace")
    starts = list(TIME.finditer(text))
    for i, start in enumerate(starts):
        block = text[start.end() : starts[i + 1].start() if i + 1 < len(starts) else len(text)]
        position = _position_in(block)
        if position is None:
            continue
        hours, minutes, seconds, fraction = start.groups()
        time_s = int(hours) * 3600 + int(minutes) * 60 + int(seconds) + float(f"0.{fraction}")
        if not times or time_s > times[-1]:
            times.append(time_s)
            values.append(position)
    return Track(np.array(times), np.array(values)) if times else None


def _position_in(block: str) -> tuple[float, float, float] | None:
    latitude, longitude = LATITUDE_FIELD.search(block), LONGITUDE_FIELD.search(block)
    altitude = next((m for m in (field.search(block) for field in ALTITUDE_FIELDS) if m), None)
    if latitude and longitude:
        at = float(latitude[1]), float(longitude[1])
        height = 0.0 if altitude is None else float(altitude[1])
    else:
        gps = GPS_FIELD.search(block)
        if gps is None:
            return None
        at = float(gps[2]), float(gps[1])
        height = float(gps[3]) if altitude is None else float(altitude[1])
    return (*at, height) if _possible(*at) else None


def position_of_photograph(path: Path) -> Position | None:
    """From EXIF; None where it has no position."""
    try:
        with Image.open(path) as image:
            gps = image.getexif().get_ifd(GPS_IFD)
        latitude = _degrees(gps[LATITUDE], gps.get(LATITUDE_REF, "N") == "S")
        longitude = _degrees(gps[LONGITUDE], gps.get(LONGITUDE_REF, "E") == "W")
        below = gps.get(ALTITUDE_REF, b"\0") in (1, b"\x01")
        altitude = float(gps.get(ALTITUDE, 0.0)) * (-1 if below else 1)
    except (OSError, KeyError, TypeError, ValueError, ZeroDivisionError, SyntaxError):
        return None
    if not (_possible(latitude, longitude) and np.isfinite(altitude)):
        return None
    return Position(latitude, longitude, altitude)


def _degrees(value: Any, negative: bool) -> float:
    degrees, minutes, seconds = (float(part) for part in value)
    return (-1 if negative else 1) * (degrees + minutes / 60 + seconds / 3600)


def _possible(latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90 and abs(longitude) <= 180 and (latitude, longitude) != (0.0, 0.0)


def east_north_up(positions: list[Position], origin: Position) -> NDArray[np.float64]:
    """Metres [N, 3] in the plane that touches the ellipsoid at `origin`."""
    from_origin = _geocentric(positions) - _geocentric([origin])
    latitude, longitude = np.radians([origin.latitude_deg, origin.longitude_deg])
    east = [-np.sin(longitude), np.cos(longitude), 0.0]
    up = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    north = np.cross(up, east)
    enu: NDArray[np.float64] = from_origin @ np.array([east, north, up]).T
    return enu


def _geocentric(positions: list[Position]) -> NDArray[np.float64]:
    """Earth-centred, earth-fixed metres [N, 3]."""
    table = np.array([[p.latitude_deg, p.longitude_deg, p.altitude_m] for p in positions])
    latitude, longitude = np.radians(table[:, 0]), np.radians(table[:, 1])
    squared = FLATTENING * (2 - FLATTENING)
    curvature = SEMI_MAJOR_M / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    across = (curvature + table[:, 2]) * np.cos(latitude)
    return np.stack(
        [
            across * np.cos(longitude),
            across * np.sin(longitude),
            (curvature * (1 - squared) + table[:, 2]) * np.sin(latitude),
        ],
        axis=1,
    )
