"""Draws the faces of a furnished room; each is a picture of so many pixels per metre, as seen from inside."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.simulate import decor
from omnisight.simulate.decor import PIXELS_PER_METRE

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
Colour = tuple[int, int, int]

SEED = 20


@cache
def furnish(width: float, height: float, depth: float) -> dict[str, Bytes]:
    """Draw all six faces of a room of that size, metres; the same at every call."""
    rng = np.random.default_rng(SEED)
    front = wall(rng, width, height, (150, 172, 176))
    decor.poster(front, (0.62, 0.45, 0.95, 1.25))
    decor.landscape(front, (2.05, 0.55, 1.5, 0.95), rng)
    decor.abstract(front, (4.05, 0.5, 0.75, 0.75))
    decor.sideboard(front, (1.95, 1.82, 1.7, 0.68), rng)
    right = wall(rng, depth, height, (222, 210, 184))
    decor.window(right, (0.7, 0.42, 1.9, 1.32), rng)
    decor.shelves(right, (3.35, 0.25, 1.35, 2.25), rng)
    back = wall(rng, width, height, (188, 132, 104))
    decor.door(back, (0.75, 0.5, 0.95, 2.1))
    decor.abstract(back, (2.5, 0.55, 0.8, 1.0))
    decor.landscape(back, (3.75, 0.6, 1.2, 0.8), rng)
    left = wall(rng, depth, height, (214, 196, 140))
    decor.shelves(left, (0.45, 0.25, 1.7, 2.25), rng)
    decor.stripes(left, (2.75, 0.5, 1.0, 1.3))
    decor.sideboard(left, (2.6, 1.9, 1.9, 0.6), rng)
    floor = planks(rng, width, depth)
    decor.rug(floor, (1.55, 1.5, 2.3, 1.9))
    ceiling = wall(rng, width, depth, (232, 230, 224), skirting=False)
    for u in (0.28, 0.72):
        for v in (0.3, 0.7):
            decor.lamp(ceiling, (u * width, v * depth), 0.2)
    drawn = {"front": front, "right": right, "back": back, "left": left, "floor": floor, "ceiling": ceiling}
    return {name: lit(picture, name) for name, picture in drawn.items()}


def wall(rng: np.random.Generator, width: float, height: float, colour: Colour, *, skirting: bool = True) -> Bytes:
    """Draw plaster of one colour."""
    shape = (px(height), px(width))
    picture = np.array(colour, np.float32) + cloud(rng, shape, px(0.4), 2.5)[..., None]
    picture += cloud(rng, shape, 2, 1.2)[..., None]
    if skirting:
        picture[-px(0.1) :] = (238, 236, 230)
        picture[-px(0.1) : -px(0.09)] = (170, 168, 160)
    return np.clip(picture, 0, 255).astype(np.uint8)


def planks(rng: np.random.Generator, width: float, depth: float) -> Bytes:
    """Draw a wooden floor: planks of their own tone, with grain and dark seams."""
    rows, columns, across = px(depth), px(width), px(0.14)
    grain = cloud(rng, (rows, columns), (1.2, 40), 5.0) + cloud(rng, (rows, columns), (3, 150), 4.0)
    tone = np.zeros((rows, columns), np.float32)
    for top in range(0, rows, across):
        start = -int(rng.integers(0, px(1.2)))
        while start < columns:
            end = start + int(rng.integers(px(0.8), px(1.6)))
            tone[top : top + across, max(start, 0) : end] = rng.normal(0, 9)
            tone[top : top + across, max(end - 2, 0) : max(end, 0)] = -45
            start = end
        tone[top : top + 2] = -45
    oak = np.array((168, 122, 80), np.float32) + (grain + tone)[..., None] * np.array((1, 0.9, 0.75), np.float32)
    return np.clip(oak, 0, 255).astype(np.uint8)


def lit(picture: Bytes, face: str) -> Bytes:
    """Darken a face towards its edges, as light from the middle of a room does, and upright ones towards the floor."""
    rows, columns = picture.shape[:2]
    v, u = (np.arange(rows, dtype=np.float32) + 0.5)[:, None], (np.arange(columns, dtype=np.float32) + 0.5)[None]
    near = PIXELS_PER_METRE * 0.35
    shade = np.ones((rows, columns), np.float32)
    for gap in (u, columns - u, v, rows - v):
        shade *= 1 - 0.22 * np.exp(-gap / near)
    if face not in ("floor", "ceiling"):
        shade *= 1.06 - 0.2 * v / rows
    return np.clip(picture * shade[..., None], 0, 255).astype(np.uint8)


def cloud(rng: np.random.Generator, shape: tuple[int, int], size: Any, amount: float) -> Floats:
    """Make smooth noise of a standard deviation; `size` is its blur in px, or one per axis (down, across)."""
    import cv2

    down, across = size if isinstance(size, tuple) else (size, size)
    # Coarse noise, enlarged: a blur that wide would be slow.
    coarse = (max(shape[0] // max(int(down), 1), 2), max(shape[1] // max(int(across), 1), 2))
    noise = rng.normal(0, amount, coarse).astype(np.float32)
    return np.asarray(cv2.resize(noise, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC), np.float32)


def px(metres: float) -> int:
    """Give a length in pixels of a face."""
    return round(metres * PIXELS_PER_METRE)
