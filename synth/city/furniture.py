"""Street lamps and signal posts; origin at the foot, the arm reaches along +x over the road."""

from synth.city.mesh import Mesh, circle


def lamp_mesh() -> Mesh:
    """A lamp post of eight metres."""
    mesh = Mesh()
    mesh.prism(circle(0.09, 8), 0.0, 7.6, "metal")
    mesh.box((-0.06, -0.06, 7.5), (2.2, 0.06, 7.62), "metal")
    mesh.box((1.5, -0.16, 7.38), (2.4, 0.16, 7.52), "lamp", top="metal")
    return mesh


def signal_mesh() -> Mesh:
    """A post with a head of three lamps."""
    mesh = Mesh()
    mesh.prism(circle(0.07, 8), 0.0, 3.2, "metal")
    mesh.box((-0.18, -0.18, 2.3), (0.18, 0.18, 3.3), "bumper")
    return mesh
