"""Textures of streets: house fronts, the road, cars and the sky."""

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.procedural_textures import materials
from omnisight.simulation.procedural_textures.decor import ANTIALIASED
from omnisight.simulation.procedural_textures.materials import Colour, Rng

Bytes = NDArray[np.uint8]
Array = NDArray[np.float64]

PIXELS_PER_METRE = 150.0
# Line widths and margins below are in pixels of 1/64 m.
FINE = PIXELS_PER_METRE / 64
WALLS: tuple[Colour, ...] = (
    *((158, 92, 72), (206, 190, 160), (178, 120, 92), (196, 204, 206), (222, 196, 140)),
    *((142, 78, 66), (188, 172, 158), (206, 158, 132), (170, 186, 176), (232, 222, 200)),
)
SIGNS = ("BAKERY", "BOOKS", "CAFE", "HOTEL", "MUSIC", "FLOWERS", "PHARMACY", "SHOES", "TEA", "OPTICIAN")


def front(rng: Rng, width: float, height: float) -> Bytes:
    """Draw the front of a house: windows, a door, sometimes a shop."""
    import cv2

    colour = WALLS[int(rng.integers(len(WALLS)))]
    if rng.random() < 0.55:
        wall = materials.bricks(rng, width, height, colour, PIXELS_PER_METRE)
    else:
        shape = (materials.px(height, PIXELS_PER_METRE), materials.px(width, PIXELS_PER_METRE))
        wall = materials.to_8bit(
            materials.shaded(colour, materials.fractal_noise(rng, shape, 2 * PIXELS_PER_METRE, 4.0))
        )
    m = PIXELS_PER_METRE
    storeys, columns = max(int((height - 0.6) / 2.9), 1), max(int(width / 1.9), 2)
    shop = rng.random() < 0.45
    door = int(rng.integers(columns))
    pitch, stone = width / columns, (214, 208, 196)
    for storey in range(storeys):
        floor = height - 0.3 - 2.9 * storey
        cv2.rectangle(wall, (0, round((floor - 2.85) * m)), (wall.shape[1], round((floor - 2.74) * m)), stone, -1)
        for column in range(columns):
            middle = (column + 0.5) * pitch
            if storey == 0 and column == door:
                _door(wall, rng, middle, floor + 0.3)
            elif storey == 0 and shop:
                _window(wall, rng, (middle - 0.45 * pitch, floor - 2.15, 0.9 * pitch, 1.75))
            else:
                _window(wall, rng, (middle - 0.5, floor - 2.3, 1.0, 1.45))
    if shop:
        top, bottom = round((height - 3.25) * m), round((height - 2.7) * m)
        paint = tuple(int(c) for c in rng.integers(20, 110, 3))
        cv2.rectangle(wall, (round(0.2 * m), top), (wall.shape[1] - round(0.2 * m), bottom), paint, -1)
        words = SIGNS[int(rng.integers(len(SIGNS)))]
        size, thick = 1.1 * FINE, round(2 * FINE)
        (wide, _), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_DUPLEX, size, thick)
        at = ((wall.shape[1] - wide) // 2, bottom - round(9 * FINE))
        cv2.putText(wall, words, at, cv2.FONT_HERSHEY_DUPLEX, size, (240, 230, 200), thick, ANTIALIASED)
    cv2.rectangle(wall, (0, 0), (wall.shape[1], round(0.3 * m)), stone, -1)
    for x in range(0, wall.shape[1], round(0.4 * m)):
        cv2.rectangle(wall, (x, round(0.16 * m)), (x + round(0.2 * m), round(0.3 * m)), (168, 160, 150), -1)
    return wall


def _window(wall: Bytes, rng: Rng, place: tuple[float, float, float, float]) -> None:
    import cv2

    u, v, width, height = (round(x * PIXELS_PER_METRE) for x in place)
    frame = (236, 234, 228)
    for wide, tone in ((round(5 * FINE), (120, 112, 104)), (round(2 * FINE), frame)):
        cv2.rectangle(wall, (u - wide, v - wide), (u + width + wide, v + height + wide), tone, -1)
    share = np.linspace(0, 1, height)[:, None, None]
    pane = (
        (1 - share) * np.array((128, 152, 176)) + share * np.array((44, 54, 66)) + rng.normal(0, 5, (height, width, 1))
    )
    if rng.random() < 0.6:  # curtains
        cloth, side = rng.integers(150, 235, 3), int(width * rng.uniform(0.15, 0.32))
        pane[:, :side] = pane[:, -side:] = cloth * (0.75 + 0.12 * np.sin(np.arange(side) * 0.9 / FINE))[None, :, None]
    if rng.random() < 0.35:  # a blind
        pane[: int(height * rng.uniform(0.2, 0.6))] = rng.integers(170, 230, 3)
    rows, columns = wall[v : v + height, u : u + width].shape[:2]
    wall[v : v + height, u : u + width] = materials.to_8bit(pane)[:rows, :columns]
    x, y, bar = u + width // 2, v + height // 3, round(2 * FINE)
    cv2.rectangle(wall, (x - bar, v), (x + bar, v + height), frame, -1)
    cv2.rectangle(wall, (u, y - bar), (u + width, y + bar), frame, -1)
    out, upper, lower = (round(n * FINE) for n in (9, 5, 12))
    cv2.rectangle(wall, (u - out, v + height + upper), (u + width + out, v + height + lower), (206, 200, 188), -1)
    if rng.random() < 0.4:  # flowers on the sill
        for _ in range(40):
            at = (int(rng.integers(u, u + width)), int(rng.normal(v + height - 3 * FINE, 4 * FINE)))
            tone = ((70, 120, 50), (200, 60, 70), (230, 180, 60))[int(rng.integers(3))]
            cv2.circle(wall, at, round(rng.uniform(2, 5) * FINE), tone, -1, ANTIALIASED)


def _door(wall: Bytes, rng: Rng, middle: float, floor: float) -> None:
    import cv2

    m = PIXELS_PER_METRE
    left, right, top, bottom = (round(x * m) for x in (middle - 0.5, middle + 0.5, floor - 2.25, floor))
    paint = tuple(int(c) for c in rng.integers(30, 130, 3))
    rim = round(9 * FINE)
    cv2.rectangle(wall, (left - rim, top - rim), (right + rim, bottom), (210, 204, 192), -1)
    cv2.rectangle(wall, (left, top), (right, bottom), paint, -1)
    for v0, v1 in ((0.05, 0.25), (0.3, 0.6), (0.65, 0.95)):
        near, far = (round(left + s * (right - left)) for s in (0.15, 0.85))
        start, end = (near, round(top + v0 * (bottom - top))), (far, round(top + v1 * (bottom - top)))
        cv2.rectangle(wall, start, end, tuple(int(c * 0.7) for c in paint), round(2 * FINE))
    cv2.circle(wall, (right - rim, (top + bottom) // 2), round(3 * FINE), (214, 190, 110), -1, ANTIALIASED)
    number = str(int(rng.integers(1, 99)))
    at = (right + round(12 * FINE), top + round(30 * FINE))
    cv2.putText(wall, number, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * FINE, (40, 50, 90), round(2 * FINE), ANTIALIASED)


def road(rng: Rng, width: float, length: float, crossings: tuple[float, ...] = (0.3, 0.72)) -> Bytes:
    """Draw a vertical road with lines, manhole covers, and zebra crossings at shares of its length."""
    import cv2

    image = materials.asphalt(rng, width, length, PIXELS_PER_METRE)
    m, rows, columns = PIXELS_PER_METRE, image.shape[0], image.shape[1]
    paint = np.zeros((rows, columns), np.float32)
    for top in np.arange(0, length, 6.0):
        paint[
            round(top * m) : round((top + 3) * m), columns // 2 - round(0.07 * m) : columns // 2 + round(0.07 * m)
        ] = 1
    for edge in (0.25, width - 0.35):
        paint[:, round(edge * m) : round((edge + 0.1) * m)] = 1
    for crossing in crossings:
        top = round(crossing * rows)
        paint[top : top + round(3.4 * m)] = 0
        _bars(paint[top : top + round(3 * m)], width)
    image = _painted(rng, image, paint)
    for _ in range(int(length / 9)):
        at = (int(rng.uniform(0.2, 0.8) * columns), int(rng.integers(rows)))
        cv2.circle(image, at, round(0.33 * m), (74, 72, 70), -1, ANTIALIASED)
        cv2.circle(image, at, round(0.29 * m), (104, 100, 96), round(2 * FINE), ANTIALIASED)
        for k in range(-3, 4):
            y, half = at[1] + round(5 * FINE * k), round(14 * FINE)
            cv2.line(image, (at[0] - half, y), (at[0] + half, y), (92, 88, 84), round(FINE), ANTIALIASED)
    return image


def zebra_crossing(rng: Rng, width: float, length: float) -> Bytes:
    """Draw the end of a vertical road with a zebra crossing."""
    image = materials.asphalt(rng, width, length, PIXELS_PER_METRE)
    paint, margin = np.zeros(image.shape[:2], np.float32), round(0.2 * PIXELS_PER_METRE)
    _bars(paint[margin:-margin], width)
    return _painted(rng, image, paint)


def _bars(paint: NDArray[np.float32], width: float) -> None:
    """Paint the bars of a zebra crossing across a road of a width in metres."""
    for u in np.arange(0.4, width - 0.4, 1.0):
        paint[:, round(u * PIXELS_PER_METRE) : round((u + 0.5) * PIXELS_PER_METRE)] = 1


def _painted(rng: Rng, image: Bytes, paint: NDArray[np.float32]) -> Bytes:
    """Return a road with worn white paint where `paint` (h, w) is 1."""
    worn = 0.72 + 0.035 * materials.fractal_noise(rng, paint.shape[:2], 0.5 * PIXELS_PER_METRE, 2.5)
    share = (paint * np.clip(worn, 0, 1))[..., None]
    return materials.to_8bit(image * (1 - share) + share * np.array((226, 224, 214), np.float32))


def car_side(rng: Rng, paint: Colour, *, cabin: bool) -> Bytes:
    """Draw the side of a car's body, or of its cabin with the windows; 4.2 m are 640 px."""
    import cv2

    image = np.full((192, 640, 3), paint, np.uint8)
    if cabin:
        for left, right in ((28, 308), (332, 612)):
            cv2.rectangle(image, (left, 20), (right, 184), (52, 62, 72), -1)
            cv2.line(image, (left + 40, 176), (left + 120, 28), (110, 124, 136), 12, ANTIALIASED)
    else:
        for x in (208, 392):
            cv2.line(image, (x, 0), (x, 176), tuple(int(c * 0.6) for c in paint), 4, ANTIALIASED)
            cv2.rectangle(image, (x + 24, 36), (x + 68, 48), (30, 30, 32), -1)
        cv2.rectangle(image, (0, 156), (640, 192), (36, 36, 38), -1)
        cv2.line(image, (0, 68), (640, 60), tuple(min(int(c * 1.25), 255) for c in paint), 4, ANTIALIASED)
    return materials.to_8bit(image + rng.normal(0, 2, image.shape))


def car_end(paint: Colour, *, back: bool) -> Bytes:
    """Draw the front or the back of a car's body; 1.7 m are 384 px."""
    import cv2

    image = np.full((160, 384, 3), paint, np.uint8)
    light = (190, 36, 30) if back else (240, 240, 226)
    for left in (16, 296):
        cv2.rectangle(image, (left, 28), (left + 72, 68), light, -1)
    cv2.rectangle(image, (132, 88), (252, 124), (236, 236, 230), -1)
    cv2.putText(image, "OMNI 5", (140, 116), cv2.FONT_HERSHEY_SIMPLEX, 0.84, (20, 20, 24), 2, ANTIALIASED)
    cv2.rectangle(image, (0, 132), (384, 160), (40, 40, 42), -1)
    return image


def sky(rng: Rng, sun: tuple[float, float, float], width: int = 2048) -> Bytes:
    """Draw an equirectangular sky: blue, paler towards the horizon, with a layer of clouds and the sun."""
    import cv2

    height = width // 2
    lon = ((np.arange(width) + 0.5) / width * 2 * np.pi - np.pi).astype(np.float32)
    lat = (np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi).astype(np.float32)
    up = np.sin(lat)[:, None]
    across, ahead = np.cos(lat)[:, None] * np.sin(lon), np.cos(lat)[:, None] * np.cos(lon)
    rise = np.clip(up, 0, 1) ** 0.55
    image = (1 - rise)[..., None] * np.array((206, 222, 236), np.float32) + rise[..., None] * np.array(
        (58, 112, 190), np.float32
    )
    image = np.repeat(image, width, 1)
    # The clouds are in a horizontal layer, so they are smaller near the horizon.
    noise = _cloud_noise(rng)
    side = len(noise)
    away = 150.0 / np.maximum(up, 0.045)
    u, v = across * away % side, ahead * away % side
    thick = cv2.remap(noise, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    lower = cv2.remap(noise, (u + 6) % side, (v + 6) % side, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    cover = np.clip((thick - 0.15) / 0.9, 0, 1)[..., None]
    shade = np.clip(0.5 + 0.35 * (thick - lower) - 0.16 * np.clip(thick - 0.9, 0, 3), 0, 1)[..., None]
    cloud = (1 - shade) * np.array((176, 186, 200), np.float32) + shade * np.array((255, 253, 248), np.float32)
    cover *= np.clip((up[..., None] - 0.02) / 0.12, 0, 1) * 0.95
    image = image * (1 - cover) + cloud * cover
    x, y, z = (np.array(sun) / np.linalg.norm(sun)).astype(np.float32)
    off = np.arccos(np.clip(across * x - up * y + ahead * z, -1, 1))
    glow = (np.exp(-off / 0.16) * 90 + (off < 0.022) * 255).astype(np.float32)
    haze = np.clip(-up * 6, 0, 1)[..., None]
    image = (image + glow[..., None] * np.array((1, 0.96, 0.86), np.float32)) * (1 - haze) + haze * np.array(
        (150, 158, 146), np.float32
    )
    return materials.to_8bit(image)


def covered_sky(rng: Rng, width: int = 1024) -> NDArray[np.float32]:
    """Return the light (h, w, 1) of a covered sky relative to its light on the ground (CIE standard overcast sky)."""
    import cv2

    height = width // 2
    lon = (((np.arange(width) + 0.5) / width * 2 - 1) * np.pi).astype(np.float32)
    lat = ((0.5 - (np.arange(height)[:, None] + 0.5) / height) * np.pi).astype(np.float32)
    up = np.sin(lat)
    noise = _cloud_noise(rng)
    away = 60.0 / np.maximum(up, 0.1)
    u, v = (np.cos(lat) * turn * away % len(noise) for turn in (np.sin(lon), np.cos(lon)))
    clouds = cv2.remap(noise, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    light = (1 + 2 * np.clip(up, 0, 1)) * 3 / 7 * (1 + 0.07 * clouds * np.clip(up * 4, 0, 1))
    return np.asarray(light, np.float32)[..., None]


def _cloud_noise(rng: Rng, side: int = 1024) -> NDArray[np.float32]:
    """Return periodic fractal noise of mean 0 and standard deviation 1."""
    noise = np.zeros((side, side), np.float32)
    for cells in (4, 8, 16, 32, 64, 128, 256):
        noise += _wrapped(rng, side, cells) * np.float32(cells**-0.85)
    return ((noise - noise.mean()) / noise.std()).astype(np.float32)


def _wrapped(rng: Rng, side: int, cells: int) -> NDArray[np.float32]:
    """Make smooth periodic noise."""
    import cv2

    coarse = np.pad(rng.normal(0, 1, (cells, cells)).astype(np.float32), 2, mode="wrap")
    step = side // cells
    fine = cv2.resize(coarse, None, fx=step, fy=step, interpolation=cv2.INTER_CUBIC)
    return np.asarray(fine[2 * step : 2 * step + side, 2 * step : 2 * step + side], np.float32)
