"""Keypoints of images, pairs of similar images and relative poses, which a work folder keeps."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.formats.native import to_json
from omnisight.geometry.pose import Pose
from omnisight.images.colors import colors_at
from omnisight.pipeline.inputs.work_folder import Arrays, WorkFolder, digest
from omnisight.places import similar_pairs
from omnisight.progress import StageProgress
from omnisight.sfm.view_graph import Edge, ViewGraph, match_pairs

Bytes = NDArray[np.uint8]

KEYPOINT_ARRAYS = tuple(field.name for field in fields(Keypoints))
# Pairs in one file: what an interruption loses takes a few seconds.
BATCH = 64


def detect(
    work: WorkFolder,
    image: NDArray[Any],
    camera: Camera,
    options: FeatureOptions,
    mask: NDArray[np.bool_] | None,
) -> tuple[Keypoints, Bytes]:
    """Return the keypoints of an image and their colours (K, 3), RGB."""
    key = f"keypoints-{digest(image, to_json(camera), options, mask)}"
    return from_detected_arrays(work.arrays(key, lambda: detected_arrays(image, camera, options, mask)))


def detected_arrays(
    image: NDArray[Any], camera: Camera, options: FeatureOptions, mask: NDArray[np.bool_] | None
) -> Arrays:
    """Detect keypoints; return them and their colours as arrays that can be stored."""
    keypoints = detect_features(image, camera, options, mask=mask)
    arrays = {name: getattr(keypoints, name) for name in KEYPOINT_ARRAYS}
    return {**arrays, "colors": colors_at(image, keypoints.pixels)}


def from_detected_arrays(arrays: Arrays) -> tuple[Keypoints, Bytes]:
    """Return the keypoints and colours of stored arrays."""
    return Keypoints(**{name: arrays[name] for name in KEYPOINT_ARRAYS}), arrays["colors"]


def similar(
    work: WorkFolder, keypoints: Sequence[Keypoints], neighbours: int, progress: StageProgress
) -> list[tuple[int, int]]:
    """Return the pairs of each image with the most similar ones; see `similar_pairs`."""

    def compute() -> Arrays:
        return {"pairs": np.array(similar_pairs(keypoints, neighbours, progress), np.int64).reshape(-1, 2)}

    key = digest(neighbours, [each.descriptors for each in keypoints])
    return [(a, b) for a, b in work.arrays(f"similar-{key}", compute)["pairs"].tolist()]


def match(
    work: WorkFolder,
    keypoints: Sequence[Keypoints],
    pairs: Sequence[tuple[int, int]],
    progress: StageProgress,
    known: Callable[[int, int], Pose | None],
) -> ViewGraph:
    """Match pairs of images and estimate their relative poses; see `match_pairs`."""
    contents = [digest(*(getattr(each, name) for name in KEYPOINT_ARRAYS)) for each in keypoints]
    edges = list[Edge]()
    for first in range(0, len(pairs), BATCH):
        batch = pairs[first : first + BATCH]
        poses = [None if (pose := known(a, b)) is None else pose.matrix.tolist() for a, b in batch]
        key = digest(batch, [(contents[a], contents[b]) for a, b in batch], poses)

        def compute(first: int = first, batch: Sequence[tuple[int, int]] = batch) -> Arrays:
            found = match_pairs(keypoints, batch, lambda done, _: progress(first + done, len(pairs)), known)
            return _to_arrays(found.edges)

        edges += _to_edges(work.arrays(f"pairs-{key}", compute))
        progress(first + len(batch), len(pairs))
    return ViewGraph(edges, list(pairs))


def _to_arrays(edges: Sequence[Edge]) -> Arrays:
    return {
        "images": np.array([(edge.a, edge.b) for edge in edges], np.int64).reshape(-1, 2),
        "b_from_a": np.array([edge.b_from_a.matrix for edge in edges]).reshape(-1, 3, 4),
        "covariance": np.array([edge.covariance for edge in edges]).reshape(-1, 6, 6),
        "motion": np.array([edge.motion for edge in edges], "U40"),
        "starts": np.cumsum([0, *(len(edge.pairs) for edge in edges)]),
        "pairs": np.concatenate([np.zeros((0, 2), np.int64), *(edge.pairs for edge in edges)]),
    }


def _to_edges(arrays: Arrays) -> list[Edge]:
    starts, pairs = arrays["starts"], arrays["pairs"]
    return [
        Edge(int(a), int(b), Pose.of_matrix(pose), covariance, str(motion), pairs[starts[e] : starts[e + 1]])
        for e, ((a, b), pose, covariance, motion) in enumerate(
            zip(*(arrays[name] for name in ("images", "b_from_a", "covariance", "motion")), strict=True)
        )
    ]
