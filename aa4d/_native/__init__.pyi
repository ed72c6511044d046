# The C++ extension. Its halves are attributes, not files: `from aa4d import _native`, then `_native.raster.forward`.
from aa4d._native import field as field
from aa4d._native import raster as raster

def worker_count() -> int: ...
