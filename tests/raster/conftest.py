"""Makes `raster_scenes` importable from every test of the rasteriser."""
