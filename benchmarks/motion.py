"""Visual odometry of rendered sequences against the true poses, while tracking and after the refinement at the end.

`python -m benchmarks motion` prints the table of docs/guide/odometry.md. The rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import omnisight as om
from benchmarks import motion_colmap
from benchmarks.motion_crops import HEADER, print_crops
from benchmarks.motion_edges import print_edges
from benchmarks.motion_loops import print_loops, refined_without_loops, score, stages, track_images
from benchmarks.rendered_images import image_cache
from omnisight.simulation import fisheye_setup, mirror_setup
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.trajectory import read_trajectory

FPS = 10.0


@dataclass(frozen=True)
class RenderedSequence:
    """A rendered sequence: scene, camera and number of images."""

    scene: str
    camera: str
    count: int

    @property
    def name(self) -> str:
        return f"{self.scene}-{self.camera}"


SEQUENCES = (
    RenderedSequence("room", "fisheye", 200),
    RenderedSequence("rooms", "mirror", 150),
    RenderedSequence("rooms", "fisheye", 200),
    RenderedSequence("street", "sphere", 150),
    RenderedSequence("town", "fisheye", 200),
    RenderedSequence("town", "sphere", 150),
    RenderedSequence("room", "rig", 120),
)
# The cameras whose perspective views are compared with the whole images: they look ahead.
CROPPED = ("fisheye", "sphere")
QUICK = (RenderedSequence("room", "fisheye", 40), RenderedSequence("street", "sphere", 40))


def camera_of(name: str) -> om.Camera | om.Rig:
    """Return a camera, or a rig of two fisheyes back to back, of about half a megapixel."""
    if name == "rig":
        return back_to_back(640)
    if name == "sphere":
        return om.sphere(960)
    setup = fisheye_setup(800) if name == "fisheye" else mirror_setup(800)
    return replace(setup.camera, theta_min=setup.theta[0], theta_max=setup.theta[1])


def render(sequence: RenderedSequence) -> Path:
    """Return the folder of a rendered sequence, from the cache if it is there."""
    folder = image_cache("odometry") / f"{sequence.scene}-{sequence.camera}-{sequence.count}"
    if not (folder / "poses.txt").exists():
        folder.parent.mkdir(exist_ok=True)
        up = "back" if sequence.camera == "mirror" else "top"
        camera = camera_of(sequence.camera)
        om.simulate(om.SimulateOptions(sequence.scene, camera, folder, up=up, frames=sequence.count, fps=FPS, jpeg=92))
    return folder


def track(folder: Path) -> om.OdometryResult:
    """Return the odometry of a rendered sequence, in which no loops are closed."""
    rig, options = folder / "rig.json", om.OdometryOptions(loops=False)
    if rig.exists():
        return om.odometry(folder, rig=rig, options=options)
    return om.odometry(folder / "images", folder / "camera.json", options=options)


def row(sequence: RenderedSequence) -> str:
    """Return the row of a sequence in the table."""
    folder = render(sequence)
    exact = read_trajectory(folder / "poses.txt")
    tracking = track_images(folder, camera_of(sequence.camera), exact.times)
    tracked, refined = (score(found, exact.poses) for found in (tracking.trajectory, refined_without_loops(tracking)))
    coverage = f"{len(tracking.trajectory)} of {sequence.count}"
    return f"| {sequence.scene}, {sequence.camera} | {tracked.length:.0f} m | {coverage} | {stages(tracked, refined)} |"


def compare_crops(sequences: Sequence[RenderedSequence]) -> None:
    """Print the table of perspective views of the images."""
    print(HEADER)
    for sequence in sequences:
        folder = render(sequence)
        print_crops(f"{sequence.scene}, {sequence.camera}", folder, read_trajectory(folder / "poses.txt").poses)


def compare_colmap(sequences: Sequence[RenderedSequence]) -> None:
    """Print the table of odometry and of pycolmap."""
    print(motion_colmap.HEADER)
    for sequence in sequences:
        folder = render(sequence)
        true, start = read_trajectory(folder / "poses.txt").poses, time.perf_counter()
        found = track(folder).trajectory
        seconds, label = time.perf_counter() - start, f"{sequence.scene}, {sequence.camera}"
        poses = {pose.frame: pose.rig_from_world for pose in found}
        print(motion_colmap.row(label, "omnisight", poses, true, seconds), flush=True)
        print(motion_colmap.colmap_row(label, folder, sequence.camera, true), flush=True)


def main(arguments: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks motion", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two short sequences, and one drive with loops")
    parser.add_argument("--loops", action="store_true", help="only the drives with loops")
    parser.add_argument("--edges", action="store_true", help="only the uncertainty of relative poses of keyframes")
    parser.add_argument("--crops", action="store_true", help="only the comparison with perspective views")
    parser.add_argument("--colmap", action="store_true", help="only the comparison with pycolmap")
    parser.add_argument("--sequences", nargs="+", metavar="SCENE-CAMERA", help="such as room-fisheye; default: all")
    options = parser.parse_args(arguments)
    quick = options.quick
    chosen = [each for each in (QUICK if quick else SEQUENCES) if each.name in (options.sequences or [each.name])]
    if options.colmap:
        compare_colmap(chosen)
        return
    if options.crops:
        compare_crops([each for each in chosen if each.camera in CROPPED])
        return
    if options.loops:
        print_loops(quick)
        return
    if options.edges:
        print_edges(quick)
        return
    print("| sequence | path | images with a pose | error | drift | drift °/m |")
    print("|---|---|---|---|---|---|")
    for sequence in chosen:
        print(row(sequence), flush=True)
    if options.sequences is None:
        print_loops(quick)
