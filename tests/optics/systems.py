"""Catadioptric test systems with every mirror type, and points in their field of view."""

import numpy as np
import pytest

from omnisight.models.equidistant import Equidistant
from omnisight.models.pinhole import Pinhole
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric, mirror_class, mirror_names
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane

PINHOLE = Pinhole(fx=1300.0, fy=1310.0, cx=639.5, cy=479.5, skew=0.4)
FISHEYE = Equidistant(fx=700.0, fy=700.0, cx=639.5, cy=479.5)
TELECENTRIC = Telecentric(fx=9800.0, fy=9810.0, cx=639.5, cy=479.5)
BALL, HYPERBOLA = Conic.sphere(0.04), Conic.hyperbola(0.028, 0.0385, 0.035)
FLAT = Conic(0.2, 1.2, 0.12, hole=0.02)

# Convex mirrors show a point once, wherever they stand.
SINGLE = {name: mirror_class(name).example() for name in mirror_names()} | {
    "ball": BALL,
    "parabola": Conic.parabola(0.06, 0.04),
    "flat-ellipse": Conic(0.03, 0.6, 0.035),
    "ring": Conic(0.05, 1.1, 0.05, hole=0.01),
    "endless-plane": Plane(),
}
SYSTEMS = {
    f"{name}-{where}": Catadioptric(PINHOLE, (placed,))
    for name, mirror in SINGLE.items()
    for where, placed in (
        ("on-axis", PlacedMirror(mirror, tz=0.12)),
        ("decentred", PlacedMirror(mirror, 0.15, -0.1, 0.005, -0.004, 0.12)),
        ("oblique", PlacedMirror(mirror, 0.5, 0.4, 0.01, -0.004, 0.12)),
    )
} | {
    "telecentric-parabola": Catadioptric(TELECENTRIC, (PlacedMirror(Conic.parabola(0.06, 0.04), tz=0.1),)),
    "telecentric-ball": Catadioptric(TELECENTRIC, (PlacedMirror(BALL, 0.1, -0.2, 0.004, 0.0, 0.1),)),
    "fisheye-hyperbola": Catadioptric(FISHEYE, (PlacedMirror(HYPERBOLA, 0.02, 0.0, 0.0, 0.001, 0.03),)),
    "folded": Catadioptric(
        PINHOLE, (PlacedMirror(Conic.sphere(0.05, 0.02), tz=0.1), PlacedMirror(FLAT, np.pi, tz=0.01))
    ),
    "folded-decentred": Catadioptric(
        PINHOLE,
        (
            PlacedMirror(Conic.sphere(0.05, 0.02), 0.02, 0.01, 0.001, 0.001, 0.1),
            PlacedMirror(FLAT, np.pi + 0.03, 0.02, 0.001, 0.0, 0.01),
        ),
    ),
    "periscope": Catadioptric(
        PINHOLE,
        (PlacedMirror(Plane(0.04), np.pi / 4, tz=0.1), PlacedMirror(HYPERBOLA, -np.pi / 2, 0.0, 0.0, 0.08, 0.1)),
    ),
    "telecentric-folded": Catadioptric(
        TELECENTRIC, (PlacedMirror(Conic.sphere(0.05, 0.02), tz=0.1), PlacedMirror(FLAT, np.pi, tz=0.01))
    ),
}
every_system = pytest.mark.parametrize("system", [pytest.param(s, id=name) for name, s in SYSTEMS.items()])
few_systems = pytest.mark.parametrize(
    "system",
    [
        pytest.param(SYSTEMS[name], id=name)
        for name in (
            "conic-decentred",
            "ball-oblique",
            "asphere-decentred",
            "cone-decentred",
            "plane-oblique",
            "telecentric-ball",
            "fisheye-hyperbola",
            "folded-decentred",
            "periscope",
            "telecentric-folded",
        )
    ],
)


def visible_points(system, near=0.02, far=50.0, count=60, seed=1):
    """Return visible scene points (N, 3) between two distances from the mirror, and their pixels (N, 2)."""
    u, v = np.meshgrid(np.linspace(0, 1279, count), np.linspace(0, 959, count * 3 // 4))
    pixels = np.stack([u, v], -1).reshape(-1, 2)
    rays = system.rays(pixels)
    length = np.exp(np.random.default_rng(seed).uniform(*np.log([near, far]), len(pixels)))
    points = rays.origins + length[:, None] * rays.bearings
    return points[rays.valid], pixels[rays.valid]


def within(system, corners):
    """Return which paths (N, M, 3) stay away from rims, holes and apexes of the mirrors."""
    keep = np.ones(len(corners), bool)
    for i, p in enumerate(system.mirrors):
        local = p.lens_from_mirror.inverse() @ corners[:, i]
        rho = np.hypot(local[:, 0], local[:, 1])
        keep &= (rho < 0.9 * p.mirror.rim) & (rho > 1.1 * p.mirror.hole) & (rho > 0.1 * min(p.mirror.rim, 0.04))
    return keep
