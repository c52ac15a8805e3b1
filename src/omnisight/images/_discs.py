"""Guesses where a picture may show a bright disc before a dark surround.

For every centre and radius it is counted in how many directions the picture falls from bright to dark there. That is
the Hough transform for circles by gradients (Kimme, Ballard and Sklansky, CACM 18(2), 1975), but counted by direction
and against the directions that the picture shows, so that a long edge is not worth more than a faint one, nor a
whole circle more than one that the picture cuts.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .ellipse import Ellipse

_COARSE = 96  # px along the longer side of what is looked at
_DIRECTIONS = 64
_FALL = 1.0  # gray levels per coarse pixel; less is noise
_PROMISING = 0.6  # of the directions
_CANDIDATES = 4


def likely_discs(picture: NDArray[np.uint8], radii: tuple[float, float], stretch: float = 1.0) -> Iterator[Ellipse]:
    """Give likely discs, best first, to a hundredth of the picture.

    Parameters
    ----------
    picture : (H, W) array of uint8
    radii : (least, most) px
    stretch : float
        Width over height of what is looked for.
    """
    import cv2

    h, w = picture.shape
    scale = _COARSE / max(w / stretch, h)
    size = (max(8, round(w * scale / stretch)), max(8, round(h * scale)))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), 0.7)
    gu, gv = (cv2.Sobel(small, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    steep = np.maximum(_FALL, 0.85 * np.hypot(gu, gv))  # 0.85: within 32 degrees of the direction
    tried = np.arange(int(radii[0] * scale / stretch**0.5), int(radii[1] * scale / stretch**0.5) + 2)
    turn = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    xs, ys = (np.round(tried[:, None] * along).astype(int) for along in (np.cos(turn), np.sin(turn)))
    # Shifted by a radius, the falls in one direction vote for all centres at once.
    pad = int(tried[-1])
    falls = np.zeros((size[1] + 2 * pad, size[0] + 2 * pad), np.uint8)
    shown = (slice(pad + 1, -pad - 1), slice(pad + 1, -pad - 1))
    votes = np.zeros((len(tried), size[1], size[0]), np.uint8)
    for d, angle in enumerate(turn):
        falls[shown] = (-(gu * np.cos(angle) + gv * np.sin(angle)) > steep)[1:-1, 1:-1]
        for k, (x, y) in enumerate(zip(xs[:, d] + pad, ys[:, d] + pad, strict=True)):
            votes[k] += falls[y : y + size[1], x : x + size[0]]
    # The picture shows a direction of a circle where both coordinates lie in it; the product counts directions.
    columns, rows = (
        ((at := np.arange(n) + shift[..., None]) > 0) & (at < n - 1) for n, shift in zip(size, (xs, ys), strict=True)
    )
    seen = rows.astype(np.float32).transpose(0, 2, 1) @ columns.astype(np.float32)
    share = votes / (seen + _DIRECTIONS / 8)  # few directions agree by chance
    px = np.array([w / size[0], h / size[1]])
    for _ in range(_CANDIDATES):
        k, y, x = (int(i) for i in np.unravel_index(np.argmax(share), share.shape))
        if share[k, y, x] < _PROMISING:
            return
        centre = (np.array([x, y]) + 0.5) * px - 0.5
        yield Ellipse.from_matrix(centre, np.diag(float(tried[k]) * px))
        share[max(0, k - 3) : k + 4, max(0, y - 4) : y + 5, max(0, x - 4) : x + 5] = 0
