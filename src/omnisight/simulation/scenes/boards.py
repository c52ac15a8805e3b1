"""A hall with calibration boards of every kind all around, for cameras of any field of view."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.board import board_solid
from omnisight.simulation.procedural_textures import materials
from omnisight.simulation.scene import Scene
from omnisight.simulation.solids import Solid, box
from omnisight.simulation.texture import Texture
from omnisight.targets import Board, Checkerboard, board_class

HALF, FLOOR, CEILING = 3.0, 1.4, -1.8
AROUND, DISTANCE = 8, 1.7


def scene(seed: int = 0) -> Scene:
    """Build the hall: two rings of boards around the origin, one board below and one above."""
    rng = np.random.default_rng(seed + 3)
    boards: list[tuple[str, Board]] = [("checkerboard", Checkerboard(9, 6, 0.06))]
    april, charuco, circles = (board_class(kind) for kind in ("aprilgrid", "charuco", "circles"))
    boards.append(("aprilgrid", april.from_dict({"columns": 6, "rows": 6, "tag": "70mm", "spacing": 0.3})))
    boards.append(("charuco", charuco.from_dict({"columns": 8, "rows": 6, "square": "70mm", "marker": "52mm"})))
    boards.append(("circles", circles.from_dict({"columns": 4, "rows": 11, "spacing": "45mm", "diameter": "40mm"})))
    solids = [_hall(rng)]
    for i in range(2 * AROUND):
        kind, board = boards[i % len(boards) if i < AROUND else 0]
        yaw = 2 * np.pi * (i + 0.5 * (i >= AROUND)) / AROUND
        pitch = 0.0 if i < AROUND else 0.62 * (-1) ** i
        solids.append(_facing(board, yaw, pitch, rng, f"{kind} {i + 1}"))
    solids.append(_facing(boards[0][1], 0.3, np.pi / 2, rng, "checkerboard above", 1.3))
    solids.append(_facing(boards[0][1], 0.3, -np.pi / 2, rng, "checkerboard below", 1.1))
    return Scene(tuple(solids), ((-0.5, -0.4, -0.5), (0.5, 0.4, 0.5)), ambient=1.0, reach=0.15, spacing=0.12)


def _facing(
    board: Board, yaw: float, pitch: float, rng: np.random.Generator, name: str, distance: float = DISTANCE
) -> Solid:
    """Return a board in a direction (radians), rotated randomly from facing the origin."""
    towards = exp(np.array((0, yaw, 0))) @ exp(np.array((pitch, 0, 0)))
    turn = towards @ exp(rng.uniform(-0.3, 0.3, 3))
    left, top, right, bottom = board.extent
    middle = np.array(((left + right) / 2, (top + bottom) / 2, 0))
    return board_solid(board, Pose(turn, towards[:, 2] * distance - turn @ middle), name)


def _hall(rng: np.random.Generator) -> Solid:
    gray = Texture(materials.plaster(rng, 2 * HALF, FLOOR - CEILING, (128, 132, 138)))
    slabs = Texture(materials.paving(rng, 2 * HALF, 2 * HALF, 0.5, 120, (122, 118, 112)))
    faces = {"bottom": slabs, "other": gray}
    return box((-HALF, CEILING, -HALF), (HALF, FLOOR, HALF), faces, "hall", inside=True)
