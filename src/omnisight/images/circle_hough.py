"""Candidates for a bright disc on a dark surround, by a gradient Hough transform for circles.

For each centre and radius, the transform counts the directions in which the intensity falls outwards (Kimme, Ballard
and Sklansky, CACM 18(2), 1975). It counts directions, not edge pixels, relative to the directions that lie in the
image: a long edge gets no more weight than a weak one, and a complete circle no more than one that the image border
cuts.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from omnisight.images.ellipse import Ellipse

# Longer side of the image that is searched, px: candidates are refined at full resolution.
SEARCH_SIZE_PX = 96
NUM_DIRECTIONS = 64
# Gray levels per px of the search image; smaller falls are noise.
MIN_FALL_PER_PX = 1.0
# Fraction of the directions that must agree.
MIN_VOTE_FRACTION = 0.6
MAX_CANDIDATES = 4


def circle_candidates(
    gray: NDArray[np.uint8], radius_range: tuple[float, float], aspect_ratio: float = 1.0
) -> Iterator[Ellipse]:
    """Yield candidate discs, best first, accurate to about 1 % of the image size.

    Parameters
    ----------
    gray : (H, W) array of uint8
    radius_range : (min, max) px
    aspect_ratio : float
        Width over height of the discs.
    """
    import cv2

    h, w = gray.shape
    scale = SEARCH_SIZE_PX / max(w / aspect_ratio, h)
    size = (max(8, round(w * scale / aspect_ratio)), max(8, round(h * scale)))
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    low, high = (int(radius * scale / aspect_ratio**0.5) for radius in radius_range)
    radii = np.arange(low, high + 2)
    smooth = np.asarray(cv2.GaussianBlur(small, (0, 0), 0.7), np.float32)
    score = _vote_fractions(smooth, radii)
    px = np.array([w / size[0], h / size[1]])
    for _ in range(MAX_CANDIDATES):
        k, y, x = (int(i) for i in np.unravel_index(np.argmax(score), score.shape))
        if score[k, y, x] < MIN_VOTE_FRACTION:
            return
        centre = (np.array([x, y]) + 0.5) * px - 0.5
        yield Ellipse.from_matrix(centre, np.diag(float(radii[k]) * px))
        score[max(0, k - 3) : k + 4, max(0, y - 4) : y + 5, max(0, x - 4) : x + 5] = 0


def _vote_fractions(small: NDArray[np.float32], radii: NDArray[np.int_]) -> NDArray[np.float32]:
    """Return, per radius and centre (R, H, W), the fraction of the visible directions with an outward fall."""
    import cv2

    h, w = small.shape
    gu, gv = (cv2.Sobel(small, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    # 0.85 is the cosine of 32 degrees, the largest angle between the gradient and the direction.
    threshold = np.maximum(MIN_FALL_PER_PX, 0.85 * np.hypot(gu, gv))
    directions = np.arange(NUM_DIRECTIONS) * (2 * np.pi / NUM_DIRECTIONS)
    xs, ys = (np.round(radii[:, None] * part).astype(int) for part in (np.cos(directions), np.sin(directions)))
    # Shifted by one radius, the falls of one direction vote for all centres at once.
    pad = int(radii[-1])
    falls = np.zeros((h + 2 * pad, w + 2 * pad), np.uint8)
    interior = (slice(pad + 1, -pad - 1), slice(pad + 1, -pad - 1))
    votes = np.zeros((len(radii), h, w), np.uint8)
    for d, angle in enumerate(directions):
        falls[interior] = (-(gu * np.cos(angle) + gv * np.sin(angle)) > threshold)[1:-1, 1:-1]
        for k, (x, y) in enumerate(zip(xs[:, d] + pad, ys[:, d] + pad, strict=True)):
            votes[k] += falls[y : y + h, x : x + w]
    # A direction is visible if both of its coordinates lie in the image; the matrix product counts directions.
    columns, rows = (((at := np.arange(n) + shift[..., None]) > 0) & (at < n - 1) for n, shift in ((w, xs), (h, ys)))
    visible = rows.astype(np.float32).transpose(0, 2, 1) @ columns.astype(np.float32)
    # The constant penalizes few visible directions, which agree by chance.
    return np.asarray(votes / (visible + NUM_DIRECTIONS / 8), np.float32)
