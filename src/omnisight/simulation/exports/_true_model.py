"""The true poses, and points of the surfaces, as a reconstruction."""

import re
from collections.abc import Sequence

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.reconstructions import ExportOptions, get_reconstruction_format
from omnisight.rig import Rig
from omnisight.sfm.reconstruction import PointObservations, Points, Reconstruction
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import SimulatedSequence

# Points of a model: enough to initialize splats, few enough to be found in all images of a long sequence.
MAX_POINTS = 20_000
# Relative difference of the distance from the depth map at which an image shows a point.
DEPTH_TOLERANCE = 0.01


def true_model(sequence: SimulatedSequence) -> Reconstruction:
    """Return a reconstruction with the true poses, and points that at least two images show."""
    views = [(k, i) for k in range(len(sequence.cameras)) for i in range(len(sequence.times))]
    samples = sequence.samples
    positions = np.concatenate([sample.points for sample in samples])
    colors = np.concatenate([sample.colors for sample in samples])
    if len(positions) > MAX_POINTS:
        chosen = np.sort(np.random.default_rng(0).choice(len(positions), MAX_POINTS, replace=False))
        positions, colors = positions[chosen], colors[chosen]
    images, points, pixels = [], [], []
    for number, (k, i) in enumerate(views):
        projected, shown = sequence.view(k, i).locate(positions, DEPTH_TOLERANCE, DEPTH_TOLERANCE)
        found = np.flatnonzero(shown)
        images.append(np.full(len(found), number))
        points.append(found)
        pixels.append(projected[found])
    point = np.concatenate(points)
    kept = np.bincount(point, minlength=len(positions)) > 1
    used = kept[point]
    index = np.cumsum(kept) - 1
    seen = np.concatenate(pixels)[used]
    return Reconstruction(
        rig=_rig(sequence.cameras),
        names=tuple(sequence.name(k, i) for k, i in views),
        sensor=np.array([k for k, _ in views], np.intp),
        frame=np.array([i for _, i in views], np.intp),
        rig_from_world=tuple(sequence.world_from_rig(i).inverse() for i in range(len(sequence.times))),
        pose_covariance=np.zeros((len(sequence.times), 6, 6)),
        points=Points(positions[kept], np.zeros((int(kept.sum()), 3, 3)), colors[kept]),
        observations=PointObservations(np.concatenate(images)[used], index[point[used]], seen, np.zeros_like(seen)),
        has_scale=True,
    )


def check_format(name: str, cameras: Sequence[MountedCamera]) -> None:
    """Check that a format of reconstructions can hold the cameras.

    Raises
    ------
    ValueError
        If it cannot.
    """
    rig, none = _rig(cameras), np.zeros(0, np.intp)
    count = np.arange(len(rig))
    points = Points(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3), np.uint8))
    observations = PointObservations(none, none, np.zeros((0, 2)), np.zeros((0, 2)))
    empty = Reconstruction(
        rig, rig.names, count, 0 * count, (Pose(),), np.zeros((1, 6, 6)), points, observations, has_scale=True
    )
    try:
        list(get_reconstruction_format(name).files(empty, ExportOptions(format=name)))
    except ValueError as error:
        # The advice is that of another command.
        reason = re.sub(r"[:;] (or )?export (it with )?--to splat.*$", "", str(error))
        raise ValueError(f"--export {name}: {reason}; choose another format or camera") from error


def _rig(cameras: Sequence[MountedCamera]) -> Rig:
    return Rig.from_sensors({c.name or "camera": (c.camera, c.rig_from_camera.inverse()) for c in cameras})
