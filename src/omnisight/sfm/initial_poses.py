"""Initial poses of the frames of a view graph, by averaging the relative poses of pairs of images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.geometry.pose import Pose
from omnisight.sfm.missing_matches import (
    KnownPoints,
    Links,
    contradicted_links,
    known_points,
    missing_matches,
    predicted_matches_of_poses,
)
from omnisight.sfm.position_averaging import MIN_DIRECTION_SIGMA, RelativePositions, average_positions
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.rotation_averaging import RelativeRotations, average_rotations
from omnisight.sfm.scale_averaging import MIN_LOG_SIGMA, PointDistances, average_log_scales
from omnisight.sfm.view_graph import Edge, ViewGraph
from omnisight.twoview.motion_model import largest_sigma_deg

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Difference from the averaged positions up to which an edge agrees with them, relative to the median distance of its
# points: scales drift, but points that look alike are farther apart.
AGREEING_GAP = 0.2


class InitialPoses(NamedTuple):
    """Poses of frames.

    Attributes
    ----------
    frames
        (F,) indices; the first is the origin of the world. None if all edges are contradicted.
    rig_from_world
        (F, 3, 4) poses, in the unit of the rig if its sensors are apart.
    contradicted
        Pairs of images whose edges place them where more matches are missing than agree.
    """

    frames: Indices
    rig_from_world: Array
    contradicted: frozenset[tuple[int, int]] = frozenset()


def initial_poses(graph: ViewGraph, points: PointDistances, images: RigImages) -> InitialPoses:
    """Estimate the poses of the largest part of a view graph whose relative scales are known.

    Parameters
    ----------
    graph
        Edges with a known direction of the translation; at least one is between different frames.
    points
        Distances of the points of its edges.
    images
        The images.
    """
    contradicted, edges = set[tuple[int, int]](), graph.edges
    while edges:
        placed = _place(replace(graph, edges=edges), points, images)
        wrong = placed.contradicted_pairs(images, graph)
        if not wrong:
            return InitialPoses(placed.frames, placed.rig_from_world, frozenset(contradicted))
        # Edges that did not agree with the wrong ones may be right, so that rotations are averaged again.
        contradicted |= wrong
        edges = [edge for edge in edges if edge.images not in wrong]
    return InitialPoses(np.zeros(0, np.intp), np.zeros((0, 3, 4)), frozenset(contradicted))


def panorama_poses(graph: ViewGraph, images: RigImages) -> InitialPoses:
    """Estimate the orientations of the largest part of a view graph whose frames were taken in one place."""
    frames, edges = largest_component(graph.edges, images)
    if len(frames) == 1:
        return InitialPoses(frames, np.eye(3, 4)[None])
    between = [edge for edge in edges if images.frame[edge.a] != images.frame[edge.b]]
    averaged = average_rotations(len(frames), relative_rotations(frames, replace(graph, edges=between), images))
    poses = np.concatenate([averaged.rig_from_world, np.zeros((len(frames), 3, 1))], axis=2)
    return InitialPoses(frames, poses)


@dataclass(frozen=True, eq=False)
class _Placement:
    """Poses of frames, and the edges from which they were estimated.

    Attributes
    ----------
    frames, rig_from_world
        (F,) indices, and their poses (F, 3, 4).
    edges
        Edges between these frames that agree with the poses.
    known
        Keypoints of each image whose distances are known.
    """

    frames: Indices
    rig_from_world: Array
    edges: list[Edge]
    known: list[KnownPoints | None]

    def contradicted_pairs(self, images: RigImages, graph: ViewGraph) -> set[tuple[int, int]]:
        """Return the edges that place two parts of the map where more matches are missing than agree."""
        edges = [edge for edge in self.edges if images.frame[edge.a] != images.frame[edge.b]]
        matches, no_matches = graph.matches, np.zeros((0, 2), np.intp)
        inside, row = np.isin(images.frame, self.frames), np.searchsorted(self.frames, images.frame)
        pairs = [(a, b) for a, b in graph.compared if inside[a] and inside[b] and images.frame[a] != images.frame[b]]

        def pose(image: int) -> Pose:
            of_sensor = Pose.of_matrix(images.sensor_from_rig[images.sensor[image]])
            return of_sensor @ Pose.of_matrix(self.rig_from_world[row[image]])

        poses = {image: pose(image) for image in np.flatnonzero(inside).tolist()}

        of_pairs = [matches.get(pair, no_matches) for pair in pairs]
        lacking = missing_matches(predicted_matches_of_poses(pairs, of_pairs, self.known, poses), graph.repeatability)
        suspicious = np.flatnonzero(lacking)
        linked = row[np.array([edge.images for edge in edges], np.intp).reshape(-1, 2)]
        unlinked = row[np.array(pairs, np.intp).reshape(-1, 2)[suspicious]]
        links = Links(linked[:, 0], linked[:, 1], graph.support_of(edges))
        without = Links(unlinked[:, 0], unlinked[:, 1], lacking[suspicious])
        return {edge.images for edge in _select(edges, contradicted_links(len(self.frames), links, without))}


def _place(graph: ViewGraph, points: PointDistances, images: RigImages) -> _Placement:
    """Average the rotations, and then the positions, of the largest parts of a view graph."""
    frames, rotations, consistent = _average_rotations(graph, images)
    _, edges = largest_component(consistent, images)
    distances, table = points.of(edges), points.table(edges)
    log_scales, log_sigma, component = average_log_scales(table)
    use = np.flatnonzero(component == np.bincount(component).argmax())
    placed, _ = largest_component([edges[i] for i in use], images)
    use = use[np.isin(images.frame[[edges[i].a for i in use]], placed)]
    edges, distances = [edges[i] for i in use], [distances[i] for i in use]
    of_frame = rotations[np.searchsorted(frames, placed)]
    graph = replace(graph, edges=edges)
    relative = _relative_positions(placed, of_frame, graph, images, log_scales[use], log_sigma[use])
    positions, unit = average_positions(len(placed), relative)
    gap = positions[relative.b] - positions[relative.a] + relative.arm - relative.displacement / unit
    far = np.exp([np.median(each.log_distance) + scale for each, scale in zip(distances, log_scales[use], strict=True)])
    agrees = np.linalg.norm(gap, axis=1) <= AGREEING_GAP * far / unit
    of_placed = np.full(len(log_scales), np.nan)
    of_placed[use] = log_scales[use] - np.log(unit)
    known = known_points(points, table.medians(of_placed))
    translations = -np.einsum("nij,nj->ni", of_frame, positions)
    poses = np.concatenate([of_frame, translations[:, :, None]], axis=2)
    return _Placement(placed, poses, _select(edges, agrees), known)


def _average_rotations(graph: ViewGraph, images: RigImages) -> tuple[Indices, Array, list[Edge]]:
    """Return the frames (F,) of the largest part of a view graph, their rotations (F, 3, 3), and agreeing edges."""
    frames, edges = largest_component(graph.edges, images)
    is_moving = np.array([images.frame[edge.a] != images.frame[edge.b] for edge in edges])
    if not is_moving.any():
        return frames, np.eye(3)[None], edges
    moving = replace(graph, edges=_select(edges, is_moving))
    averaged = average_rotations(len(frames), relative_rotations(frames, moving, images))
    is_consistent = ~is_moving
    is_consistent[is_moving] = averaged.is_consistent
    return frames, averaged.rig_from_world, _select(edges, is_consistent)


def relative_rotations(frames: Indices, graph: ViewGraph, images: RigImages) -> RelativeRotations:
    """Return the relative rotations of some of the frames from edges between their images."""
    edges = graph.edges
    of_sensor = images.sensor_from_rig[:, :, :3]
    a, b = np.array([(edge.a, edge.b) for edge in edges]).T
    b_from_a = np.array([edge.b_from_a.rotation for edge in edges])
    in_rig = of_sensor[images.sensor[b]].transpose(0, 2, 1) @ b_from_a @ of_sensor[images.sensor[a]]
    sigma = np.radians([largest_sigma_deg(edge.covariance[:3, :3]) for edge in edges])
    return RelativeRotations(*_ends(frames, edges, images), in_rig, sigma, graph.support_of(edges))


def largest_component(edges: Sequence[Edge], images: RigImages) -> tuple[Indices, list[Edge]]:
    """Return the frames of the largest connected part of a view graph, and its edges."""
    a, b = (images.frame[[getattr(edge, side) for edge in edges]] for side in ("a", "b"))
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(images.frames, images.frames))
    label = connected_components(graph, directed=False)[1]
    sizes = np.bincount(label)
    largest = max(set(label[a].tolist()), key=lambda each: sizes[each])
    return np.flatnonzero(label == largest), _select(edges, label[a] == largest)


def _relative_positions(
    frames: Indices, rotations: Array, graph: ViewGraph, images: RigImages, log_scales: Array, log_sigma: Array
) -> RelativePositions:
    """Return the displacements between the images of edges of known relative scale."""
    edges = graph.edges
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
        support=graph.support_of(edges),
    )


def _ends(frames: Indices, edges: Sequence[Edge], images: RigImages) -> tuple[Indices, Indices]:
    """Return the frames (E,) of both ends of edges, counted among some of the frames."""
    a, b = (np.searchsorted(frames, images.frame[[getattr(edge, side) for edge in edges]]) for side in ("a", "b"))
    return a, b


def _select(edges: Sequence[Edge], use: NDArray[np.bool_]) -> list[Edge]:
    return [edge for edge, chosen in zip(edges, use, strict=True) if chosen]
