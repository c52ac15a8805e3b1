"""Reduce the points of all images to one target."""

import numpy as np
from numpy.typing import NDArray

from omnisight.corners._protocol import Array

MIN_CORNERS = 6  # for a pose
SAME_POINT = 1e-7  # of the largest coordinate: nearer points are one
MAX_FLATNESS = 1e-6  # distance from a plane over the extent of the points: a flat target
MIN_THICKNESS = 1e-3  # extent across a line over the extent along it: not collinear
MAX_ORIGIN_DISTANCE = 10.0  # of the centroid over the extent: beyond it poses lose digits


def merge_points(points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return the distinct points (K, 3) in their order, and the index (N,) of each given point (N, 3) among them."""
    resolution = SAME_POINT * max(float(np.abs(points).max()), 1e-300)
    _, first, ids = np.unique(np.round(points / resolution), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    return points[first[order]], rank[ids.reshape(-1)]


def neighbour_distance(points: Array) -> float:
    """Return the median distance of points (K, 3) to their nearest neighbour."""
    from scipy.spatial import KDTree

    if len(points) < MIN_CORNERS:
        raise ValueError(f"{len(points)} different points on the target; at least {MIN_CORNERS} are needed")
    distances, _ = KDTree(points).query(points, k=2)
    return float(np.median(distances[:, 1]))


def normalize_frame(points: Array) -> tuple[Array, list[str]]:
    """Return the points near the origin, those of a plane in z = 0, and a note if the frame moved."""
    centroid = points.mean(0)
    _, extent, axes = np.linalg.svd(points - centroid, full_matrices=False)
    normal = axes[2]
    if points[:, 2].any() and float(np.abs((points - centroid) @ normal).max()) < MAX_FLATNESS * extent[1]:
        if np.abs(points[:, 2]).max() < MAX_FLATNESS * extent[1]:
            return points * (1.0, 1.0, 0.0), []
        # The x axis in the plane is the projection of the axis that is least parallel to the normal.
        x = np.eye(3)[np.abs(normal).argmin()]
        x = x - (x @ normal) * normal
        plane_from_target = np.stack([x, np.cross(normal, x)]) / np.linalg.norm(x)
        flat = np.concatenate([(points - centroid) @ plane_from_target.T, np.zeros((len(points), 1))], 1)
        return flat, ["the points lie on a plane other than z = 0: poses are those of this plane, about its centroid"]
    if np.linalg.norm(centroid) > MAX_ORIGIN_DISTANCE * np.linalg.norm(np.ptp(points, axis=0)):
        return points - centroid, ["the points lie far from their origin: poses are those of their centroid"]
    return points, []


def is_degenerate(points: Array) -> bool:
    """Return whether points (N, 3) are collinear."""
    extent = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(extent[1] < MIN_THICKNESS * extent[0])
