"""Edges whose relative poses lack matches, and the relative poses of the other matches of their images."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_map
from omnisight.sfm.missing_matches import (
    missing_matches,
    predicted_matches_of_edges,
    repeatability,
    supporting_matches,
)
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.scale_averaging import PointDistances
from omnisight.sfm.view_graph import Edge, ViewGraph, match_pair

Indices = NDArray[np.intp]

# Relative poses that are estimated for a pair of images: in a corridor with equal doors, two wrong ones can have more
# matches than the true one.
MAX_POSES = 3


def without_contradicted_edges(graph: ViewGraph, points: PointDistances, images: RigImages) -> ViewGraph:
    """Return a view graph whose edges do not lack matches, with the support of its edges and the repeatability.

    Where things look alike, the relative pose with most matches can be wrong: the true one is then that of the other
    matches.
    """
    rejected, support = dict[tuple[int, int], Indices](), dict[Edge, float]()
    for number in range(MAX_POSES):
        moving = [e for e in graph.edges if e.has_translation and images.frame[e.a] != images.frame[e.b]]
        predictions = predicted_matches_of_edges(moving, points)
        share = repeatability([edge.images for edge in moving], predictions)
        support |= zip(moving, supporting_matches(moving, predictions, share).tolist(), strict=True)
        graph, lacking = replace(graph, repeatability=share), missing_matches(predictions, share)
        contradicted = {edge for edge, lack in zip(moving, lacking, strict=True) if lack}
        if not contradicted:
            break
        for edge in contradicted:
            before = rejected.get(edge.images, np.zeros((0, 2), np.intp))
            rejected[edge.images] = np.concatenate([before, edge.pairs])
        again = sorted(edge.images for edge in contradicted) if number + 1 < MAX_POSES else []
        others = parallel_map(lambda pair: match_pair(points.keypoints, *pair, without=rejected[pair]), again)
        kept = [edge for edge in graph.edges if edge not in contradicted]
        graph = replace(graph, edges=kept + [edge for edge in others if edge is not None])
    return replace(graph, support=support)
