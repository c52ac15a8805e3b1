"""Room decor, drawn onto textures; places are (left, top, width, height) in metres."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Place = tuple[float, float, float, float]
Colour = tuple[int, int, int]

PIXELS_PER_METRE = 240
# cv2.LINE_AA; cv2 is imported on use.
ANTIALIASED = 16
TUFTS_PER_M2 = 600


def poster(face: Bytes, place: Place) -> None:
    """Draw a poster with text, which reveals mirrored images."""
    import cv2

    inside = framed(face, place, (36, 42, 60), (28, 28, 30))
    rows, columns = inside.shape[:2]
    middle = (columns // 2, round(rows * 0.4))
    for i, colour in enumerate(((236, 108, 62), (245, 186, 84), (96, 180, 170), (236, 236, 226), (36, 42, 60))):
        cv2.circle(inside, middle, round(columns * (0.40 - 0.075 * i)), colour, -1, ANTIALIASED)
    for text, height, size, thick in (("OMNI", 0.83, 1.9, 5), ("SIGHT", 0.95, 1.35, 3)):
        (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, size, thick)
        corner = ((columns - wide) // 2, round(rows * height))
        cv2.putText(inside, text, corner, cv2.FONT_HERSHEY_DUPLEX, size, (240, 236, 224), thick, ANTIALIASED)


def landscape(face: Bytes, place: Place, rng: np.random.Generator) -> None:
    """Draw a painting of hills at dusk."""
    outdoors(framed(face, place, (245, 242, 232), (92, 62, 40), border=0.07), rng, dusk=True)


def abstract(face: Bytes, place: Place) -> None:
    """Draw a painting of circles and bars."""
    import cv2

    inside = framed(face, place, (240, 234, 220), (40, 36, 34))
    rows, columns = inside.shape[:2]
    cv2.rectangle(inside, (0, round(rows * 0.62)), (columns, rows), (44, 76, 112), -1)
    cv2.circle(
        inside, (round(columns * 0.36), round(rows * 0.42)), round(columns * 0.25), (206, 74, 52), -1, ANTIALIASED
    )
    cv2.circle(
        inside, (round(columns * 0.68), round(rows * 0.6)), round(columns * 0.18), (240, 188, 66), -1, ANTIALIASED
    )
    cv2.line(inside, (round(columns * 0.1), rows), (round(columns * 0.95), 0), (28, 28, 30), 5, ANTIALIASED)


def stripes(face: Bytes, place: Place) -> None:
    """Draw a striped wall hanging."""
    cloth = cut(face, place)
    cast_shadow(face, place)
    for i, edge in enumerate(np.linspace(0, cloth.shape[0], 18)[:-1]):
        colours = ((170, 64, 56), (232, 214, 178), (60, 96, 104), (232, 214, 178), (216, 150, 62))
        cloth[round(edge) :] = colours[i % len(colours)]
    cloth[:, ::6] = (cloth[:, ::6] * 0.93).astype(np.uint8)


def window(face: Bytes, place: Place, rng: np.random.Generator) -> None:
    """Draw a window with two casements, curtains and a view of hills."""
    pane = framed(face, place, (255, 255, 255), (242, 240, 236), border=0.09)
    outdoors(pane, rng, dusk=False)
    rows, columns = pane.shape[:2]
    for left in (columns // 2, columns // 4, 3 * columns // 4):
        half = 12 if left == columns // 2 else 4
        pane[:, left - half : left + half] = (242, 240, 236)
    pane[rows // 3 - 4 : rows // 3 + 4] = (242, 240, 236)
    left, top, width, height = place
    cut(face, (left - 0.1, top + height, width + 0.2, 0.06))[:] = (228, 226, 220)
    for side in (left - 0.42, left + width + 0.02):  # curtains with folds
        curtain = cut(face, (side, top - 0.2, 0.4, height + 0.55))
        folds = 0.86 + 0.14 * np.sin(np.linspace(0, 34, curtain.shape[1]))
        curtain[:] = (np.array((176, 84, 72)) * folds[:, None]).astype(np.uint8)


def door(face: Bytes, place: Place) -> None:
    """Draw a panelled door."""
    import cv2

    leaf = framed(face, place, (226, 220, 206), (200, 192, 176), border=0.08)
    rows, columns = leaf.shape[:2]
    for top, bottom in ((0.06, 0.46), (0.52, 0.94)):
        corners = (round(columns * 0.16), round(rows * top)), (round(columns * 0.84), round(rows * bottom))
        cv2.rectangle(leaf, *corners, (212, 204, 188), -1)
        cv2.rectangle(leaf, *corners, (168, 160, 142), 4)
    cv2.circle(leaf, (round(columns * 0.92), rows // 2), 9, (150, 118, 50), -1, ANTIALIASED)


def shelves(face: Bytes, place: Place, rng: np.random.Generator) -> None:
    """Draw the front of a bookcase full of books."""
    inside = framed(face, place, (64, 44, 30), (118, 80, 50), border=0.05)
    rows, columns = inside.shape[:2]
    levels = 6
    for level in range(levels):
        top, bottom = rows * level // levels, rows * (level + 1) // levels - 10
        inside[bottom : bottom + 10] = (130, 90, 58)
        x = 6
        while x < columns - 22:
            width, tall = int(rng.integers(8, 20)), int((bottom - top) * rng.uniform(0.6, 0.92))
            if rng.random() < 0.08:  # a gap
                x += 3 * width
                continue
            spine = np.array(BOOKS[int(rng.integers(len(BOOKS)))]) * rng.uniform(0.8, 1.1)
            x_end = min(x + width, columns - 4)
            inside[bottom - tall : bottom, x:x_end] = np.clip(spine, 0, 255)
            inside[bottom - tall : bottom, x_end - 1 : x_end] = np.clip(spine * 0.5, 0, 255)
            label = bottom - round(tall * 0.75)
            inside[label : label + 8, x + 2 : x_end - 3] = (226, 214, 184)
            x = x_end


def sideboard(face: Bytes, place: Place) -> None:
    """Draw the front of a sideboard with three doors."""
    import cv2

    front = framed(face, place, (122, 86, 58), (100, 68, 44), border=0.03)
    rows, columns = front.shape[:2]
    for i in range(3):
        corners = (round(columns * (i / 3 + 0.015)), 10), (round(columns * ((i + 1) / 3 - 0.015)), rows - 10)
        cv2.rectangle(front, *corners, (138, 98, 66), -1)
        cv2.circle(front, ((corners[0][0] + corners[1][0]) // 2, rows // 3), 7, (214, 190, 130), -1, ANTIALIASED)


def rug(face: Bytes, place: Place, rng: np.random.Generator) -> None:
    """Draw a rug with nested frames and uneven dye."""
    import cv2

    cloth = cut(face, place)
    colours = ((148, 52, 50), (226, 204, 164), (44, 64, 92), (226, 204, 164), (148, 52, 50), (178, 80, 62))
    for i, colour in enumerate(colours):
        inset = round(i * PIXELS_PER_METRE * 0.09)
        cloth[inset : cloth.shape[0] - inset, inset : cloth.shape[1] - inset] = colour
    rows, columns = cloth.shape[:2]
    for x in np.linspace(0.3, 0.7, 3):
        middle = np.array((columns * x, rows / 2))
        for size, colour in ((1.0, (44, 64, 92)), (0.5, (226, 204, 164))):
            diamond = np.array([[0, -0.14], [0.11, 0], [0, 0.14], [-0.11, 0]]) * rows * size
            cv2.fillPoly(cloth, [(middle + diamond).astype(np.int32)], colour, ANTIALIASED)
    # Vary the brightness within each colour, which keeps the edges straight.
    dye = np.ones((rows, columns), np.float32)
    for _ in range(int(TUFTS_PER_M2 * place[2] * place[3])):
        at = int(rng.integers(columns)), int(rng.integers(rows))
        tone, lies = float(rng.choice((0.76, 0.86, 1.1))), float(rng.choice((0, 90)))
        cv2.ellipse(dye, at, (int(rng.integers(2, 5)), 2), lies, 0, 360, tone, -1)
    knots = rng.normal(0, 9, ((rows + 2) // 3, (columns + 2) // 3)).astype(np.float32)
    knots += cv2.resize(rng.normal(0, 7, (24, 30)).astype(np.float32), knots.shape[::-1], interpolation=cv2.INTER_CUBIC)
    pile = cv2.resize(knots, (columns, rows), interpolation=cv2.INTER_LINEAR)
    cloth[:] = np.clip(cloth * dye[..., None] + pile[..., None], 0, 255).astype(np.uint8)


def outdoors(image: Bytes, rng: np.random.Generator, *, dusk: bool) -> None:
    """Draw hills under a sky."""
    rows, columns = image.shape[:2]
    ends: Any = ((88, 98, 150), (248, 176, 112)) if dusk else ((140, 186, 232), (236, 242, 246))
    share = np.linspace(0, 1, rows)[:, None, None]
    image[:] = ((1 - share) * ends[0] + share * ends[1]).astype(np.uint8)
    across = np.linspace(0, 1, columns)
    for i, level in enumerate((0.5, 0.62, 0.76)):
        waves = np.zeros(columns)
        for _ in range(3):
            waves += rng.uniform(0.015, 0.05) * np.sin(rng.uniform(4, 12) * across + rng.uniform(0, 6))
        hill = np.arange(rows)[:, None] > (level + waves) * rows
        far, near = ((110, 84, 120), (44, 38, 60)) if dusk else ((150, 178, 170), (84, 124, 62))
        image[hill] = (np.array(far) * (1 - i / 2) + np.array(near) * (i / 2)).astype(np.uint8)


def framed(face: Bytes, place: Place, paper: Colour, frame: Colour, border: float = 0.035) -> Bytes:
    """Draw a frame with its shadow; return a view of the area inside."""
    cast_shadow(face, place)
    cut(face, place)[:] = frame
    left, top, width, height = place
    inside = cut(face, (left + border, top + border, width - 2 * border, height - 2 * border))
    inside[:] = paper
    return inside


def cast_shadow(face: Bytes, place: Place) -> None:
    """Draw the shadow of an object at a place."""
    left, top, width, height = place
    shade = cut(face, (left + 0.03, top + 0.04, width, height))
    shade[:] = (shade * 0.72).astype(np.uint8)


def cut(face: Bytes, place: Place) -> Bytes:
    """Return a view of a place of the texture."""
    left, top, width, height = place
    (u0, v0), (u1, v1) = point(left, top), point(left + width, top + height)
    return face[max(v0, 0) : v1, max(u0, 0) : u1]


def point(u: float, v: float) -> NDArray[np.int64]:
    """Return a position in pixels."""
    return np.rint(np.array((u, v)) * PIXELS_PER_METRE).astype(np.int64)


BOOKS: tuple[Colour, ...] = (
    *((150, 46, 44), (44, 70, 110), (48, 92, 70), (206, 170, 92), (230, 222, 204)),
    *((96, 60, 92), (34, 34, 40), (196, 108, 54), (110, 140, 160), (178, 74, 84)),
)
