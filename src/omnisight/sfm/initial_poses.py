"""Initial poses of the images of a view graph, by averaging the relative poses of pairs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.features import Keypoints
from omnisight.sfm.position_averaging import (
    MIN_DIRECTION_SIGMA,
    MIN_LOG_SIGMA,
    RelativePositions,
    average_log_scales,
    average_positions,
    edge_distances,
)
from omnisight.sfm.rotation_averaging import RelativeRotations, average_rotations
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.motion_model import largest_sigma_deg

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def initial_poses(edges: Sequence[Edge], keypoints: Sequence[Keypoints]) -> tuple[Indices, Array]:
    """Estimate the poses of the largest part of a view graph whose relative scales are known.

    Parameters
    ----------
    edges
        Pairs with a known direction of the translation; at least one.
    keypoints
        Keypoints of all images.

    Returns
    -------
    images
        (I,) indices of the images; the first is the origin of the world.
    cam_from_world
        (I, 3, 4) poses.
    """
    images, edges = largest_component(len(keypoints), edges)
    averaged = average_rotations(len(images), relative_rotations(images, edges))
    edges = [edge for edge, is_consistent in zip(edges, averaged.is_consistent, strict=True) if is_consistent]
    log_scales, log_sigma, component = average_log_scales([edge_distances(edge, keypoints) for edge in edges])
    use = np.flatnonzero(component == np.bincount(component).argmax())
    placed, edges = largest_component(len(keypoints), [edges[i] for i in use])
    rotations = averaged.cam_from_world[np.searchsorted(images, placed)]
    scales = np.exp(log_scales[use])
    a, b = _ends(placed, edges)
    directions = np.array([edge.pose.b_from_a.translation for edge in edges if edge.pose.b_from_a])
    sigma = np.radians([largest_sigma_deg(edge.pose.covariance[3:, 3:]) for edge in edges])
    positions = average_positions(
        len(placed),
        RelativePositions(
            a,
            b,
            displacement=-scales[:, None] * np.einsum("eji,ej->ei", rotations[b], directions),
            lengthwise=scales * np.maximum(log_sigma[use], MIN_LOG_SIGMA),
            crosswise=scales * np.maximum(sigma, MIN_DIRECTION_SIGMA),
        ),
    )
    translations = -np.einsum("nij,nj->ni", rotations, positions)
    return placed, np.concatenate([rotations, translations[:, :, None]], axis=2)


def panorama_poses(edges: Sequence[Edge], count: int) -> tuple[Indices, Array]:
    """Estimate the orientations of the largest part of a graph of `count` images that were taken in one place."""
    images, edges = largest_component(count, edges)
    averaged = average_rotations(len(images), relative_rotations(images, edges))
    return images, np.concatenate([averaged.cam_from_world, np.zeros((len(images), 3, 1))], axis=2)


def relative_rotations(images: Indices, edges: Sequence[Edge]) -> RelativeRotations:
    """Return the rotations of edges between some of the images."""
    rotations = np.array([edge.pose.b_from_a.rotation for edge in edges if edge.pose.b_from_a])
    sigma = np.radians([largest_sigma_deg(edge.pose.covariance[:3, :3]) for edge in edges])
    return RelativeRotations(*_ends(images, edges), rotations, sigma)


def largest_component(count: int, edges: Sequence[Edge]) -> tuple[Indices, list[Edge]]:
    """Return the images of the largest connected part of a graph of `count` images, and its edges."""
    a, b = np.array([(edge.a, edge.b) for edge in edges]).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    label = connected_components(graph, directed=False)[1]
    largest = np.bincount(label).argmax()
    return np.flatnonzero(label == largest), [edge for edge in edges if label[edge.a] == largest]


def _ends(images: Indices, edges: Sequence[Edge]) -> tuple[Indices, Indices]:
    """Return the ends (E,) of edges, counted among some of the images."""
    a, b = (np.searchsorted(images, [getattr(edge, side) for edge in edges]) for side in ("a", "b"))
    return a, b
