"""Structure from motion of rendered images against their poses, beside pycolmap.

`python -m benchmarks sfm` prints the table of docs/guide/reconstruct.md: registered frames, those within 1 % of the
path and 1°, median errors of positions relative to the path and of rotations, points, residuals, time and peak memory,
and the ratio to the best values of the peers with most correct frames. Each method runs in a process of its own, on the
same images and the same selection of pairs: all of up to 60 images, else each with the following ten. The peers are
pycolmap on 360 images with its camera EQUIRECTANGULAR, and on the cube faces that a camera covers, as a rig of pinhole
cameras with known poses and masks; both with their own SIFT and fixed intrinsics. Rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.features_pairs import cameras
from benchmarks.own_process import run_module
from benchmarks.rendered_images import image_cache
from benchmarks.sfm_methods import METHODS, frame_count, printed_poses
from benchmarks.sfm_score import PoseErrors, pose_errors
from omnisight.geometry.pose import Pose
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.trajectory import read_trajectory

Array = NDArray[np.float64]


class ImageSet(NamedTuple):
    """A scene, and the number of frames along its preset loop: of all of it, or of the first part at a frame rate."""

    scene: str
    count: int
    fps: float | None = None


# The frames of the last two are far apart: 1 to 1.7 m on a walk through several doors, and 4 to 11 m.
SETS = (ImageSet("room", 30), ImageSet("street", 30), ImageSet("rooms", 16, 0.8), ImageSet("street", 10))
CAMERAS = ("sphere", "fisheye", "mirror", "rig")
# Width of each fisheye image of the rig, px.
RIG_WIDTH = 960
HEADER = (
    "| images | method | registered | correct | position | rotation | points | rms | time | memory |\n"
    + "|---" * 10
    + "|"
)


@dataclass(frozen=True)
class Score:
    """Errors of a reconstruction.

    Attributes
    ----------
    registered
        Number of frames in the largest model.
    errors
        Of its poses.
    points
        Number of points.
    rms_px
        Root mean square of the residuals in the images of the method.
    seconds, megabytes
        Time and peak memory.
    """

    registered: int
    errors: PoseErrors
    points: int
    rms_px: float
    seconds: float
    megabytes: float

    def row(self, name: str, method: str, frames: int) -> str:
        """Return a row of the table."""
        errors = f"{100 * self.errors.position:.4f} % | {self.errors.rotation_deg:.4f}°"
        cost = f"{self.seconds:.0f} s | {self.megabytes:.0f} MB"
        found = (
            f"{self.registered} of {frames} | {self.errors.correct} | {errors} | {self.points} | {self.rms_px:.2f} px"
        )
        return f"| {name} | {method} | {found} | {cost} |"

    def ratio(self, peers: Sequence["Score"]) -> str:
        """Return the ratios to the best values of the peers with most correct frames."""
        most = max(peer.errors.correct for peer in peers)
        best = [peer for peer in peers if peer.errors.correct == most]

        def over(value: Callable[["Score"], float]) -> str:
            return f"{value(self) / np.nanmin([value(peer) for peer in best]):.2f}"

        position, rotation = over(lambda s: s.errors.position), over(lambda s: s.errors.rotation_deg)
        seconds, megabytes = over(lambda s: s.seconds), over(lambda s: s.megabytes)
        correct = f"{self.errors.correct} against {most}"
        return f"| | {correct} | {position} | {rotation} | | | {seconds} | {megabytes} |"


def render(images: ImageSet, camera: str) -> Path:
    """Return the folder of a rendered set, from the cache if it is there."""
    rate = f"-{images.fps:g}fps" if images.fps else ""
    folder = image_cache("sfm") / f"{images.scene}-{camera}-{images.count}{rate}"
    if not (folder / "poses.txt").exists():
        source = back_to_back(RIG_WIDTH) if camera == "rig" else cameras()[camera].camera
        up = "back" if camera == "mirror" else "top"
        folder.parent.mkdir(exist_ok=True)
        om.simulate(
            om.SimulateOptions(images.scene, source, folder, up=up, frames=images.count, fps=images.fps, jpeg=95)
        )
    return folder


def run(method: str, folder: Path) -> Score | str:
    """Run a method on a set and compare its model with the truth; return the reason if it fails."""
    try:
        rows = run_module("benchmarks.sfm_methods", [method, str(folder)])
    except RuntimeError as error:
        return str(error).splitlines()[-1]
    poses = printed_poses(rows)
    points, *values = next(row[1:] for row in rows if row[0] == "result")
    return Score(len(poses), errors(folder, poses), int(points), *(float(value) for value in values))


def errors(folder: Path, poses: dict[int, Array]) -> PoseErrors:
    """Return the errors of the poses rig_from_world (3, 4) of frames."""
    truth = read_trajectory(folder / "poses.txt").poses
    path = np.array([pose.translation for pose in truth])
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    found = [Pose.of_matrix(matrix).inverse() for matrix in poses.values()]
    return pose_errors(found, [truth[frame] for frame in poses], length)


def compare(images: ImageSet, camera: str, methods: Sequence[str]) -> None:
    """Print the rows of all methods on a set, and the ratio to the best peer."""
    folder, scores = render(images, camera), dict[str, Score]()
    frames, name = frame_count(folder), f"{images.scene}, {camera}"
    for method in methods:
        if camera != "sphere" and "360" in method:  # pycolmap has no model of the camera
            continue
        found = run(method, folder)
        if isinstance(found, str):
            print(f"| {name} | {method} | failed: {found} |" + " |" * 7, flush=True)
            continue
        scores[method] = found
        print(found.row(name, method, frames), flush=True)
    peers = [each for method, each in scores.items() if method.startswith("pycolmap")]
    if peers and "omnisight" in scores:
        print(f"| {name} | ratio to the best peer {scores['omnisight'].ratio(peers)}")


def main(arguments: Sequence[str]) -> None:
    """Print one row for each set and method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sfm", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="12 frames of the room with the sphere only")
    parser.add_argument("--sets", nargs="+", metavar="SCENE", help="room, street, town, rooms ...")
    parser.add_argument("--count", type=int, help="number of frames of each of these sets")
    parser.add_argument("--cameras", nargs="+", choices=CAMERAS, default=CAMERAS)
    parser.add_argument("--methods", nargs="+", choices=tuple(METHODS), default=tuple(METHODS))
    parser.add_argument("--fps", type=float, help="frames per second of the first part of the loop, instead of all")
    options = parser.parse_args(arguments)
    sets = [ImageSet(scene, options.count or 30, options.fps) for scene in options.sets] if options.sets else SETS
    if options.quick:
        sets, options.cameras = [ImageSet("room", 12)], ["sphere"]
    print(HEADER)
    for images in sets:
        for camera in options.cameras:
            compare(images, camera, options.methods)


if __name__ == "__main__":
    main(sys.argv[1:])
