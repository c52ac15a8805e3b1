"""A bright hall with straight black wires and cubes all around, for calibration from lines."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.scene import Scene
from omnisight.simulation.solids import FACES, Solid, box, cylinder
from omnisight.simulation.texture import Texture

HALF, FLOOR, CEILING = 3.0, 1.5, -1.7
WIRES, CUBES = 60, 14
WIRE_RADIUS_M = 0.008
# Minimum distance of wires from the origin, where cameras are.
MIN_WIRE_DISTANCE_M = 0.9


def scene(seed: int = 0) -> Scene:
    """Build the hall; each wire is an instance from wall to wall."""
    rng = np.random.default_rng(seed + 5)
    white, black = Texture.plain((226, 226, 222)), Texture.plain((24, 24, 26))
    low, high = np.array((-HALF, CEILING, -HALF)), np.array((HALF, FLOOR, HALF))
    solids: list[Solid] = [box(low, high, white, "hall", inside=True, glow=1.0)]
    while len(solids) <= WIRES:
        a, b = (_on_wall(rng, low, high) for _ in range(2))
        along = (b - a) / np.linalg.norm(b - a)
        nearest = a - (a @ along) * along
        if np.linalg.norm(b - a) > 2.0 and np.linalg.norm(nearest) > MIN_WIRE_DISTANCE_M:
            solids.append(cylinder(a, b, WIRE_RADIUS_M, black, f"wire {len(solids)}"))
    for i in range(CUBES):
        turn = 2 * np.pi * i / CUBES
        at = np.array((2.2 * np.sin(turn), rng.uniform(-1.2, 1.0), 2.2 * np.cos(turn)))
        side = rng.uniform(0.2, 0.45)
        tones = [Texture.plain((t, t, t)) for t in (60, 90, 120, 150, 80, 110)]
        faces = dict(zip(FACES["box"], tones, strict=True))
        cube = box((-side / 2,) * 3, (side / 2,) * 3, faces, f"cube {i + 1}")
        solids.append(cube.moved(Pose(exp(rng.uniform(-1.5, 1.5, 3)), at)))
    return Scene(tuple(solids), ((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)), ambient=1.0, reach=0.15, spacing=0.12)


def _on_wall(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    point, axis = rng.uniform(low, high), int(rng.integers(3))
    point[axis] = (low, high)[int(rng.integers(2))][axis]
    return point
