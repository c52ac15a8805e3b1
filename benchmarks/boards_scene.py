"""Images of a 9x6 board whose corners are known, through cameras of all kinds, and how they are degraded.

A pixel is the mean light over its square. Pixels that an edge crosses are sampled 6x6 times at exact intersections of
ray and board, each sample being averaged over its own width, so that an edge along the pixel grid is right too.
"""

import zlib
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_from_axis
from omnisight.targets import Checkerboard

Array = NDArray[np.float64]

BOARD = Checkerboard(9, 6)
PAPER_MARGIN = 0.6  # of white paper around the squares, in squares
INK, PAPER, DARK = 35.0, 190.0, 6.0
SAMPLES = 6
BORDER = 3.0  # a visible corner's quarter-squares are this far (px) inside the image
PIXELS_AT_ONCE = 60_000
TRIES = 150


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera and the angles from its axis, radians, between which it sees."""

    camera: om.Camera
    near: float
    far: float


def lenses(scale: float = 1.0) -> dict[str, Lens]:
    """Return the cameras, for images of 1000x800 px times a scale."""
    s = scale

    def lens(name: str, near: float, far: float, *params: float) -> Lens:
        model = om.model_class(name)(*params)
        return Lens(om.Camera(model, (round(1000 * s), round(800 * s))), np.radians(near), np.radians(far))

    return {
        "fisheye 100": lens("equidistant", 0, 50, 733 * s, 733 * s, 497.3 * s, 402.1 * s),
        "fisheye 140": lens("kannala_brandt", 0, 70, 455 * s, 454 * s, 503 * s, 396 * s, -0.02, 0.003, -0.001, 0.0001),
        "fisheye 180": lens("kannala_brandt", 0, 90, 300 * s, 301 * s, 499 * s, 404 * s, 0.012, -0.006, 0.001, 0.0),
        "fisheye 220": lens("equidistant", 0, 110, 203 * s, 203 * s, 502.4 * s, 398.7 * s),
        "mirror": lens("unified", 18, 110, -262 * s, 261 * s, 500.6 * s, 401.2 * s, 0.98),
    }


LENSES = lenses()


@dataclass(frozen=True)
class Shot:
    """What an image shows and how it is spoilt.

    Attributes
    ----------
    lens
        A name in `LENSES`.
    place
        Where the board is held: 0 is the axis, 1 the rim.
    tilt
        Degrees between the board's normal and the line of sight.
    square
        Median side of a square, px.
    seed
        Of everything random.
    blur
        Standard deviation, px.
    noise
        Standard deviation, percent of 255.
    jpeg
        Quality; 0 for none.
    light
        Factor of brightness from one side of the image to the other.
    visible
        Part of the corners that is visible.
    """

    lens: str
    place: float
    tilt: float
    square: float
    seed: int
    blur: float = 1.0
    noise: float = 2.0
    jpeg: int = 0
    light: float = 1.0
    visible: float = 1.0


@dataclass(frozen=True, eq=False)
class Scene:
    """An image (H, W) of uint8, the true corners (54, 2), and which of them are visible."""

    image: NDArray[np.uint8]
    corners: Array
    visible: NDArray[np.bool_]


def shoot(shot: Shot, lens: Lens | None = None) -> Scene:
    """Take the image; the same shot gives the same image."""
    lens = lens or LENSES[shot.lens]
    place = zlib.crc32(repr((shot.lens, shot.place, shot.tilt, shot.square, shot.seed)).encode())
    rng, noise = np.random.default_rng(place), np.random.default_rng(zlib.crc32(repr(astuple(shot)).encode()))
    pose = hold(lens, shot, rng)
    light = clutter(rng, lens.camera.size)
    paint(light, lens, pose)
    field = _field(lens)
    light = light * field + DARK * (1 - field)
    if shot.light > 1:
        light *= _slope(lens.camera.size, shot.light, rng.uniform(0, 2 * np.pi))
    if shot.blur > 0:
        light = cv2.GaussianBlur(light, (0, 0), shot.blur, borderType=cv2.BORDER_REFLECT)
    light = light + noise.normal(size=light.shape) * shot.noise * 2.55
    image = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    if shot.jpeg:
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, shot.jpeg])[1], 0)
    return Scene(image, lens.camera.project(pose @ BOARD.points)[0], visible_corners(lens, pose))


def hold(lens: Lens, shot: Shot, rng: np.random.Generator) -> Pose:
    """Return cam_from_board: wholly visible, smaller or further in than wanted if need be; then moved out of view."""
    spin, lean = rng.uniform(0, 2 * np.pi, 2)
    far = min(lens.far, float(np.nanmax(lens.camera.angle_of(lens.camera.border()))))
    middle = (lens.near + far) / 2
    for attempt in range(TRIES):
        azimuth, yielded = rng.uniform(0, 2 * np.pi), attempt / TRIES
        theta = lens.near + (far - lens.near) * shot.place
        theta += (middle - theta) * yielded
        pose = _sized(lens, theta, azimuth, spin, lean, shot.tilt, shot.square * (1 - 0.8 * yielded))
        if pose is not None and visible_corners(lens, pose).all():
            break
    else:
        raise ValueError(f"no place shows all of the board: {shot}")
    if shot.visible >= 1:
        return pose
    distance = float(np.linalg.norm(pose @ _middle()))
    moved = [_held(t, azimuth, spin, lean, shot.tilt, distance) for t in np.arange(theta, np.pi, 0.01)]
    miss = [abs(visible_corners(lens, each).mean() - shot.visible) for each in moved]
    return moved[int(np.argmin(miss))]


def _sized(
    lens: Lens, theta: float, azimuth: float, spin: float, lean: float, tilt: float, square: float
) -> Pose | None:
    """Find the distance at which squares are so large."""
    distance = 10.0
    pose = _held(theta, azimuth, spin, lean, tilt, distance)
    for _ in range(12):
        corners = lens.camera.project(pose @ BOARD.points)[0].reshape(BOARD.rows, BOARD.columns, 2)
        steps = np.concatenate([np.diff(corners, axis=axis).reshape(-1, 2) for axis in (0, 1)])
        if not np.isfinite(steps).any():
            return None
        factor = float(np.nanmedian(np.linalg.norm(steps, axis=1))) / square
        distance *= np.clip(factor, 0.5, 2)
        pose = _held(theta, azimuth, spin, lean, tilt, distance)
    return pose


def _held(theta: float, azimuth: float, spin: float, lean: float, tilt: float, distance: float) -> Pose:
    towards = np.array((np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)))
    turn = so3.exp(np.array((-np.sin(azimuth), np.cos(azimuth), 0)) * theta)
    tilted = so3.exp(np.radians(tilt) * np.array((np.cos(lean), np.sin(lean), 0)))
    rotation = turn @ tilted @ so3.exp(np.array((0, 0, spin)))
    return Pose(rotation, towards * distance - rotation @ _middle())


def _middle() -> Array:
    return BOARD.points.mean(0)


def visible_corners(lens: Lens, pose: Pose) -> NDArray[np.bool_]:
    """Return which corners (54,) have their four neighbouring quarter-squares in the image and in the field."""
    ends = np.array([(0, 0), (-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])
    points = pose @ (BOARD.points[:, None] + np.pad(ends, ((0, 0), (0, 1))))
    pixels, valid = lens.camera.project(points)
    angle = angle_from_axis(points)
    margin = BORDER / abs(lens.camera.model.params[0])
    inside = (pixels >= BORDER) & (pixels <= np.array(lens.camera.size) - 1 - BORDER)
    inside = inside.all(-1) & valid & (angle < lens.far - margin)
    if lens.near > 0:
        inside &= angle > lens.near + margin
    return inside.all(-1)


def paint(light: Array, lens: Lens, pose: Pose) -> None:
    """Draw the board into the light (H, W) of a scene, each pixel the mean over its square."""
    u, v = np.meshgrid(np.arange(lens.camera.width, dtype=float), np.arange(lens.camera.height, dtype=float))
    x, y = _meet(lens, pose, np.stack([u, v], -1))
    with np.errstate(invalid="ignore"):
        wide_x, wide_y = _width(x), _width(y)
        reach = 1 + PAPER_MARGIN
        near = (x > -reach - wide_x) & (x < BOARD.columns - 1 + reach + wide_x)
        near &= (y > -reach - wide_y) & (y < BOARD.rows - 1 + reach + wide_y)
        edge = near & ((_from_edge(x, BOARD.columns) < wide_x) | (_from_edge(y, BOARD.rows) < wide_y))
    # Far from edges one ray per pixel is enough.
    flat = near & ~edge
    share, paper = _shade(x[flat], y[flat], wide_x[flat], wide_y[flat])
    light[flat] = light[flat] * (1 - share) + paper
    fine = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    offsets = np.stack(np.meshgrid(fine, fine), -1).reshape(-1, 2)
    for rows in _chunks(np.flatnonzero(edge)):
        pixels = np.stack([u.ravel()[rows], v.ravel()[rows]], -1)
        x_fine, y_fine = _meet(lens, pose, pixels[:, None] + offsets)
        widths = (wide.ravel()[rows, None] / SAMPLES for wide in (wide_x, wide_y))
        share, paper = (part.mean(1) for part in _shade(x_fine, y_fine, *widths))
        light.ravel()[rows] = light.ravel()[rows] * (1 - share) + paper


def _meet(lens: Lens, pose: Pose, pixels: Array) -> tuple[Array, Array]:
    """Return where on the board, in squares, the rays of pixels meet its plane; NaN where they do not."""
    bearings, _ = lens.camera.unproject(pixels)
    eye = -pose.rotation.T @ pose.translation
    rays = bearings @ pose.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -eye[2] / rays[..., 2]
        distance = np.where(distance > 0, distance, np.nan)
        return eye[0] + distance * rays[..., 0], eye[1] + distance * rays[..., 1]


def _width(x: Array) -> Array:
    """Return how much x changes over a pixel, both directions together; a little where that is not known."""
    return np.nan_to_num(sum(np.abs(np.gradient(x, axis=axis)) for axis in (0, 1)), nan=1e-6, posinf=1e-6) + 1e-9


def _from_edge(x: Array, count: int) -> Array:
    """Return the distance from the nearest edge of squares or paper, in squares."""
    squares = np.abs(x - np.clip(np.rint(x), -1, count))
    paper = np.minimum(np.abs(x + 1 + PAPER_MARGIN), np.abs(x - count - PAPER_MARGIN))
    return np.minimum(squares, paper)


def _shade(x: Array, y: Array, wide_x: Array, wide_y: Array) -> tuple[Array, Array]:
    """Return the share that is paper, and that share times its light, each edge averaged over the given widths."""

    def along(x: Array, wide: Array, count: int) -> tuple[Array, Array, Array]:
        beyond = np.abs(x - (count - 1) / 2) - (count + 1) / 2
        nearest = np.clip(np.rint(x), 0, count - 1)
        wave = np.where(nearest % 2 == 0, 1, -1) * np.clip(2 * (x - nearest) / wide, -1, 1)
        return wave, np.clip(0.5 - beyond / wide, 0, 1), np.clip(0.5 - (beyond - PAPER_MARGIN) / wide, 0, 1)

    (wave_x, squares_x, paper_x), (wave_y, squares_y, paper_y) = (
        along(x, wide_x, BOARD.columns),
        along(y, wide_y, BOARD.rows),
    )
    share = np.nan_to_num(paper_x * paper_y)
    black = np.nan_to_num(squares_x * squares_y * (1 + wave_x * wave_y) / 2)
    return share, share * (PAPER + (INK - PAPER) * black)


@lru_cache(8)
def _field(lens: Lens) -> Array:
    """Return 1 where the lens shows the world and 0 in the dark around, per pixel."""
    v, u = np.mgrid[: lens.camera.height, : lens.camera.width].astype(float)
    theta = np.nan_to_num(lens.camera.angle_of(np.stack([u, v], -1)), nan=np.pi)
    rim = 1.5 / abs(lens.camera.model.params[0])
    light = np.clip((lens.far - theta) / rim + 0.5, 0, 1)
    return light * np.clip((theta - lens.near) / rim + 0.5, 0, 1) if lens.near > 0 else light


def _slope(size: tuple[int, int], factor: float, direction: float) -> Array:
    """Return a linear ramp of light over the image, brightest 1.2 times."""
    v, u = np.mgrid[: size[1], : size[0]].astype(float)
    along = (u - size[0] / 2) * np.cos(direction) + (v - size[1] / 2) * np.sin(direction)
    along = (along - along.min()) / np.ptp(along)
    return 1.2 * (1 / factor + (1 - 1 / factor) * along)


def clutter(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Draw what stands around: smooth light, boxes with corners, stripes, tiles and writing."""
    width, height = size
    scale = width / 1000
    light = np.full((height, width), 110.0)
    for cells, strength in ((4, 45), (12, 25), (60, 12), (250, 6)):
        rough = rng.normal(size=(max(2, cells * height // width), cells))
        light += strength * cv2.resize(rough, size, interpolation=cv2.INTER_CUBIC)
    image = np.clip(light, 15, 235).astype(np.uint8)
    for _ in range(110):
        middle, side = rng.uniform((0, 0), size), np.exp(rng.uniform(np.log(8), np.log(140), 2)) * scale
        turn, shade = rng.uniform(0, np.pi), rng.uniform(15, 235)
        corners = cv2.boxPoints((middle.tolist(), side.tolist(), float(np.degrees(turn))))
        if rng.random() < 0.3:
            corners = corners[:3]
        cv2.fillConvexPoly(image, np.rint(corners * 16).astype(np.int32), shade, cv2.LINE_AA, 4)
    for _ in range(7):
        _patch(image, rng, scale)
    return cv2.GaussianBlur(image.astype(float), (0, 0), 0.6)


def _patch(image: NDArray[np.uint8], rng: np.random.Generator, scale: float) -> None:
    """Draw a few tiles (up to 3x3 crossings), stripes, or a word: what a detector could take for part of a board."""
    kind, cell = rng.integers(3), rng.uniform(10, 34) * scale
    middle, turn = rng.uniform((0, 0), image.shape[::-1]), rng.uniform(0, np.pi)
    axes = np.array(((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn)))) * cell
    if kind == 2:
        word = "".join(rng.choice(list("HEXLMTFKAZ"), 6))
        place = tuple(int(c) for c in middle)
        cv2.putText(image, word, place, cv2.FONT_HERSHEY_DUPLEX, cell / 20, rng.uniform(10, 60), 2, cv2.LINE_AA)
        return
    columns, rows = (rng.integers(2, 5, 2)) if kind == 0 else (int(rng.integers(6, 14)), 1)
    dark, bright = rng.uniform(20, 70), rng.uniform(150, 220)
    for j in range(rows):
        for i in range(columns):
            tall = 4 if kind == 1 else 1
            box = np.array([(i, j * tall), (i + 1, j * tall), (i + 1, (j + 1) * tall), (i, (j + 1) * tall)]) @ axes
            shade = dark if (i + j) % 2 else bright
            cv2.fillConvexPoly(image, np.rint((middle + box) * 16).astype(np.int32), shade, cv2.LINE_AA, 4)


def _chunks(rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    for start in range(0, len(rows), PIXELS_AT_ONCE):
        yield rows[start : start + PIXELS_AT_ONCE]
