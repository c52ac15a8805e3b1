"""Structure from motion of rendered images against their poses, beside pycolmap on 360 images.

`python -m benchmarks sfm` prints the table of docs/guide/reconstruct.md. The rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist. pycolmap runs in a process of its own, with its own
SIFT, all pairs, the camera model EQUIRECTANGULAR and fixed intrinsics; it has no model of the other two cameras.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.features_pairs import cameras
from omnisight.cache import cache_folder
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.simulation.trajectory import read_trajectory

Array = NDArray[np.float64]

# Scenes with the number of images along the preset loop.
SETS = (("room", 30), ("street", 30))
COLMAP = """
import sys, pycolmap
images, work, mapper = sys.argv[1:]
database = work + "/database.db"
reader = pycolmap.ImageReaderOptions()
reader.camera_model = "EQUIRECTANGULAR"
pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
pycolmap.match_exhaustive(database)
if mapper == "global":
    models = pycolmap.global_mapping(database, images, work)
else:
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    models = pycolmap.incremental_mapping(database, images, work, options)
best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
print("points", best.num_points3D() if best else 0, best.compute_mean_reprojection_error() if best else 0)
for image in best.images.values() if best else ():
    if image.has_pose:
        print("pose", image.name, *image.cam_from_world().matrix().ravel())
"""


@dataclass(frozen=True)
class Score:
    """Errors of a reconstruction.

    Attributes
    ----------
    registered
        Number of images in the largest model.
    position
        Median error of the positions after a similarity, relative to the length of the path.
    rotation_deg
        Median error of the rotations.
    points
        Number of points.
    seconds
        Time.
    """

    registered: int
    position: float
    rotation_deg: float
    points: int
    seconds: float

    def row(self, name: str, method: str, images: int) -> str:
        """Return a row of the table."""
        errors = f"{100 * self.position:.4f} % | {self.rotation_deg:.4f}°"
        return (
            f"| {name} | {method} | {self.registered} of {images} | {errors} | {self.points} | {self.seconds:.0f} s |"
        )


def render(scene: str, camera: str, count: int) -> Path:
    """Return the folder of a rendered set, from the cache if it is there."""
    root = cache_folder() if cache_folder().is_dir() else Path(tempfile.gettempdir())
    folder = root / "benchmarks-sfm" / f"{scene}-{camera}-{count}"
    if not (folder / "poses.txt").exists():
        shot = cameras()[camera]
        up = "back" if camera == "mirror" else "top"
        folder.parent.mkdir(exist_ok=True)
        om.simulate(om.SimulateOptions(scene, shot.camera, folder, up=up, frames=count, jpeg=95))
    return folder


def score(folder: Path, poses: dict[str, Array], points: int, seconds: float) -> Score:
    """Compare poses cam_from_world (3, 4) by file name with the truth."""
    truth = read_trajectory(folder / "poses.txt").poses
    path = np.array([pose.translation for pose in truth])
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    if len(poses) < 3:
        return Score(len(poses), float("nan"), float("nan"), points, seconds)
    found = [Pose.of_matrix(matrix).inverse() for matrix in poses.values()]
    true = [truth[int(Path(name).stem)] for name in poses]
    a, b = (np.array([pose.translation for pose in each]) for each in (found, true))
    rotation, scale = similarity(a, b)
    aligned = scale * (a - a.mean(0)) @ rotation.T + b.mean(0)
    turns = [so3.log(rotation @ f.rotation @ t.rotation.T) for f, t in zip(found, true, strict=True)]
    position = float(np.median(np.linalg.norm(aligned - b, axis=1))) / length
    return Score(len(poses), position, float(np.degrees(np.median(np.linalg.norm(turns, axis=1)))), points, seconds)


def similarity(a: Array, b: Array) -> tuple[Array, float]:
    """Return the rotation (3, 3) and the scale from points a (N, 3) to b (Umeyama 1991)."""
    centred = a - a.mean(0)
    u, s, vt = np.linalg.svd((b - b.mean(0)).T @ centred)
    sign = np.array([1.0, 1.0, np.linalg.det(u @ vt)])
    return (u * sign) @ vt, float((s * sign).sum() / (centred**2).sum())


def ours(folder: Path, camera: om.Camera) -> Score:
    """Reconstruct with omnisight."""
    start = time.perf_counter()
    result = om.reconstruct(folder / "images", camera)
    seconds = time.perf_counter() - start
    if not result:
        return score(folder, {}, 0, seconds)
    model = result.models[0]
    poses = {name: model.cam_from_world(i).matrix for i, name in enumerate(model.names)}
    return score(folder, poses, len(model.points), seconds)


def colmap(folder: Path, mapper: str) -> Score:
    """Reconstruct 360 images with pycolmap."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as work:
        command = [sys.executable, "-c", COLMAP, str(folder / "images"), work, mapper]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - start
    rows = [line.split() for line in done.stdout.splitlines()]
    poses = {row[1]: np.array(row[2:], float).reshape(3, 4) for row in rows if row and row[0] == "pose"}
    points = sum(int(row[1]) for row in rows if row and row[0] == "points")
    return score(folder, poses, points, seconds)


def main(arguments: Sequence[str]) -> None:
    """Print one row for each set and method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sfm", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="12 images of the room only")
    sets = (("room", 12),) if parser.parse_args(arguments).quick else SETS
    print("| images | method | registered | position | rotation | points | time |\n|---|---|---|---|---|---|---|")
    for scene, count in sets:
        for name in ("sphere", "fisheye", "mirror"):
            folder = render(scene, name, count)
            print(ours(folder, cameras()[name].camera).row(f"{scene}, {name}", "omnisight", count), flush=True)
            if name == "sphere":
                for mapper in ("incremental", "global"):
                    row = colmap(folder, mapper).row(f"{scene}, {name}", f"pycolmap {mapper}", count)
                    print(row, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
