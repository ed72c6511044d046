"""Lets the hard cases use the helpers of the rasteriser's tests."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "raster"))
