"""Many 360 images of a large town, along drives through its streets at visits with other parked cars."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.places_scenes import OTHER_LANE, regular
from benchmarks.rendered_images import image_cache
from omnisight.geometry.pose import Pose
from omnisight.simulation import Renderer, Scene
from omnisight.simulation.preset_motion import preset_trajectory
from omnisight.simulation.scenes import town
from omnisight.simulation.trajectory import Trajectory, read_trajectory, write_trajectory

# Images of the drive, 0.57 m apart.
IMAGES_OF_DRIVE = 10_000
# First image: before a corner, because positions along a straight street have no orientation about it.
FIRST = 700
# Crossings along each side of the town.
CROSSINGS = 7
# Shift of the images of a visit against those of the visit before, as a share of their distance: no two visits have
# images at the same places.
PHASE = (np.sqrt(5) - 1) / 2


def render(count: int, width: int, per_visit: int = IMAGES_OF_DRIVE) -> list[Path]:
    """Return the first of the images of a width, px, in visits of the same streets; render those not in the cache."""
    visits = [range(first, min(first + per_visit, count)) for first in range(0, count, per_visit)]
    return [path for k, images in enumerate(visits) for path in _visit(k, len(images), width)]


def true_poses(paths: Sequence[Path]) -> list[Pose]:
    """Return the poses of images."""
    drives = {folder: read_trajectory(folder / "poses.txt").poses for folder in {path.parents[1] for path in paths}}
    return [drives[path.parents[1]][int(path.stem)] for path in paths]


def _visit(number: int, count: int, width: int) -> list[Path]:
    """Return the first images of a visit, rendered if they are not in the cache."""
    folder = image_cache(f"scale-town-{width}") / f"visit-{number:02d}"
    paths = [folder / "images" / f"{k:05d}.jpg" for k in range(count)]
    missing = [k for k, path in enumerate(paths) if not path.exists()]
    if missing:
        poses = _poses(number)
        (folder / "images").mkdir(parents=True, exist_ok=True)
        write_trajectory(folder / "poses.txt", Trajectory(np.arange(float(len(poses))), tuple(poses)))
        for k in missing:
            renderer = Renderer(om.sphere(width), poses[k], _scene(number))
            om.write_image(paths[k], renderer(rng=np.random.default_rng((number, k))).image)
    return paths


def _poses(number: int) -> list[Pose]:
    """Return the poses of a visit: those of odd ones are on the other lane, in the other direction."""
    route = preset_trajectory("loop", _town().free, 0.0, _town().route).poses
    poses = regular(route, IMAGES_OF_DRIVE, number * PHASE % 1)
    return [pose @ OTHER_LANE if number % 2 else pose for pose in poses[FIRST:] + poses[:FIRST]]


@cache
def _town() -> Scene:
    """Return a town of 84 streets, 5 km."""
    across = np.arange(CROSSINGS)
    heights = 1.5 * np.cos(0.8 * across[:, None]) + np.sin(0.9 * across) + 2.0
    columns, rows = town.COLUMN_SPACING * across, town.ROW_SPACING * across
    return town.scene(0, town.TownPlan(columns.tolist(), rows.tolist(), heights.tolist(), _drive(CROSSINGS)))


@cache
def _scene(visit: int) -> Scene:
    """Return the town at a visit."""
    return _town().with_visit(visit)


def _drive(count: int) -> list[tuple[int, int]]:
    """Return the crossings of a closed drive through a grid of odd size: along all rows, then along all columns."""
    there, back = range(count), range(count)[::-1]
    rows = [(i, j) for j in there for i in (back if j % 2 else there)]
    columns = [(i, j) for i in back for j in (there if i % 2 else back)]
    # The columns begin where the rows end, and the drive ends where it begins.
    return rows + columns[1:-1]
