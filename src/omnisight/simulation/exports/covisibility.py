"""Pairs of images that show the same surface, and pairs at the same place at different times."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import ExportFile, SimulatedSequence

Array = NDArray[np.float64]

DESCRIPTION = """\
covisibility/
             covisibility.csv: pairs of images and the share of the surface in each that the other one shows, by a grid
             of pixels. loops.csv: pairs at the same place at different times, with their distance and the distance
             travelled between them.
"""
NEEDS_IMU, NEEDS_SAMPLES = False, True

# Depth maps have a resolution of a few pixels: an occluder is nearer by at least this share.
OCCLUSION_TOLERANCE = 0.05
# Pairs with less are not listed.
MIN_SHARE = 0.01
# A loop: images that share this much, and travelled this many times the distance between them, over this time.
LOOP_SHARE, LOOP_TRAVEL_RATIO, LOOP_MIN_TRAVEL_M, LOOP_MIN_SECONDS = 0.3, 10.0, 1.0, 5.0
# The distance within which the benchmarks of place recognition count images as the same place.
LOOP_MAX_DISTANCE_M = 25.0


def check(cameras: Sequence[MountedCamera]) -> None:
    """Accept all cameras."""


def files(sequence: SimulatedSequence) -> Iterator[ExportFile]:
    """Return covisibility.csv and loops.csv."""
    views = [(k, i) for k in range(len(sequence.cameras)) for i in range(len(sequence.times))]
    names = [sequence.name(k, i) for k, i in views]
    shares = visible_shares(sequence)
    lines = ["image_a,image_b,share_of_a,share_of_b"]
    for a, b in zip(*np.nonzero(np.triu(np.maximum(shares, shares.T) >= MIN_SHARE, 1)), strict=True):
        lines.append(f"{names[a]},{names[b]},{shares[a, b]:.3f},{shares[b, a]:.3f}")
    yield "covisibility/covisibility.csv", ("\n".join(lines) + "\n").encode()
    places = np.array([sequence.world_from_rig(i).translation for i in range(len(sequence.times))])
    lines = ["image_a,image_b,distance_m,travelled_m,share"]
    frames = np.array([i for _, i in views])
    for a, b, distance, travelled in loops(sequence.times, places, frames, shares):
        share = (shares[a, b] + shares[b, a]) / 2
        lines.append(f"{names[a]},{names[b]},{distance:.3f},{travelled:.3f},{share:.3f}")
    yield "covisibility/loops.csv", ("\n".join(lines) + "\n").encode()


def visible_shares(sequence: SimulatedSequence) -> Array:
    """Return the share (I, I) of the surface in image i, per pixel, that image j shows; 0 without a surface."""
    views = [sequence.view(k, i) for k in range(len(sequence.cameras)) for i in range(len(sequence.times))]
    points = np.concatenate([view.sample.points for view in views])
    owner = np.repeat(np.arange(len(views)), [len(view.sample.points) for view in views])
    counts = np.maximum(np.bincount(owner, minlength=len(views)), 1)
    shares = np.empty((len(views), len(views)))
    for j, view in enumerate(views):
        shown = view.locate(points, OCCLUSION_TOLERANCE)[1]
        shares[:, j] = np.bincount(owner, shown, minlength=len(views)) / counts
    return shares


def loops(
    times: Array, places: Array, frames: NDArray[np.intp], shares: Array
) -> Iterator[tuple[int, int, float, float]]:
    """Yield pairs of images at the same place at different times, the distance between them, and the way travelled.

    Parameters
    ----------
    times, places
        (N,) seconds and (N, 3) metres, of the frames.
    frames
        (I,) frame of each image.
    shares
        (I, I), see `visible_shares`.
    """
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    both = (shares + shares.T) / 2
    for a, b in zip(*np.nonzero(np.triu(both >= LOOP_SHARE, 1)), strict=True):
        i, j = frames[a], frames[b]
        distance, travelled = float(np.linalg.norm(places[i] - places[j])), float(abs(way[j] - way[i]))
        apart = abs(times[j] - times[i]) >= LOOP_MIN_SECONDS
        if (
            apart
            and distance <= LOOP_MAX_DISTANCE_M
            and travelled >= max(LOOP_TRAVEL_RATIO * distance, LOOP_MIN_TRAVEL_M)
        ):
            yield int(a), int(b), distance, travelled
