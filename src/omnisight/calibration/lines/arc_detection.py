"""Detection of smooth image arcs that may be images of straight lines."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines.line_conics import fit_circle
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.images.edges import detect_edge_chains
from omnisight.images.image_field import ImageField

Array = NDArray[np.float64]

# Edge directions are measured over this many pixels; a larger turn between two of them is a corner of the scene.
DIRECTION_STEP_PX = 6
MAX_TURN_RAD = np.radians(28.0)
# Edge pixels near a corner are biased by it.
TRIMMED_END_PX = 2
# Maximum distance of an arc from a circle. Line images in hyperbolic mirrors are not circles, but their short arcs are
# close to circles.
MAX_CIRCLE_DISTANCE_PX = 1.2
# The border of the lens or mirror is an edge itself.
BORDER_MARGIN_PX = 6.0
# Minimum arc length, as a share of the smaller image side and in px: shorter arcs have too little curvature.
MIN_ARC_SHARE, MIN_ARC_PX = 0.04, 16
# Bounds the run time on cluttered images; the longest arcs are kept.
MAX_ARCS = 400
# Two arcs of different images are the same static edge if this share of the sampled pixels coincides within this
# distance.
STATIC_SAMPLES, STATIC_DISTANCE_PX, STATIC_SHARE = 24, 1.5, 0.7


def detect_arcs(
    gray: NDArray[np.uint8], field: ImageField | None = None, mask: NDArray[np.bool_] | None = None
) -> list[Array]:
    """Detect the smooth arcs of an image.

    Edges are split at corners of the scene and at changes of curvature.

    Parameters
    ----------
    gray
        (H, W) uint8 image.
    field
        Image field of the lens or mirror; its border is excluded.
    mask
        (H, W) mask, True where lines are searched.

    Returns
    -------
    Arcs of pixels (n, 2), the longest first.
    """
    min_length = max(round(MIN_ARC_SHARE * min(gray.shape)), MIN_ARC_PX)
    chains = detect_edge_chains(gray, _search_mask(gray.shape, field, mask), min_points=min_length)
    arcs = [
        arc
        for chain in chains
        for part in _split_at_corners(chain)
        for arc in _split_at_curvature_changes(part, min_length)
    ]
    return sorted(arcs, key=len, reverse=True)[:MAX_ARCS]


def deduplicate_static_arcs(arcs: PixelChains) -> NDArray[np.intp]:
    """Match arcs that show the same static edge in several images.

    A fixed camera sees an edge of the room at the same pixels in every image, with the same systematic error, so the
    repeated arcs are not independent observations. The longest of them is kept.

    Returns
    -------
    (A,) index of the longer arc of another image that covers the same pixels, -1 for arcs to keep.
    """
    from scipy.spatial import KDTree

    duplicate_of = np.full(len(arcs), -1, np.intp)
    if len(np.unique(arcs.image_ids)) < 2:
        return duplicate_of
    order = arcs.longest_first()
    rank = np.argsort(order)
    samples, owner, tree = arcs.subsample(STATIC_SAMPLES), arcs.chain_of_pixel, KDTree(arcs.pixels)
    for arc in order:
        nearby_rows = tree.query_ball_point(samples.pixels[samples.groups[arc]], STATIC_DISTANCE_PX)
        nearby_arcs = [np.unique(owner[rows]) for rows in nearby_rows]
        others, hits = np.unique(np.concatenate(nearby_arcs), return_counts=True)
        is_candidate = (
            (duplicate_of[others] < 0) & (rank[others] < rank[arc]) & (arcs.image_ids[others] != arcs.image_ids[arc])
        )
        others, hits = others[is_candidate], hits[is_candidate]
        if len(hits) and hits.max() >= STATIC_SHARE * len(nearby_arcs):
            duplicate_of[arc] = others[np.argmax(hits)]
    return duplicate_of


def _search_mask(
    shape: tuple[int, ...], field: ImageField | None, mask: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """Return the pixels inside the mask and the image field, away from their borders."""
    import cv2

    visible = None
    if mask is not None:
        diameter = 2 * round(BORDER_MARGIN_PX) + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
        visible = np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderValue=1)) > 0
    if field is not None and field.outer is not None:
        pixels = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1)
        inside = field.outer.grown(-BORDER_MARGIN_PX).contains(pixels)
        if field.inner is not None:
            inside &= ~field.inner.grown(field.inner_fade + BORDER_MARGIN_PX).contains(pixels)
        visible = inside if visible is None else visible & inside
    return visible


def _split_at_corners(chain: Array) -> list[Array]:
    """Split a chain where its direction turns by more than `MAX_TURN_RAD`."""
    step = DIRECTION_STEP_PX
    if len(chain) < 2 * step + 3:
        return [chain]
    before = chain[step:-step] - chain[: -2 * step]
    after = chain[2 * step :] - chain[step:-step]
    turn = np.abs(np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(1)))
    is_corner = np.concatenate([np.zeros(step), turn, np.zeros(step)]) > MAX_TURN_RAD
    ends = np.flatnonzero(np.diff(np.concatenate([[True], is_corner, [True]]).astype(np.int8)))
    return [chain[start:stop] for start, stop in zip(ends[::2], ends[1::2], strict=True)]


def _split_at_curvature_changes(chain: Array, min_length: int) -> list[Array]:
    """Split a chain recursively into arcs that are close to circles; drop parts shorter than `min_length`."""
    chain = chain[TRIMMED_END_PX:-TRIMMED_END_PX]
    if len(chain) < min_length:
        return []
    distances = np.abs(fit_circle(chain, iterations=3).distance(chain))
    worst = int(np.argmax(distances))
    if distances[worst] <= MAX_CIRCLE_DISTANCE_PX:
        return [chain]
    # A maximum near an end means that the curvature changes somewhere inside: split in the middle.
    is_inside = min_length // 2 < worst < len(chain) - min_length // 2
    split = worst if is_inside else len(chain) // 2
    return [
        *_split_at_curvature_changes(chain[:split], min_length),
        *_split_at_curvature_changes(chain[split:], min_length),
    ]
