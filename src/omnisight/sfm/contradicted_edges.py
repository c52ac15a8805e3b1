"""Edges whose relative poses lack matches, and the relative poses of the other matches of their images."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_map
from omnisight.sfm.missing_matches import pairs_with_missing_matches
from omnisight.sfm.position_averaging import PointDistances
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import ViewGraph, match_pair

Indices = NDArray[np.intp]

# Relative poses that are estimated for a pair of images: in a corridor with equal doors, two wrong ones can have more
# matches than the true one.
MAX_POSES = 3


def without_contradicted_edges(graph: ViewGraph, points: PointDistances, images: RigImages) -> ViewGraph:
    """Return a view graph whose edges do not lack matches.

    Where things look alike, the relative pose with most matches can be wrong: the true one is then that of the other
    matches.
    """
    rejected = dict[tuple[int, int], Indices]()
    for number in range(MAX_POSES):
        between = [edge for edge in graph.edges if images.frame[edge.a] != images.frame[edge.b]]
        contradicted = pairs_with_missing_matches(between, points)
        if not contradicted:
            break
        for edge in between:
            if edge.images in contradicted:
                before = rejected.get(edge.images, np.zeros((0, 2), np.intp))
                rejected[edge.images] = np.concatenate([before, edge.pairs])
        again = sorted(contradicted) if number + 1 < MAX_POSES else []
        others = parallel_map(lambda pair: match_pair(points.keypoints, *pair, without=rejected[pair]), again)
        kept = [edge for edge in graph.edges if edge.images not in contradicted]
        graph = replace(graph, edges=kept + [edge for edge in others if edge is not None])
    return graph
