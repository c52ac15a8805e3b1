"""Textures of materials: images (h, w, 3) uint8 with grain and stains, at a number of pixels per metre."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.procedural_textures.decor import ANTIALIASED, PIXELS_PER_METRE

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
Colour = tuple[int, int, int]
Rng = np.random.Generator

KNOTS_PER_M2, SPRIGS_PER_M2 = 10, 55


def px(metres: float, density: float = PIXELS_PER_METRE) -> int:
    """Return a length in pixels."""
    return max(round(metres * density), 1)


def to_8bit(image: NDArray[Any]) -> Bytes:
    """Clip and convert to 8 bits."""
    return np.clip(image, 0, 255).astype(np.uint8)


def smooth_noise(rng: Rng, shape: tuple[int, int], size: Any, amount: float) -> Floats:
    """Make smooth noise with a standard deviation and grain size, px, optionally per axis (down, across)."""
    import cv2

    down, across = size if isinstance(size, tuple) else (size, size)
    # Upsampled coarse noise, because a wide blur is slow.
    coarse = (max(shape[0] // max(int(down), 1), 2), max(shape[1] // max(int(across), 1), 2))
    noise = rng.standard_normal(coarse, np.float32) * np.float32(amount)
    return np.asarray(cv2.resize(noise, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC), np.float32)


def fractal_noise(rng: Rng, shape: tuple[int, int], largest: float, amount: float) -> Floats:
    """Make fractal noise up to a grain size, px: the standard deviation decreases by 0.7 per octave."""
    total, size = np.zeros(shape, np.float32), float(largest)
    while size >= 1.5:
        total += smooth_noise(rng, shape, size, amount)
        size, amount = size / 2, amount * 0.7
    return total


def shaded(colour: Colour, change: Floats, tint: tuple[float, float, float] | None = None) -> Floats:
    """Return a colour plus a brightness change (h, w), optionally scaled per channel."""
    tinted = change[..., None] if tint is None else change[..., None] * np.array(tint, np.float32)
    return np.asarray(np.array(colour, np.float32) + tinted, np.float32)


def joint_share(count: int, period: float, joint: float, phase: Any = 0.0) -> Floats:
    """Return the share of each of `count` pixels that joints cover: the exact mean over the pixel, without aliasing.

    Parameters
    ----------
    count
        Number of pixels in a row.
    period
        Pixels from joint to joint.
    joint
        Width of a joint as a share of the period; a joint begins each period.
    phase
        (..., 1) offset in periods.
    """
    edges = np.arange(count + 1) / period + phase
    whole = np.floor(edges)
    covered = whole * joint + np.minimum(edges - whole, joint)
    return np.asarray(np.diff(covered, axis=-1) * period, np.float32)


def plaster(rng: Rng, width: float, height: float, colour: Colour, *, trim: bool = False) -> Bytes:
    """Draw a painted wall, optionally with skirting board and cornice; sizes in metres."""
    shape = (px(height), px(width))
    image = shaded(
        colour,
        fractal_noise(rng, shape, px(0.5), 2.6) + smooth_noise(rng, shape, 5, 6.0) + smooth_noise(rng, shape, 11, 6.0),
    )
    if trim:
        image[-px(0.1) :] = (238, 236, 230)
        image[-px(0.1) : -px(0.09)] = (170, 168, 160)
        image[: px(0.12)] = (240, 238, 232)
        for edge in (0.03, 0.07, 0.11):
            image[px(edge) : px(edge + 0.012)] = (176, 172, 164)
    return to_8bit(image)


def wallpaper(rng: Rng, width: float, height: float, colour: Colour, print_colour: Colour) -> Bytes:
    """Draw wallpaper: `plaster` with trim and a random pattern of sprigs."""
    import cv2

    image = plaster(rng, width, height, colour, trim=True)
    field = image[px(0.13) : -px(0.11)]
    for _ in range(int(width * height * SPRIGS_PER_M2)):
        foot = rng.uniform((0, 0), field.shape[1::-1])
        turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(9, 17)
        along = np.array((np.cos(turn), np.sin(turn)))
        tone = tuple(int(c) for c in np.clip(np.array(print_colour) + rng.normal(0, 14), 0, 255))
        start, end = (np.rint(foot + s * size * along).astype(int).tolist() for s in (-1, 1))
        cv2.line(field, start, end, tone, 1, ANTIALIASED)
        for _ in range(int(rng.integers(3, 6))):
            at = np.rint(foot + rng.uniform(-0.8, 1) * size * along).astype(int).tolist()
            lean = np.degrees(turn) + rng.choice((-1, 1)) * rng.uniform(30, 60)
            cv2.ellipse(field, at, (round(0.42 * size), round(0.17 * size)), lean, 0, 360, tone, -1, ANTIALIASED)
    return image


def wood(rng: Rng, width: float, height: float, colour: Colour, density: float = PIXELS_PER_METRE) -> Bytes:
    """Draw wood with horizontal grain."""
    shape = (px(height, density), px(width, density))
    grain = (
        smooth_noise(rng, shape, (1.2, 40), 6.0)
        + smooth_noise(rng, shape, (3, 150), 5.0)
        + fractal_noise(rng, shape, 60, 3.0)
    )
    return to_8bit(shaded(colour, grain, (1.0, 0.9, 0.75)))


def planks(rng: Rng, width: float, depth: float) -> Bytes:
    """Draw a floor of planks with individual tones, grain, knots and dark seams."""
    import cv2

    rows, columns, across = px(depth), px(width), px(0.14)
    grain = smooth_noise(rng, (rows, columns), (1.2, 40), 6.0) + smooth_noise(rng, (rows, columns), (3, 150), 5.0)
    tone = np.zeros((rows, columns), np.float32)
    for top in range(0, rows, across):
        start = -int(rng.integers(0, px(1.2)))
        while start < columns:
            end = start + int(rng.integers(px(0.8), px(1.6)))
            tone[top : top + across, max(start, 0) : end] = rng.normal(0, 9)
            tone[top : top + across, max(end - 2, 0) : max(end, 0)] = -45
            start = end
        tone[top : top + 2] = -45
    knots = np.zeros((rows, columns), np.float32)
    for _ in range(int(width * depth * KNOTS_PER_M2)):
        at, size = (int(rng.integers(columns)), int(rng.integers(rows))), int(rng.integers(3, 7))
        for share, dark in ((1.0, -22.0), (0.5, -48.0)):
            cv2.ellipse(knots, at, (round(1.7 * size * share), round(size * share)), 0, 0, 360, dark, -1)
    return to_8bit(shaded((168, 122, 80), grain + tone + knots, (1, 0.9, 0.75)))


def fabric(rng: Rng, width: float, height: float, colour: Colour) -> Bytes:
    """Draw woven cloth."""
    rows, columns = px(height), px(width)
    v, u = np.mgrid[:rows, :columns]
    weave = 5.0 * np.sin(u * 1.1) * np.sin(v * 1.1)
    return to_8bit(shaded(colour, weave.astype(np.float32) + fractal_noise(rng, (rows, columns), 40, 4.0)))


def leaves(rng: Rng, colour: Colour = (74, 112, 48), size: int = 512) -> Bytes:
    """Draw foliage with darker leaves in the background."""
    import cv2

    image = np.full((size // 2, size, 3), np.array(colour) * 0.25, np.uint8)
    count = 2600
    for i in range(count):
        tone = (0.35 + 0.75 * i / count) * rng.uniform(0.75, 1.25)
        shade = tuple(int(c) for c in np.clip(np.array(colour) * tone + rng.normal(0, 6, 3), 0, 255))
        at = int(rng.integers(size)), int(rng.integers(size // 2))
        axes = int(rng.integers(4, 9)), int(rng.integers(2, 4))
        cv2.ellipse(image, at, axes, float(rng.uniform(0, 180)), 0, 360, shade, -1, cv2.LINE_AA)
    return image


def bark(rng: Rng, size: int = 128) -> Bytes:
    """Draw bark."""
    ridges = smooth_noise(rng, (4 * size, size), (24, 3), 22.0) + fractal_noise(rng, (4 * size, size), 16, 7.0)
    return to_8bit(shaded((96, 78, 62), ridges))


def bricks(rng: Rng, width: float, height: float, colour: Colour, density: float) -> Bytes:
    """Draw a brick wall."""
    rows, columns = px(height, density), px(width, density)
    course, stone = 0.11 * density, 0.34 * density
    down = np.arange(rows)[:, None] / course
    row = down.astype(int)
    along = (np.arange(columns) / stone + 0.5 * (row % 2)).astype(np.float32)
    column = along.astype(int)
    tones = rng.normal(0, 13, (row.max() + 1, column.max() + 1)).astype(np.float32)
    tone = tones[row, column]
    bed = joint_share(rows, course, 0.14)[:, None]
    upright = joint_share(columns, stone, 0.05, 0.5 * np.arange(2)[:, None])[row[:, 0] % 2]
    mortar = (1 - (1 - bed) * (1 - upright))[..., None]
    image = shaded(colour, tone + fractal_noise(rng, (rows, columns), density, 4.0))
    return to_8bit(
        image * (1 - mortar) + mortar * shaded((176, 168, 156), fractal_noise(rng, (rows, columns), 0.5 * density, 4.0))
    )


def tiles(rng: Rng, width: float, height: float, colour: Colour, density: float) -> Bytes:
    """Draw a tiled roof."""
    rows, columns = px(height, density), px(width, density)
    v, u = np.mgrid[:rows, :columns].astype(np.float32)
    row, column = np.floor(v / (0.28 * density)), np.floor(u / (0.22 * density))
    tones = rng.normal(0, 12, (int(row.max()) + 1, int(column.max()) + 1)).astype(np.float32)
    edge = joint_share(rows, 0.28 * density, 0.14, 0.14)[:, None]  # the lower end of each row of tiles
    bulge = 16 * np.sin(np.pi * ((u / (0.22 * density)) % 1)) - 26 * edge
    stains = fractal_noise(rng, (rows, columns), 2 * density, 5.0)
    return to_8bit(shaded(colour, tones[row.astype(int), column.astype(int)] + bulge.astype(np.float32) + stains))


def paving(rng: Rng, width: float, depth: float, side: float, density: float, colour: Colour) -> Bytes:
    """Draw flagstones."""
    rows, columns = px(depth, density), px(width, density)
    v, u = np.mgrid[:rows, :columns].astype(np.float32) / (side * density)
    tones = rng.normal(0, 9, (int(v.max()) + 1, int(u.max()) + 1)).astype(np.float32)
    image = shaded(colour, tones[v.astype(int), u.astype(int)] + fractal_noise(rng, (rows, columns), density, 5.0))
    across, along = (joint_share(count, side * density, 0.03) for count in (columns, rows))
    return to_8bit(image * (1 - 0.4 * (1 - (1 - across) * (1 - along[:, None])))[..., None])


def asphalt(rng: Rng, width: float, depth: float, density: float) -> Bytes:
    """Draw asphalt with stones, patches and cracks."""
    import cv2

    shape = (px(depth, density), px(width, density))
    image = shaded(
        (98, 98, 101), fractal_noise(rng, shape, 3 * density, 3.0) + rng.normal(0, 9, shape).astype(np.float32)
    )
    for _ in range(int(width * depth / 12)):
        left, top = int(rng.integers(shape[1])), int(rng.integers(shape[0]))
        wide, deep = (int(rng.uniform(0.4, 2.2) * density) for _ in range(2))
        image[top : top + deep, left : left + wide] *= rng.uniform(0.82, 1.1)
    for _ in range(int(width * depth / 6)):
        line = np.cumsum(rng.normal(0, 0.12 * density, (14, 2)), 0) + rng.uniform((0, 0), shape[::-1])
        cv2.polylines(image, [line.astype(np.int32)], False, (62, 62, 64), max(round(density / 64), 1), cv2.LINE_AA)
    return to_8bit(image)


def grass(rng: Rng, width: float, depth: float, density: float) -> Bytes:
    """Draw a meadow that continues seamlessly if repeated: it is mirrored in both directions."""
    shape = (px(depth / 2, density), px(width / 2, density))
    blades = smooth_noise(rng, shape, (0.06 * density, 0.012 * density), 10.0)
    quarter = to_8bit(shaded((108, 128, 66), fractal_noise(rng, shape, 2 * density, 4.0) + blades, (1, 0.9, 0.6)))
    half = np.concatenate([quarter, quarter[:, ::-1]], 1)
    return np.concatenate([half, half[::-1]])
