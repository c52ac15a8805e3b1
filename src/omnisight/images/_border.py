"""Finds a round border in a picture: bright on one side, dark and quiet on the other.

An ellipse is fitted to the steepest fall along each ray from its centre, and then judged: a border is seen in most
directions, the dark side is the same all along, and the fall is sudden. Vignetting is not, and nothing in a scene
goes round the whole picture like that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._discs import likely_discs
from .ellipse import Ellipse

_Floats: TypeAlias = NDArray[np.floating[Any]]

_STRETCHES = (1.0, 1.3, 1 / 1.3)  # width over height: pictures are squeezed to another shape now and then
_RAYS = 360


@dataclass(frozen=True)
class Border:
    """A border with the evidence for it; all gray levels are medians over the directions that the picture shows."""

    ellipse: Ellipse
    seen: float  # share of all directions in which the border lies in the picture
    support: float  # share of these in which the picture falls to dark right there
    falling: float  # share of these in which it is darker beyond
    gap: float  # longest run of directions without support, radians
    bright: float  # gray level on the bright side
    jump: float  # gray levels between the two sides
    wide: float  # the same, measured from farther away
    unrest: float  # gray levels (10th to 90th percentile) by which the dark side varies along the border
    fade: float  # px beyond the border until four fifths of the fall are done, in three quarters of the directions

    @property
    def score(self) -> float:
        """Rank borders: supported in many directions, with a dark side that is the same everywhere."""
        return self.support * self.seen / (self.seen + 0.1) * self.jump / (self.jump + self.unrest)

    def holds(self, support: float, falling: float) -> bool:
        """Tell a lens' or a mirror's border from a thing in the scene and from vignetting."""
        a, b = self.ellipse.axes
        return (
            self.seen > 0.12
            and self.support > support
            and self.falling > falling
            and (a < 1.06 * b or (self.seen > 0.5 and self.support > 0.9))  # what is no circle has to be plain
            and self.gap < np.deg2rad(150)  # the border embraces its centre, or a dark corner would do
            and self.jump > max(6.0, 0.25 * self.bright, 0.6 * self.unrest)
            and self.jump > 0.45 * self.wide  # vignetting falls on and on, by a third here
        )


def find_border(picture: NDArray[np.uint8], radii: tuple[float, float]) -> Border | None:
    """Find the clearest border of a bright disc before a dark surround, or None; `radii` (least, most) in px."""
    for stretch in _STRETCHES:
        fits = [_fit(picture, start) for start in likely_discs(picture, radii, stretch)]
        borders = [_judge(picture, ellipse) for ellipse in fits if ellipse is not None]
        held = [border for border in borders if border.holds(0.55, 0.93)]
        if held:
            return max(held, key=lambda border: border.score)
    return None


def find_hole(picture: NDArray[np.uint8], rim: Ellipse) -> Border | None:
    """Find the border of a dark disc in the middle of a mirror's rim, or None."""
    import cv2

    # A hole shares its centre with the rim, as a dark thing in the scene would by chance only: radii are all there
    # is to try, and part of the border may be lost beside dark things.
    levels = np.linspace(0.06, 0.54, 193)
    _, gray, _ = _unroll(picture, rim, levels)
    rise = np.gradient(cv2.GaussianBlur(gray, (0, 0), 1.5), axis=1)
    # A ray counts for radii within 3 % of the rim's, as the centres may differ so much; a dark edge counts full.
    clear = cv2.dilate(np.clip(rise, 0, 4), np.ones((1, 13), np.uint8)).mean(axis=0)
    holes: list[Border] = []
    for _ in range(3):
        level = levels[np.argmax(clear)]
        clear[np.abs(levels - level) < 0.04] = 0
        start = replace(rim, axes=(level * rim.axes[0], level * rim.axes[1]))
        hole = _fit(picture, start, -1.0, free=3)
        if hole is not None and rim.level(hole.centre) < 0.03:
            holes.append(_judge(picture, hole, -1.0))
    held = [hole for hole in holes if hole.seen > 0.99 and hole.holds(0.65, 0.7)]
    return max(held, key=lambda border: border.score, default=None)


def _fit(picture: NDArray[np.uint8], start: Ellipse, dark: float = 1.0, free: int = 5) -> Ellipse | None:
    """Fit an ellipse to the steepest falls, in a band around it that narrows.

    `dark` is 1 where the dark side lies outside, -1 inside; with 3 free terms the shape stays, with 5 it is fitted.
    """
    ellipse = start
    for band, terms in ((0.10, 3), (0.06, free), (0.03, free), (0.03, free)):
        t, out, fall, seen = _steepest(picture, ellipse, max(band, 4 / start.radius), dark)
        basis = np.stack([np.ones_like(t), np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t)], axis=-1)[:, :terms]
        weight = seen * fall / (fall + 1)  # gray levels per px: any clear fall is worth the same
        width, step = band / 3, np.zeros(terms)
        for _ in range(12):  # Cauchy weights whose width shrinks to half a pixel
            robust = weight / (1 + ((out - basis @ step) / width) ** 2)
            normal = basis.T @ (robust[:, None] * basis)
            # Where little is seen, the shape stays what it was.
            normal += np.diag([1e-9, 1e-9, 1e-9, 1e-3 * len(t), 1e-3 * len(t)][:terms])
            step = np.linalg.solve(normal, basis.T @ (robust * out))
            width = max(0.7 * width, 0.5 / start.radius)
        # In the frame where the ellipse is the unit circle: grown, shifted, and stretched along an axis.
        grow, du, dv, along, across = np.append(step, np.zeros(5 - terms))
        change = np.array([[1 + grow + along, across], [across, 1 + grow - along]])
        ellipse = Ellipse.from_matrix(ellipse.centre + ellipse.matrix @ (du, dv), ellipse.matrix @ change)
        if not 0.7 < ellipse.radius / start.radius < 1.4:
            return None
    return ellipse


def _steepest(
    picture: NDArray[np.uint8], ellipse: Ellipse, band: float, dark: float
) -> tuple[_Floats, _Floats, _Floats, NDArray[np.bool_]]:
    """Give per ray: its angle, how far out the steepest fall lies (0 on the border), levels/px, whether seen."""
    import cv2

    px = 1 / ellipse.radius
    blur = max(1.0, min(0.1 * band, 0.004) / px)
    towards = np.arange(-band, band + px, px)
    t, gray, inside = _unroll(picture, ellipse, 1 + dark * towards)
    gray = np.asarray(cv2.GaussianBlur(gray, (0, 0), sigmaX=blur, sigmaY=1.5), np.float32)
    fall = np.zeros_like(gray)
    fall[:, 1:-1] = np.maximum(gray[:, :-2] - gray[:, 2:], 0) / 2
    fall[~inside] = 0
    rays = np.arange(len(t))
    k = np.argmax(fall[:, 1:-1] * np.exp(-0.5 * (towards[1:-1] / (0.6 * band)) ** 2), axis=1) + 1
    before, at, after = fall[rays, k - 1], fall[rays, k], fall[rays, k + 1]
    bend = np.minimum(before - 2 * at + after, -1e-6)
    finer = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)  # the top of a parabola through three samples
    return t, dark * (towards[k] + finer * px), at, np.asarray(inside.all(axis=1))


def _unroll(
    picture: NDArray[np.uint8], ellipse: Ellipse, levels: _Floats
) -> tuple[_Floats, NDArray[np.float32], NDArray[np.bool_]]:
    """Sample along rays: angles (n,), gray levels (n, levels), and which of them lie in the picture."""
    import cv2

    t = np.arange(_RAYS) * (2 * np.pi / _RAYS)
    rays = np.stack([np.cos(t), np.sin(t)], axis=-1) @ ellipse.matrix.T
    pixels = (ellipse.centre + levels[:, None] * rays[:, None]).astype(np.float32)
    gray = cv2.remap(picture, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = np.asarray(((pixels >= 0) & (pixels <= np.array(picture.shape[::-1]) - 1)).all(axis=-1))
    return t, gray.astype(np.float32), inside


def _judge(picture: NDArray[np.uint8], ellipse: Ellipse, dark: float = 1.0) -> Border:
    """Gather the evidence for a border."""
    t, out, fall, near = _steepest(picture, ellipse, max(0.08, 6 / ellipse.radius), dark)
    supported = np.flatnonzero(near & (np.abs(out) < max(0.01, 1.5 / ellipse.radius)) & (fall > 0.3))
    turn = np.append(t[supported], t[supported[:1]] + 2 * np.pi)
    away = np.arange(-28, 29) * 0.005
    blurred = max(1.0, 100 / ellipse.radius)  # of small ones a larger share is taken up by a rim of some pixels
    _, gray, _ = _unroll(picture, ellipse, 1 + dark * blurred * away)
    gray = gray[near] if near.any() else gray
    bands = ((-0.06, -0.015), (0.015, 0.06), (-0.15, -0.10), (0.10, 0.15))
    sides = [gray[:, (away > low) & (away < high)].mean(axis=1) for low, high in bands]
    jump = sides[0] - sides[1]
    beyond = gray[:, away >= 0]
    floor = beyond.min(axis=1, keepdims=True)
    done = np.argmax(beyond <= floor + 0.2 * (sides[0][:, None] - floor), axis=1)
    fade = float(np.percentile(away[away >= 0][done], 75)) * blurred
    return Border(
        ellipse,
        seen=float(near.mean()),
        support=len(supported) / max(1, int(near.sum())),
        falling=float(np.mean(jump > 2)),
        gap=float(np.diff(turn).max()) if len(supported) else 2 * np.pi,
        bright=float(np.median(sides[0])),
        jump=float(np.median(jump)),
        wide=float(np.median(sides[2] - sides[3])),
        unrest=float(np.diff(np.percentile(sides[1], (10, 90)))[0]),
        fade=fade * ellipse.radius,
    )
