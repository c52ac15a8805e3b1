"""Loop closing on rendered drives and walks that return to places: `python -m benchmarks motion --loops`."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.motion_drives import Drive, render
from benchmarks.motion_score import Errors, errors
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.central_rig import has_baseline
from omnisight.visual_odometry.frame_result import TrackedPose
from omnisight.visual_odometry.loop_bundle import adjust_globally
from omnisight.visual_odometry.loop_detection import LoopDetector
from omnisight.visual_odometry.loop_graph import world_from_keyframes
from omnisight.visual_odometry.loop_result import LoopClosure
from omnisight.visual_odometry.trajectory_correction import correct_trajectory

DRIVES = (
    Drive("block", "fisheye", 450),
    Drive("block", "rig", 450),
    Drive("street", "sphere", 400),
    Drive("street", "mirror", 400),
    Drive("street", "fisheye", 750, seed=1),
    Drive("town", "fisheye", 1410),
    Drive("town", "fisheye", 1410, width=1170),
    Drive("room", "fisheye", 700, width=800),
    Drive("room", "fisheye", 600, width=800, seed=1, fps=30.0),
    Drive("flat", "fisheye", 1080, width=800, exposure_time=0.01),
)
# Share of the images that must have a pose.
MIN_COVERAGE = 0.99
# Errors of the relative pose of a wrong loop: degrees, and metres.
MAX_ANGLE_DEG, MAX_DISTANCE_M = 2.0, 1.0


def track(drive: Drive) -> om.Odometry:
    """Track a drive."""
    return track_images(render(drive), drive.body, drive.trajectory.times)


def track_images(folder: Path, body: om.Camera | om.Rig, times: Iterable[float]) -> om.Odometry:
    """Track the images of a folder, those of a rig in folders of the names of its cameras."""
    names = body.names if isinstance(body, om.Rig) else ["images"]
    files = zip(*(sorted((folder / name).iterdir()) for name in names), strict=True)
    tracking = om.Odometry(body)
    for seconds, of_frame in zip(times, files, strict=True):
        tracking.add([om.read_image(file) for file in of_frame], seconds)
    tracking.finish()
    return tracking


def refined_without_loops(tracking: om.Odometry) -> tuple[TrackedPose, ...]:
    """Return the trajectory with all keyframes refined together, although places were seen again."""
    history = tracking._history  # pyright: ignore[reportPrivateUsage]
    assert history is not None
    detector = LoopDetector(history, has_scale=has_baseline(tracking.rig))
    rows, nodes = adjust_globally(history, detector, [], world_from_keyframes(history))
    return correct_trajectory(tracking.trajectory, np.array(history.frames)[rows], nodes)


def score(trajectory: Sequence[TrackedPose], true: Sequence[Pose]) -> Errors:
    """Compare a trajectory with the true poses."""
    return errors(_world_from_rig(trajectory), [true[pose.frame] for pose in trajectory])


def row(drive: Drive) -> str:
    """Return the row of a drive in the table."""
    true = drive.trajectory.poses
    start = time.process_time()
    tracking = track(drive)
    tracked = time.process_time()
    closed = tracking.close_loops()
    seconds = time.process_time() - tracked
    before, after = score(tracking.trajectory, true), score(closed.trajectory, true)
    refined = score(refined_without_loops(tracking), true)
    coverage = len(tracking.trajectory) / drive.count
    name = f"{drive.route}, {drive.camera}"
    if coverage < MIN_COVERAGE:
        return f"| {name} | failed: {coverage:.0%} of the images have a pose |"
    figures = f"{stages(before, refined)} | {after.position:.3%}"
    times = f"{(tracked - start) / drive.count * 1000:.0f} ms | {seconds:.0f} s"
    loops = _loops(closed, tracking.trajectory, true)
    return f"| {name} | {before.length:.0f} m | {coverage:.0%} | {figures} | {loops} | {times} |"


def stages(tracked: Errors, refined: Errors) -> str:
    """Return the cells of error and drift while tracking, and of the refined trajectory."""
    cells = [(each.position, each.drift, each.drift_deg_per_m) for each in (tracked, refined)]
    formats = "{:.3%} / {:.3%}", "{:.3%} / {:.3%}", "{:.4f} / {:.4f}"
    return " | ".join(text.format(*pair) for text, pair in zip(formats, zip(*cells, strict=True), strict=True))


def _loops(closed: LoopClosure, before: Sequence[TrackedPose], true: Sequence[Pose]) -> str:
    """Return the number of closed loops, of wrong ones among them, and of rejected ones."""
    found, exact = ([pose.translation for pose in poses] for poses in (_world_from_rig(before), true))
    unit = np.linalg.norm(np.diff(exact, axis=0), axis=1).sum() / np.linalg.norm(np.diff(found, axis=0), axis=1).sum()
    wrong = 0
    for loop in closed.loops:
        change = loop.first_from_last.inverse() @ (true[loop.first].inverse() @ true[loop.last])
        angle = np.degrees(np.linalg.norm(so3.log(change.rotation)))
        lengths = (
            np.linalg.norm(loop.first_from_last.translation) * unit,
            np.linalg.norm(true[loop.first].translation - true[loop.last].translation),
        )
        wrong += bool(angle > MAX_ANGLE_DEG or abs(lengths[0] - lengths[1]) > MAX_DISTANCE_M)
    return f"{len(closed.loops)}, {wrong} wrong; {len(closed.rejected)} rejected"


def _world_from_rig(trajectory: Sequence[TrackedPose]) -> list[Pose]:
    return [pose.rig_from_world.inverse() for pose in trajectory]


def print_loops(quick: bool) -> None:
    """Print the table."""
    print("\n| drive | path | images with a pose | error | drift | drift °/m | after loops | loops | image | closing |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for drive in DRIVES[:1] if quick else DRIVES:
        print(row(drive), flush=True)
