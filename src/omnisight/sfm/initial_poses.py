"""Initial poses of the frames of a view graph, by averaging the relative poses of pairs of images."""

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
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.rotation_averaging import RelativeRotations, average_rotations
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.motion_model import largest_sigma_deg

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def initial_poses(edges: Sequence[Edge], keypoints: Sequence[Keypoints], images: RigImages) -> tuple[Indices, Array]:
    """Estimate the poses of the largest part of a view graph whose relative scales are known.

    Parameters
    ----------
    edges
        Pairs of images with a known direction of the translation; at least one is between different frames.
    keypoints
        Keypoints of all images.
    images
        The images.

    Returns
    -------
    frames
        (F,) indices; the first is the origin of the world.
    rig_from_world
        (F, 3, 4) poses, in the unit of the rig if its sensors are apart.
    """
    frames, edges = largest_component(edges, images)
    is_moving = np.array([images.frame[edge.a] != images.frame[edge.b] for edge in edges])
    averaged = average_rotations(len(frames), relative_rotations(frames, _select(edges, is_moving), images))
    is_moving[is_moving] = averaged.is_consistent
    edges = _select(edges, is_moving | np.array([images.frame[edge.a] == images.frame[edge.b] for edge in edges]))
    log_scales, log_sigma, component = average_log_scales([edge_distances(edge, keypoints) for edge in edges])
    use = np.flatnonzero(component == np.bincount(component).argmax())
    placed, edges = largest_component([edges[i] for i in use], images)
    rotations = averaged.rig_from_world[np.searchsorted(frames, placed)]
    positions = average_positions(
        len(placed), _relative_positions(placed, rotations, edges, images, log_scales[use], log_sigma[use])
    )
    translations = -np.einsum("nij,nj->ni", rotations, positions)
    return placed, np.concatenate([rotations, translations[:, :, None]], axis=2)


def panorama_poses(edges: Sequence[Edge], images: RigImages) -> tuple[Indices, Array]:
    """Estimate the orientations of the largest part of a view graph whose frames were taken in one place."""
    frames, edges = largest_component(edges, images)
    if len(frames) == 1:
        return frames, np.eye(3, 4)[None]
    between = [edge for edge in edges if images.frame[edge.a] != images.frame[edge.b]]
    averaged = average_rotations(len(frames), relative_rotations(frames, between, images))
    return frames, np.concatenate([averaged.rig_from_world, np.zeros((len(frames), 3, 1))], axis=2)


def relative_rotations(frames: Indices, edges: Sequence[Edge], images: RigImages) -> RelativeRotations:
    """Return the relative rotations of some of the frames from edges between their images."""
    of_sensor = images.sensor_from_rig[:, :, :3]
    a, b = np.array([(edge.a, edge.b) for edge in edges]).T
    b_from_a = np.array([edge.b_from_a.rotation for edge in edges])
    in_rig = of_sensor[images.sensor[b]].transpose(0, 2, 1) @ b_from_a @ of_sensor[images.sensor[a]]
    sigma = np.radians([largest_sigma_deg(edge.covariance[:3, :3]) for edge in edges])
    return RelativeRotations(*_ends(frames, edges, images), in_rig, sigma)


def largest_component(edges: Sequence[Edge], images: RigImages) -> tuple[Indices, list[Edge]]:
    """Return the frames of the largest connected part of a view graph, and its edges."""
    a, b = (images.frame[[getattr(edge, side) for edge in edges]] for side in ("a", "b"))
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(images.frames, images.frames))
    label = connected_components(graph, directed=False)[1]
    sizes = np.bincount(label)
    largest = max(set(label[a].tolist()), key=lambda each: sizes[each])
    return np.flatnonzero(label == largest), _select(edges, label[a] == largest)


def _relative_positions(
    frames: Indices, rotations: Array, edges: Sequence[Edge], images: RigImages, log_scales: Array, log_sigma: Array
) -> RelativePositions:
    """Return the displacements between the images of edges of known relative scale."""
    a, b = _ends(frames, edges, images)
    of_a, of_b = (images.sensor[[getattr(edge, side) for edge in edges]] for side in ("a", "b"))
    world_from_b = rotations[b].transpose(0, 2, 1) @ images.sensor_from_rig[of_b, :, :3].transpose(0, 2, 1)
    translations = np.array([edge.b_from_a.translation for edge in edges])
    scales = np.exp(log_scales)
    displacement = -scales[:, None] * np.einsum("eij,ej->ei", world_from_b, translations)
    arms = [np.einsum("eji,ej->ei", rotations[f], images.centers[s]) for f, s in ((a, of_a), (b, of_b))]
    sigma = np.radians([largest_sigma_deg(edge.covariance[3:, 3:]) for edge in edges])
    length = np.maximum(np.linalg.norm(displacement, axis=1), 1e-300)
    return RelativePositions(
        a,
        b,
        displacement,
        arms[1] - arms[0],
        lengthwise=length * np.maximum(log_sigma, MIN_LOG_SIGMA),
        crosswise=length * np.maximum(sigma, MIN_DIRECTION_SIGMA),
    )


def _ends(frames: Indices, edges: Sequence[Edge], images: RigImages) -> tuple[Indices, Indices]:
    """Return the frames (E,) of both ends of edges, counted among some of the frames."""
    a, b = (np.searchsorted(frames, images.frame[[getattr(edge, side) for edge in edges]]) for side in ("a", "b"))
    return a, b


def _select(edges: Sequence[Edge], use: NDArray[np.bool_]) -> list[Edge]:
    return [edge for edge, chosen in zip(edges, use, strict=True) if chosen]
