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
from benchmarks.motion_drives import camera_named
from benchmarks.motion_edges import print_edges
from benchmarks.motion_loops import print_loops, refined_without_loops, score, stages, track_images
from benchmarks.rendered_images import image_cache
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.trajectory import read_trajectory

FPS = 10.0


@dataclass(frozen=True)
class RenderedSequence:
    """A rendered sequence: scene, camera, number of images, and their width, px."""

    scene: str
    camera: str
    count: int
    width: int

    @property
    def name(self) -> str:
        return f"{self.scene}-{self.camera}"

    @property
    def body(self) -> om.Camera | om.Rig:
        """The camera, or a rig of two fisheyes back to back."""
        return back_to_back(self.width) if self.camera == "rig" else camera_named(self.camera, self.width)


# Images of one megapixel.
SEQUENCES = (
    RenderedSequence("room", "fisheye", 200, 1170),
    RenderedSequence("rooms", "mirror", 150, 1170),
    RenderedSequence("rooms", "fisheye", 200, 1170),
    RenderedSequence("street", "sphere", 150, 1440),
    RenderedSequence("town", "fisheye", 200, 1170),
    RenderedSequence("town", "sphere", 150, 1440),
    RenderedSequence("room", "rig", 120, 1000),
)
# Images of about half a megapixel, for the comparisons.
SMALL = tuple(replace(each, width={"sphere": 960, "rig": 640}.get(each.camera, 800)) for each in SEQUENCES)
# The cameras whose perspective views are compared with the whole images: they look ahead.
CROPPED = ("fisheye", "sphere")
QUICK = (RenderedSequence("room", "fisheye", 40, 800), RenderedSequence("street", "sphere", 40, 960))


def render(sequence: RenderedSequence) -> Path:
    """Return the folder of a rendered sequence, from the cache if it is there."""
    folder = image_cache("odometry") / f"{sequence.name}-{sequence.count}-{sequence.width}px"
    if not (folder / "poses.txt").exists():
        folder.parent.mkdir(exist_ok=True)
        up = "back" if sequence.camera == "mirror" else "top"
        om.simulate(
            om.SimulateOptions(sequence.scene, sequence.body, folder, up=up, frames=sequence.count, fps=FPS, jpeg=92)
        )
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
    tracking = track_images(folder, sequence.body, exact.times)
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
    quick, small = options.quick, options.colmap or options.crops
    sequences = QUICK if quick else SMALL if small else SEQUENCES
    chosen = [each for each in sequences if each.name in (options.sequences or [each.name])]
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
