"""Where on Earth a model's world is: the origin that `aa4d capture` found in the footage's positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.methods.model_file import LoadedModel

KEYS = ("latitude_deg", "longitude_deg", "altitude_m")


def geographic_origin(loaded: LoadedModel) -> dict[str, float] | None:
    """Latitude and longitude in degrees and altitude in metres of the world's origin (x east, y north, z up).

    None where the capture is gone, or nothing said where it was filmed.
    """
    if loaded.capture_folder is None:
        return None
    try:
        capture: Any = read_json_object(loaded.capture_folder / "capture.json", "a capture")
        origin = capture["generator"]["world"]["origin"]
        found = {key: float(origin[key]) for key in KEYS}
    except (InputError, KeyError, TypeError, ValueError):
        return None
    return found if np.isfinite(list(found.values())).all() else None
