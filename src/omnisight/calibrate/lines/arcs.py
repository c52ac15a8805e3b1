"""From the edges of a picture to arcs that may be images of lines."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.lines.circles import fit_circle
from omnisight.images.edges import edge_chains
from omnisight.images.field import ImageField

Array = NDArray[np.float64]

# Points to both sides between which a chain's direction is taken, and the turn (radians) that is a corner.
STRIDE = 6
CORNER = np.radians(28.0)
# px that an arc may lie off a circle: lines in a hyperbolic mirror are no circles, but near enough piece by piece.
OFF = 1.2
# Ends that a corner nearby has bent.
TRIMMED = 2
# px to stay away from where the lens or mirror ends, and the share of the picture's height that an arc has at least.
MARGIN = 6.0
LEAST_SHARE = 0.04
MOST = 400


def find_arcs(
    gray: NDArray[np.uint8], field: ImageField | None = None, mask: NDArray[np.bool_] | None = None
) -> list[Array]:
    """Trace the smooth arcs of a picture.

    Parameters
    ----------
    gray
        (H, W) uint8.
    field
        Where the lens or mirror shows anything: its border is an edge, but not of the scene.
    mask
        (H, W), True where lines may be looked for.

    Returns
    -------
    Arcs of pixels (n, 2), the longest first: edges cut at corners, and where their curvature breaks.
    """
    least = max(round(LEAST_SHARE * min(gray.shape)), 16)
    chains = edge_chains(gray, _visible(gray.shape, field, mask), least_length=least)
    arcs = [arc for chain in chains for part in _without_corners(chain) for arc in _smooth(part, least)]
    return sorted(arcs, key=len, reverse=True)[:MOST]


def _visible(
    shape: tuple[int, ...], field: ImageField | None, mask: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    import cv2

    visible = None
    if mask is not None:
        reach = 2 * round(MARGIN) + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        visible = np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderValue=1)) > 0
    if field is not None and field.outer is not None:
        pixels = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1)
        inside = field.outer.grown(-MARGIN).contains(pixels)
        if field.inner is not None:
            inside &= ~field.inner.grown(field.inner_fade + MARGIN).contains(pixels)
        visible = inside if visible is None else visible & inside
    return visible


def _without_corners(chain: Array) -> list[Array]:
    """Cut a chain where it turns by more than `CORNER` within two strides."""
    if len(chain) < 2 * STRIDE + 3:
        return [chain]
    before = chain[STRIDE:-STRIDE] - chain[: -2 * STRIDE]
    after = chain[2 * STRIDE :] - chain[STRIDE:-STRIDE]
    turn = np.abs(np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(1)))
    sharp = np.concatenate([np.zeros(STRIDE), turn, np.zeros(STRIDE)]) > CORNER
    ends = np.flatnonzero(np.diff(np.concatenate([[True], sharp, [True]]).astype(np.int8)))
    return [chain[start:stop] for start, stop in zip(ends[::2], ends[1::2], strict=True)]


def _smooth(chain: Array, least: int) -> list[Array]:
    """Cut a chain into arcs, each near a circle; what is shorter than `least` is dropped."""
    chain = chain[TRIMMED:-TRIMMED]
    if len(chain) < least:
        return []
    off = np.abs(fit_circle(chain, iterations=3).distance(chain))
    worst = int(np.argmax(off))
    if off[worst] <= OFF:
        return [chain]
    # At an end the misfit says that the curvature breaks somewhere inside.
    at = worst if least // 2 < worst < len(chain) - least // 2 else len(chain) // 2
    return [*_smooth(chain[:at], least), *_smooth(chain[at:], least)]
