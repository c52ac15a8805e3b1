"""Many 360 images of the town, along drives on both lanes of its loop at visits with other parked cars."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.places_scenes import OTHER_LANE
from benchmarks.places_visits import route
from benchmarks.rendered_images import image_cache
from omnisight.geometry.pose import Pose
from omnisight.pipeline.simulation.rendering_options import Conditions
from omnisight.simulation.trajectory import Trajectory, read_trajectory, write_trajectory

# Images of a visit, about 0.5 m apart.
IMAGES_PER_VISIT = 1000
# First image of each visit: before a corner, because positions along a straight street have no orientation about it.
FIRST = 100
# Shift of the images of a visit against those of the visit before, as a share of their distance: no two visits have
# images at the same places.
PHASE = (np.sqrt(5) - 1) / 2


def render(count: int, width: int) -> list[Path]:
    """Return the first of the images of a width, px, from the cache if they are there."""
    visits = [sorted((_visit(k, width) / "images").glob("*.jpg")) for k in range(-(-count // IMAGES_PER_VISIT))]
    return [path for files in visits for path in files[FIRST:] + files[:FIRST]][:count]


def true_poses(paths: Sequence[Path]) -> list[Pose]:
    """Return the poses of images."""
    drives = {folder: read_trajectory(folder / "poses.txt").poses for folder in {path.parents[1] for path in paths}}
    return [drives[path.parents[1]][int(path.stem)] for path in paths]


def _visit(number: int, width: int) -> Path:
    """Return the folder of a visit: odd ones drive on the other lane, in the other direction."""
    root = image_cache(f"scale-{width}")
    folder = root / f"visit-{number:02d}"
    if not (folder / "poses.txt").exists():
        root.mkdir(exist_ok=True)
        poses = route(IMAGES_PER_VISIT, number * PHASE % 1)
        if number % 2:
            poses = [pose @ OTHER_LANE for pose in reversed(poses)]
        drive = root / f"visit-{number:02d}.txt"
        write_trajectory(drive, Trajectory(np.arange(float(len(poses))), tuple(poses)))
        conditions = Conditions(visit=number)
        om.simulate(
            om.SimulateOptions(
                "town",
                om.sphere(width),
                folder,
                trajectory=str(drive),
                conditions=conditions,
                jpeg=95,
                seed=0,
                vignette=0.0,
            )
        )
    return folder
