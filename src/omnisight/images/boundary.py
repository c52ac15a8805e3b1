"""Detection of the elliptic boundary of the image circle, and of the central obstruction of a mirror.

An ellipse is fitted to the steepest intensity fall along each ray from its centre. The fit is accepted as the boundary
of a lens or mirror if it is visible in most directions, its dark side is uniform and the fall is abrupt. Vignetting
falls gradually, and objects in the scene do not surround the image.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images.circle_hough import circle_candidates
from omnisight.images.ellipse import Ellipse

Floats = NDArray[np.floating[Any]]

# Width over height of the boundaries searched for, in order: some images were resized to another aspect ratio.
ASPECT_RATIOS = (1.0, 1.3, 1 / 1.3)
# Rays along which the boundary is sampled: one per degree.
NUM_RAYS = 360
# Half-widths of the search band as fractions of the radius, one per fit; the first fit estimates centre and size only.
SEARCH_BANDS = (0.10, 0.06, 0.03, 0.03)
# The inner boundary is visible in all directions; 1 % allows for rounding.
MIN_INNER_VISIBLE = 0.99


@dataclass(frozen=True)
class Boundary:
    """A boundary with its evidence. Intensities are medians over the directions that lie in the image.

    Attributes
    ----------
    ellipse
        The boundary.
    visible
        Fraction of all directions in which the boundary lies in the image.
    supported
        Fraction of the visible directions in which the intensity falls at the boundary.
    darker
        Fraction of the visible directions in which the far side is darker.
    max_gap
        Longest angular interval without support, radians.
    bright_level
        Intensity of the bright side.
    contrast, wide_contrast
        Intensity difference between the two sides, measured near the boundary and farther away.
    dark_variation
        Range of the dark side's intensity along the boundary, 10th to 90th percentile.
    fade_px
        Distance from the boundary to 80 % of the fall, as reached in 75 % of the directions.
    """

    ellipse: Ellipse
    visible: float
    supported: float
    darker: float
    max_gap: float
    bright_level: float
    contrast: float
    wide_contrast: float
    dark_variation: float
    fade_px: float

    @property
    def score(self) -> float:
        """Rank of the boundary: high if supported in many directions, with a uniform dark side."""
        uniformity = self.contrast / (self.contrast + self.dark_variation)
        return self.supported * self.visible / (self.visible + 0.1) * uniformity

    def is_plausible(self, min_supported: float, min_darker: float) -> bool:
        """Return whether this is the boundary of a lens or mirror, not an object in the scene or vignetting."""
        major, minor = self.ellipse.axes
        return (
            self.visible > 0.12
            and self.supported > min_supported
            and self.darker > min_darker
            # A boundary that is not a circle needs more evidence.
            and (major < 1.06 * minor or (self.visible > 0.5 and self.supported > 0.9))
            # A gap above 150 degrees would accept a single dark corner.
            and self.max_gap < np.deg2rad(150)
            and self.contrast > max(6.0, 0.25 * self.bright_level, 0.6 * self.dark_variation)
            # Vignetting falls gradually: its near contrast is about a third of its wide contrast.
            and self.contrast > 0.45 * self.wide_contrast
        )


def detect_outer_boundary(gray: NDArray[np.uint8], radius_range: tuple[float, float]) -> Boundary | None:
    """Return the best boundary of a bright disc on a dark surround, or None; `radius_range` is (min, max), px."""
    for aspect_ratio in ASPECT_RATIOS:
        fits = [_fit_ellipse(gray, start) for start in circle_candidates(gray, radius_range, aspect_ratio)]
        boundaries = [_measure(gray, ellipse) for ellipse in fits if ellipse is not None]
        plausible = [boundary for boundary in boundaries if boundary.is_plausible(0.55, 0.93)]
        if plausible:
            return max(plausible, key=lambda boundary: boundary.score)
    return None


def detect_inner_boundary(gray: NDArray[np.uint8], outer: Ellipse) -> Boundary | None:
    """Return the boundary of a dark disc concentric with a mirror's outer boundary, or None."""
    import cv2

    # The obstruction shares its centre with the outer boundary, unlike dark objects in the scene. Only the radius is
    # searched for, and parts of the boundary may be hidden by dark objects.
    levels = np.linspace(0.06, 0.54, 193)
    _, profile, _ = _unwrap(gray, outer, levels)
    rise = np.gradient(cv2.GaussianBlur(profile, (0, 0), 1.5), axis=1)
    # The centres may differ by 3 % of the radius, so each ray votes for that range of radii, with a capped weight.
    votes = cv2.dilate(np.clip(rise, 0, 4), np.ones((1, 13), np.uint8)).mean(axis=0)
    boundaries: list[Boundary] = []
    for _ in range(3):
        level = levels[np.argmax(votes)]
        votes[np.abs(levels - level) < 0.04] = 0
        start = replace(outer, axes=(level * outer.axes[0], level * outer.axes[1]))
        ellipse = _fit_ellipse(gray, start, -1.0, num_terms=3)
        if ellipse is not None and outer.level(ellipse.centre) < 0.03:
            boundaries.append(_measure(gray, ellipse, -1.0))
    plausible = [b for b in boundaries if b.visible > MIN_INNER_VISIBLE and b.is_plausible(0.65, 0.7)]
    return max(plausible, key=lambda boundary: boundary.score, default=None)


def _fit_ellipse(gray: NDArray[np.uint8], start: Ellipse, dark_side: float = 1.0, num_terms: int = 5) -> Ellipse | None:
    """Fit an ellipse to the steepest falls in a narrowing band around it, or return None if it diverges.

    `dark_side` is 1 if the outside is dark and -1 if the inside is. With 3 terms the shape is fixed, with 5 it is
    estimated.
    """
    ellipse = start
    for i, fraction in enumerate(SEARCH_BANDS):
        band, terms = max(fraction, 4 / start.radius), num_terms if i else 3
        t, offset, fall, visible = _steepest_falls(gray, ellipse, band, dark_side)
        basis = np.stack([np.ones_like(t), np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t)], axis=-1)[:, :terms]
        # Every clear fall gets about the same weight, however high its contrast.
        weight = visible * fall / (fall + 1)
        step = _robust_solution(basis, offset, weight, fraction / 3, 0.5 / start.radius)
        # In the frame where the ellipse is the unit circle: scale, shift, and stretch along two axes.
        scale, du, dv, along, across = np.append(step, np.zeros(5 - terms))
        change = np.array([[1 + scale + along, across], [across, 1 + scale - along]])
        ellipse = Ellipse.from_matrix(ellipse.centre + ellipse.matrix @ (du, dv), ellipse.matrix @ change)
        if not 0.7 < ellipse.radius / start.radius < 1.4:
            return None
    return ellipse


def _robust_solution(basis: Floats, offset: Floats, weight: Floats, width: float, min_width: float) -> Floats:
    """Return the weighted least-squares solution with Cauchy weights of a width that shrinks to `min_width`."""
    count, terms = basis.shape
    # The prior on the shape terms keeps them at zero where few directions are visible.
    prior = np.diag([1e-9, 1e-9, 1e-9, 1e-3 * count, 1e-3 * count][:terms])
    step = np.zeros(terms)
    for _ in range(12):
        robust = weight / (1 + ((offset - basis @ step) / width) ** 2)
        step = np.linalg.solve(basis.T @ (robust[:, None] * basis) + prior, basis.T @ (robust * offset))
        width = max(0.7 * width, min_width)
    return step


def _steepest_falls(
    gray: NDArray[np.uint8], ellipse: Ellipse, band: float, dark_side: float
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """Return per ray: angle, relative offset of the steepest fall from the ellipse, slope per px, visibility."""
    import cv2

    px = 1 / ellipse.radius
    blur = max(1.0, min(0.1 * band, 0.004) / px)
    offsets = np.arange(-band, band + px, px)
    t, profile, inside = _unwrap(gray, ellipse, 1 + dark_side * offsets)
    profile = np.asarray(cv2.GaussianBlur(profile, (0, 0), sigmaX=blur, sigmaY=1.5), np.float32)
    fall = np.zeros_like(profile)
    fall[:, 1:-1] = np.maximum(profile[:, :-2] - profile[:, 2:], 0) / 2
    fall[~inside] = 0
    rays = np.arange(len(t))
    k = np.argmax(fall[:, 1:-1] * np.exp(-0.5 * (offsets[1:-1] / (0.6 * band)) ** 2), axis=1) + 1
    before, peak, after = fall[rays, k - 1], fall[rays, k], fall[rays, k + 1]
    # Vertex of the parabola through three samples.
    curvature = np.minimum(before - 2 * peak + after, -1e-6)
    subpixel = np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)
    return t, dark_side * (offsets[k] + subpixel * px), peak, np.asarray(inside.all(axis=1))


def _unwrap(
    gray: NDArray[np.uint8], ellipse: Ellipse, levels: Floats
) -> tuple[Floats, NDArray[np.float32], NDArray[np.bool_]]:
    """Sample the image along rays: angles (n,), intensities (n, levels), and which samples lie in the image."""
    import cv2

    t = np.arange(NUM_RAYS) * (2 * np.pi / NUM_RAYS)
    rays = np.stack([np.cos(t), np.sin(t)], axis=-1) @ ellipse.matrix.T
    pixels = (ellipse.centre + levels[:, None] * rays[:, None]).astype(np.float32)
    profile = cv2.remap(gray, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = np.asarray(((pixels >= 0) & (pixels <= np.array(gray.shape[::-1]) - 1)).all(axis=-1))
    return t, profile.astype(np.float32), inside


def _measure(gray: NDArray[np.uint8], ellipse: Ellipse, dark_side: float = 1.0) -> Boundary:
    """Measure the evidence for a boundary."""
    t, offset, fall, visible = _steepest_falls(gray, ellipse, max(0.08, 6 / ellipse.radius), dark_side)
    supported = np.flatnonzero(visible & (np.abs(offset) < max(0.01, 1.5 / ellipse.radius)) & (fall > 0.3))
    angles = np.append(t[supported], t[supported[:1]] + 2 * np.pi)
    distance = np.arange(-28, 29) * 0.005
    # The blur of a few pixels takes a larger fraction of a small ellipse.
    stretch = max(1.0, 100 / ellipse.radius)
    _, profile, _ = _unwrap(gray, ellipse, 1 + dark_side * stretch * distance)
    profile = profile[visible] if visible.any() else profile
    bands = ((-0.06, -0.015), (0.015, 0.06), (-0.15, -0.10), (0.10, 0.15))
    bright, dark, far_bright, far_dark = (
        profile[:, (distance > low) & (distance < high)].mean(axis=1) for low, high in bands
    )
    contrast = bright - dark
    beyond = profile[:, distance >= 0]
    floor = beyond.min(axis=1, keepdims=True)
    faded = np.argmax(beyond <= floor + 0.2 * (bright[:, None] - floor), axis=1)
    return Boundary(
        ellipse,
        visible=float(visible.mean()),
        supported=len(supported) / max(1, int(visible.sum())),
        darker=float(np.mean(contrast > 2)),
        max_gap=float(np.diff(angles).max()) if len(supported) else 2 * np.pi,
        bright_level=float(np.median(bright)),
        contrast=float(np.median(contrast)),
        wide_contrast=float(np.median(far_bright - far_dark)),
        dark_variation=float(np.diff(np.percentile(dark, (10, 90)))[0]),
        fade_px=float(np.percentile(distance[distance >= 0][faded], 75)) * stretch * ellipse.radius,
    )
