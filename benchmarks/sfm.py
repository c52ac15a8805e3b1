"""Structure from motion of rendered images against their poses, beside pycolmap.

`python -m benchmarks sfm` prints the table of docs/guide/reconstruct.md: registered frames, median errors of positions
relative to the path and of rotations, points, residuals, time and peak memory, and the ratio to the best values of the
peers that register most frames. Each method runs in a process of its own, on the same images and the same selection of
pairs: all of up to 60 images, else each with the following ten. The peers are pycolmap on 360 images with its camera
EQUIRECTANGULAR, and on the cube faces that a camera covers, as a rig of pinhole cameras with known poses and masks;
both with their own SIFT and fixed intrinsics. Rendered images are kept in the cache folder, or in the folder of
temporary files if it does not exist.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.features_pairs import cameras
from benchmarks.own_process import run_module
from benchmarks.sfm_methods import METHODS, frame_count
from omnisight.cache import cache_folder
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.trajectory import read_trajectory

Array = NDArray[np.float64]

# Scenes with the number of frames along the preset loop; those of the last two are far apart.
SETS = (("room", 30), ("street", 30), ("rooms", 16), ("street", 10))
CAMERAS = ("sphere", "fisheye", "mirror", "rig")
# Width of each fisheye image of the rig, px.
RIG_WIDTH = 960
HEADER = "| images | method | registered | position | rotation | points | rms | time | memory |\n" + "|---" * 9 + "|"


@dataclass(frozen=True)
class Score:
    """Errors of a reconstruction.

    Attributes
    ----------
    registered
        Number of frames in the largest model.
    position
        Median error of the positions after a similarity, relative to the length of the path.
    rotation_deg
        Median error of the rotations.
    points
        Number of points.
    rms_px
        Root mean square of the residuals in the images of the method.
    seconds, megabytes
        Time and peak memory.
    """

    registered: int
    position: float
    rotation_deg: float
    points: int
    rms_px: float
    seconds: float
    megabytes: float

    def row(self, name: str, method: str, frames: int) -> str:
        """Return a row of the table."""
        errors = f"{100 * self.position:.4f} % | {self.rotation_deg:.4f}°"
        cost = f"{self.seconds:.0f} s | {self.megabytes:.0f} MB"
        found = f"{self.registered} of {frames} | {errors} | {self.points} | {self.rms_px:.2f} px"
        return f"| {name} | {method} | {found} | {cost} |"

    def ratio(self, peers: Sequence["Score"]) -> str:
        """Return the ratios to the best values of the peers that register most frames."""
        most = max(peer.registered for peer in peers)
        best = [peer for peer in peers if peer.registered == most]

        def over(value: str) -> str:
            least = np.nanmin([getattr(peer, value) for peer in best] or [np.nan])
            return f"{getattr(self, value) / least:.2f}"

        names = ("position", "rotation_deg", "seconds", "megabytes")
        return f"registered {self.registered} against {most}; " + ", ".join(
            f"{name.split('_')[0]} {over(name)}" for name in names
        )


def render(scene: str, camera: str, count: int) -> Path:
    """Return the folder of a rendered set, from the cache if it is there."""
    root = cache_folder() if cache_folder().is_dir() else Path(tempfile.gettempdir())
    folder = root / "benchmarks-sfm" / f"{scene}-{camera}-{count}"
    if not (folder / "poses.txt").exists():
        source = back_to_back(RIG_WIDTH) if camera == "rig" else cameras()[camera].camera
        up = "back" if camera == "mirror" else "top"
        folder.parent.mkdir(exist_ok=True)
        om.simulate(om.SimulateOptions(scene, source, folder, up=up, frames=count, jpeg=95))
    return folder


def run(method: str, folder: Path) -> Score | str:
    """Run a method on a set and compare its model with the truth; return the reason if it fails."""
    try:
        rows = run_module("benchmarks.sfm_methods", [method, str(folder)])
    except RuntimeError as error:
        return str(error).splitlines()[-1]
    poses = {int(row[1]): np.array(row[2:], float).reshape(3, 4) for row in rows if row[0] == "pose"}
    points, *values = next(row[1:] for row in rows if row[0] == "result")
    return Score(len(poses), *errors(folder, poses), int(points), *(float(value) for value in values))


def errors(folder: Path, poses: dict[int, Array]) -> tuple[float, float]:
    """Return the median errors of the poses rig_from_world (3, 4) of frames: position and rotation, degrees."""
    truth = read_trajectory(folder / "poses.txt").poses
    path = np.array([pose.translation for pose in truth])
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    if len(poses) < 3:
        return float("nan"), float("nan")
    found = [Pose.of_matrix(matrix).inverse() for matrix in poses.values()]
    true = [truth[frame] for frame in poses]
    a, b = (np.array([pose.translation for pose in each]) for each in (found, true))
    rotation, scale = similarity(a, b)
    aligned = scale * (a - a.mean(0)) @ rotation.T + b.mean(0)
    turns = [so3.log(rotation @ f.rotation @ t.rotation.T) for f, t in zip(found, true, strict=True)]
    position = float(np.median(np.linalg.norm(aligned - b, axis=1))) / length
    return position, float(np.degrees(np.median(np.linalg.norm(turns, axis=1))))


def similarity(a: Array, b: Array) -> tuple[Array, float]:
    """Return the rotation (3, 3) and the scale from points a (N, 3) to b (Umeyama 1991)."""
    centred = a - a.mean(0)
    u, s, vt = np.linalg.svd((b - b.mean(0)).T @ centred)
    sign = np.array([1.0, 1.0, np.linalg.det(u @ vt)])
    return (u * sign) @ vt, float((s * sign).sum() / (centred**2).sum())


def compare(scene: str, camera: str, count: int, methods: Sequence[str]) -> None:
    """Print the rows of all methods on a set, and the ratio to the best peer."""
    folder, scores = render(scene, camera, count), dict[str, Score]()
    frames = frame_count(folder)
    for method in methods:
        if camera != "sphere" and "360" in method:  # pycolmap has no model of the camera
            continue
        found = run(method, folder)
        if isinstance(found, str):
            print(f"| {scene}, {camera} | {method} | failed: {found} |" + " |" * 6, flush=True)
            continue
        scores[method] = found
        print(found.row(f"{scene}, {camera}", method, frames), flush=True)
    peers = [each for method, each in scores.items() if method.startswith("pycolmap")]
    if peers and "omnisight" in scores:
        print(f"| {scene}, {camera} | ratio to the best peer | {scores['omnisight'].ratio(peers)} |" + " |" * 6)


def main(arguments: Sequence[str]) -> None:
    """Print one row for each set and method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sfm", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="12 frames of the room with the sphere only")
    parser.add_argument("--sets", nargs="+", metavar="SCENE", help="room, street, town, rooms ...")
    parser.add_argument("--count", type=int, help="number of frames of each set")
    parser.add_argument("--cameras", nargs="+", choices=CAMERAS, default=CAMERAS)
    parser.add_argument("--methods", nargs="+", choices=tuple(METHODS), default=tuple(METHODS))
    options = parser.parse_args(arguments)
    sets = [(scene, 30) for scene in options.sets] if options.sets else list(SETS)
    if options.quick:
        sets, options.cameras = [("room", 12)], ["sphere"]
    print(HEADER)
    for scene, count in sets:
        for camera in options.cameras:
            compare(scene, camera, options.count or count, options.methods)


if __name__ == "__main__":
    main(sys.argv[1:])
