"""Tracks: keypoints of several images that show the same point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.sfm.common_points import common_points, divided_points, frames_with_common_points
from omnisight.sfm.view_graph import Edge

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Observations (M,) of tracks, sorted by track and image.

    Attributes
    ----------
    track, image, keypoint
        (M,) indices.
    """

    track: Indices
    image: Indices
    keypoint: Indices

    def __len__(self) -> int:
        """Return the number of tracks."""
        return int(self.track[-1]) + 1 if len(self.track) else 0

    @property
    def starts(self) -> Indices:
        """First observation (T + 1,) of each track."""
        return np.searchsorted(self.track, np.arange(len(self) + 1))

    def select(self, use: NDArray[np.bool_]) -> tuple["Tracks", Indices]:
        """Return the observations of a mask (M,), and the indices of the tracks that are in two images or more."""
        track, image, keypoint = self.track[use], self.image[use], self.keypoint[use]
        is_first = np.append(True, (np.diff(track) != 0) | (np.diff(image) != 0))[: len(track)]
        images = np.bincount(track, is_first, minlength=len(self))
        keep = images[track] >= 2
        kept, renumbered = np.unique(track[keep], return_inverse=True)
        return Tracks(renumbered, image[keep], keypoint[keep]), kept

    def divided(self, positions: NDArray[np.float64], longest: int) -> "Tracks":
        """Divide tracks of more than `longest` observations along the main axis of the positions (M, 3) of cameras."""
        starts, lengths = self.starts, np.diff(self.starts)
        if lengths.max(initial=0) <= longest:
            return self
        mean = np.add.reduceat(positions, starts[:-1]) / lengths[:, None]
        offsets = positions - mean[self.track]
        scatter = np.add.reduceat(offsets[:, :, None] * offsets[:, None, :], starts[:-1])
        axis = np.linalg.eigh(scatter)[1][:, :, -1]
        rank = np.empty(len(self.track), np.intp)
        rank[np.lexsort((np.einsum("mi,mi->m", offsets, axis[self.track]), self.track))] = np.arange(len(rank))
        pieces = -(-lengths // longest)
        piece = (rank - starts[self.track]) * pieces[self.track] // lengths[self.track]
        track = (np.cumsum(pieces) - pieces)[self.track] + piece
        order = np.lexsort((self.image, track))
        return Tracks(track[order], self.image[order], self.keypoint[order])

    def divided_where_few_are_common(self, frame: Indices, least: int) -> "Tracks":
        """Divide tracks so that any two frames (M,) of a track have at least this number of tracks in common."""
        if not len(self):
            return self
        enough = frames_with_common_points(common_points(int(frame.max()) + 1, frame, self.track), least)
        track = divided_points(frame, self.track, enough)
        if np.array_equal(track, self.track):
            return self
        order = np.lexsort((self.image, track))
        divided = Tracks(track[order], self.image[order], self.keypoint[order])
        return divided.select(np.ones(len(order), bool))[0]


def build_tracks(edges: Sequence[Edge], counts: Sequence[int]) -> Tracks:
    """Join the matches of all edges.

    A track may have several keypoints in one image: of those, triangulation selects the one that agrees best.

    Parameters
    ----------
    edges
        With indices of images and of keypoints.
    counts
        Number of keypoints of each image.
    """
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
    ends = [np.zeros((0, 2), np.intp), *(edge.pairs + offsets[[edge.a, edge.b]] for edge in edges)]
    a, b = np.concatenate(ends).T
    nodes = int(offsets[-1])
    links = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(nodes, nodes))
    label = connected_components(links, directed=False)[1]
    used = np.unique(np.concatenate([a, b]))
    order = used[np.argsort(label[used], kind="stable")]
    image = np.searchsorted(offsets, order, side="right") - 1
    every = Tracks(np.unique(label[order], return_inverse=True)[1], image, order - offsets[image])
    return every.select(np.ones(len(order), bool))[0]
