"""Buildings with recessed windows, shop fronts, cornices and roofs, on the lots of a block."""

import numpy as np

from synth.city.mesh import Mesh, Tint, turn

FLOOR_M = 3.1
GROUND_FLOOR_M = 3.7
RECESS_M = 0.16
PARAPET_M = 0.7

WALLS: tuple[Tint, ...] = (
    (0.52, 0.42, 0.30),  # sandstone
    (0.33, 0.13, 0.085),  # brick
    (0.60, 0.58, 0.54),  # plaster
    (0.47, 0.33, 0.17),  # ochre
    (0.30, 0.34, 0.38),  # slate blue
    (0.48, 0.27, 0.20),  # terracotta
    (0.26, 0.25, 0.24),  # grey
)
AWNINGS: tuple[Tint, ...] = ((0.45, 0.05, 0.04), (0.05, 0.2, 0.12), (0.06, 0.12, 0.35), (0.6, 0.5, 0.3))


def building(
    mesh: Mesh, low: tuple[float, float], high: tuple[float, float], ground: float, floors: int,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Add one building on an axis-aligned footprint."""
    wall = WALLS[rng.integers(len(WALLS))]
    shade = float(rng.uniform(0.85, 1.1))
    wall = (wall[0] * shade, wall[1] * shade, wall[2] * shade)
    pitched = floors <= 3 and rng.random() < 0.45
    spacing, window = float(rng.uniform(2.3, 3.2)), (float(rng.uniform(1.1, 1.5)), float(rng.uniform(1.4, 1.8)))
    shops = rng.random() < 0.6
    height = GROUND_FLOOR_M + (floors - 1) * FLOOR_M
    centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    size = (high[0] - low[0], high[1] - low[1])
    awning = AWNINGS[rng.integers(len(AWNINGS))]
    for side in range(4):
        along, across = (size[0], size[1]) if side % 2 == 0 else (size[1], size[0])
        front = Mesh()
        _facade(front, along, floors, spacing, window, wall, shops, awning)
        # The facade lies in y = 0 and looks along -y.
        rotation = turn(side * np.pi / 2)
        offset = rotation @ np.array([-along / 2, -across / 2, 0]) + [centre[0], centre[1], ground]
        mesh.add(front, rotation, offset)
    top = ground + height
    if pitched:
        _gable(mesh, low, high, top, wall)
    else:
        _flat_roof(mesh, low, high, top, wall, rng)


def _facade(
    mesh: Mesh, width: float, floors: int, spacing: float, window: tuple[float, float], wall: Tint, shops: bool,
    awning: Tint,
) -> None:  # fmt: skip
    """A wall of `width` in the plane y = 0, x from 0 to width, z from 0 up, seen from -y."""
    count = max(1, int(width / spacing))
    cell = width / count
    z = 0.0
    for floor in range(floors):
        tall = GROUND_FLOOR_M if floor == 0 else FLOOR_M
        shop = shops and floor == 0
        w, h = (cell - 0.5, 2.5) if shop else (min(window[0], cell - 0.5), window[1])
        sill = 0.35 if shop else 0.9
        for i in range(count):
            _opening(mesh, i * cell, z, cell, tall, w, h, sill, wall, "shop" if shop else "window")
        if shop:
            mesh.polygon([(0.3, -0.02, z + 2.95), (width - 0.3, -0.02, z + 2.95), (width - 0.3, -1.0, z + 2.6),
                          (0.3, -1.0, z + 2.6)], "awning", awning)  # fmt: skip
        z += tall
        band = 0.22 if floor in (0, floors - 1) else 0.1
        mesh.box((-0.08, -0.1, z - band), (width + 0.08, 0.0, z), "trim")


def _opening(
    mesh: Mesh, x: float, z: float, cell: float, tall: float, w: float, h: float, sill: float, wall: Tint, pane: str
) -> None:
    """One cell of the facade: wall around a recessed pane."""
    x0, x1, z0, z1 = x + (cell - w) / 2, x + (cell + w) / 2, z + sill, z + sill + h
    right, top, d = x + cell, z + tall, RECESS_M

    def quad(a: tuple[float, float], b: tuple[float, float]) -> None:
        mesh.polygon([(a[0], 0, a[1]), (b[0], 0, a[1]), (b[0], 0, b[1]), (a[0], 0, b[1])], "wall", wall)

    quad((x, z), (right, z0))
    quad((x, z1), (right, top))
    quad((x, z0), (x0, z1))
    quad((x1, z0), (right, z1))
    mesh.polygon([(x0, d, z0), (x1, d, z0), (x1, d, z1), (x0, d, z1)], pane)
    mesh.polygon([(x0, 0, z0), (x0, d, z0), (x0, d, z1), (x0, 0, z1)], "trim")
    mesh.polygon([(x1, d, z0), (x1, 0, z0), (x1, 0, z1), (x1, d, z1)], "trim")
    mesh.polygon([(x0, d, z1), (x1, d, z1), (x1, 0, z1), (x0, 0, z1)], "trim")
    mesh.polygon([(x0 - 0.1, -0.07, z0), (x1 + 0.1, -0.07, z0), (x1, d, z0), (x0, d, z0)], "trim")


def _flat_roof(
    mesh: Mesh, low: tuple[float, float], high: tuple[float, float], z: float, wall: Tint, rng: np.random.Generator
) -> None:
    t = 0.3
    (x0, y0), (x1, y1) = low, high
    shade = float(rng.uniform(0.7, 1.9))
    mesh.polygon([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], "flat-roof", (shade, shade, shade))
    for a, b in (((x0, y0), (x1, y0 + t)), ((x0, y1 - t), (x1, y1)), ((x0, y0 + t), (x0 + t, y1 - t)),
                 ((x1 - t, y0 + t), (x1, y1 - t))):  # fmt: skip
        mesh.box((*a, z), (*b, z + PARAPET_M), "wall", wall, top="trim")
    for _ in range(int(rng.integers(2, 6))):
        w, d, h = rng.uniform(0.8, 2.6), rng.uniform(0.8, 2.2), rng.uniform(0.5, 1.5)
        x, y = rng.uniform(x0 + 0.8, x1 - 0.8 - w), rng.uniform(y0 + 0.8, y1 - 0.8 - d)
        mesh.box((x, y, z), (x + w, y + d, z + h), "metal" if rng.random() < 0.6 else "trim")


def _gable(mesh: Mesh, low: tuple[float, float], high: tuple[float, float], z: float, wall: Tint) -> None:
    """A pitched roof with its ridge along the longer side and eaves that stand out."""
    eave = 0.4
    (x0, y0), (x1, y1) = low, high
    along_x = x1 - x0 >= y1 - y0
    if not along_x:
        (x0, y0), (x1, y1) = (y0, x0), (y1, x1)
    middle, rise = (y0 + y1) / 2, 0.36 * (y1 - y0)
    drop = rise * eave / ((y1 - y0) / 2)

    def place(*points: tuple[float, float, float]) -> list[tuple[float, float, float]]:
        return [p if along_x else (p[1], p[0], p[2]) for p in points]

    for edge in (y0 - eave, y1 + eave):
        mesh.polygon(place((x0 - eave, edge, z - drop), (x1 + eave, edge, z - drop), (x1 + eave, middle, z + rise),
                           (x0 - eave, middle, z + rise)), "tiles")  # fmt: skip
    for x in (x0, x1):
        mesh.polygon(place((x, y0, z), (x, y1, z), (x, middle, z + rise)), "wall", wall)
    cx = x0 + 0.3 * (x1 - x0)
    chimney = place((cx, middle + 0.5, z), (cx + 0.7, middle + 1.3, z))
    mesh.box(chimney[0], (chimney[1][0], chimney[1][1], z + rise + 0.9), "wall", (0.3, 0.13, 0.09))


def office(
    mesh: Mesh, low: tuple[float, float], high: tuple[float, float], ground: float, floors: int,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """A block of bands: parapets of concrete or metal, ribbons of glass between mullions."""
    frames: tuple[Tint, ...] = ((0.55, 0.55, 0.53), (0.20, 0.21, 0.23), (0.42, 0.36, 0.29), (0.30, 0.36, 0.42))
    frame = frames[rng.integers(len(frames))]
    (x0, y0), (x1, y1) = low, high
    tall, band = 3.5, float(rng.uniform(0.7, 1.3))
    spacing = float(rng.uniform(1.5, 3.0))
    for floor in range(floors):
        z = ground + floor * tall
        mesh.box((x0, y0, z), (x1, y1, z + band), "wall", frame)
        mesh.box((x0 + 0.22, y0 + 0.22, z + band), (x1 - 0.22, y1 - 0.22, z + tall), "window")
        for along, (a, b) in enumerate(((x0, x1), (y0, y1))):
            for at in np.arange(a + spacing, b - 0.5 * spacing, spacing):
                for edge in (y0 + 0.1, y1 - 0.1) if along == 0 else (x0 + 0.1, x1 - 0.1):
                    p, q = (at, edge) if along == 0 else (edge, at)
                    mesh.box((p - 0.07, q - 0.12, z + band), (p + 0.07, q + 0.12, z + tall), "trim")
    top = ground + floors * tall
    mesh.box((x0, y0, top), (x1, y1, top + 0.25), "wall", frame)
    _flat_roof(mesh, low, high, top + 0.27, frame, rng)  # not in the plane of the slab


def house(
    mesh: Mesh, low: tuple[float, float], high: tuple[float, float], ground: float, rng: np.random.Generator
) -> None:
    """A detached house of one or two floors with a pitched roof."""
    wall = WALLS[rng.integers(len(WALLS))]
    floors = int(rng.integers(1, 3))
    centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    size = (high[0] - low[0], high[1] - low[1])
    for side in range(4):
        along, across = (size[0], size[1]) if side % 2 == 0 else (size[1], size[0])
        front = Mesh()
        _facade(front, along, floors, 3.0, (1.3, 1.3), wall, False, AWNINGS[0])
        rotation = turn(side * np.pi / 2)
        offset = rotation @ np.array([-along / 2, -across / 2, 0]) + [centre[0], centre[1], ground]
        mesh.add(front, rotation, offset)
    _gable(mesh, low, high, ground + GROUND_FLOOR_M + (floors - 1) * FLOOR_M, wall)


def hall(
    mesh: Mesh, low: tuple[float, float], high: tuple[float, float], ground: float, rng: np.random.Generator
) -> None:
    """A hall of sheet metal with gates and rows of skylights."""
    shades: tuple[Tint, ...] = ((0.45, 0.47, 0.48), (0.28, 0.33, 0.40), (0.52, 0.50, 0.44), (0.36, 0.20, 0.15))
    wall = shades[rng.integers(len(shades))]
    (x0, y0), (x1, y1) = low, high
    top = ground + float(rng.uniform(6.5, 9.5))
    mesh.box((x0, y0, ground), (x1, y1, top), "cladding", wall)
    _flat_roof(mesh, low, high, top + 0.02, wall, rng)  # not in the plane of the walls' top
    for x in np.arange(x0 + 4.0, x1 - 5.0, 6.0):
        mesh.box((float(x), y0 + 4.0, top), (float(x) + 1.6, y1 - 4.0, top + 0.45), "window")
        mesh.polygon([(x, y0 - 0.03, ground), (x + 3.6, y0 - 0.03, ground), (x + 3.6, y0 - 0.03, ground + 4.2),
                      (x, y0 - 0.03, ground + 4.2)], "trim")  # fmt: skip
