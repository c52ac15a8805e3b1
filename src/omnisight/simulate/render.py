"""Takes pictures of a room with boards in it, through any camera model, with the truth beside them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.simulate.board import BoardInScene
from omnisight.simulate.room import Room

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

RAYS_AT_ONCE = 400_000
RIM = 0.012  # radians over which the rim of the image circle fades


@dataclass(frozen=True, eq=False)
class Picture:
    """A rendered picture and its truth.

    Attributes
    ----------
    image
        (H, W, 3) uint8 RGB.
    corners
        For each board the exact pixels (N, 2) of its corners, in the order of `Checkerboard.points`.
    """

    image: NDArray[np.uint8]
    corners: tuple[Array, ...]


class Renderer:
    """A camera on a tripod in a room: the room is traced once, each picture then only its boards.

    Parameters
    ----------
    camera
        Any model. A negative fx mirrors the picture, as one mirror does.
    world_from_cam
        Where it stands in the room, metres; the room's frame unless told otherwise.
    room
        Furnished unless given.
    theta
        From which angle to which (radians from the axis) it sees the world: past the second its image circle ends,
        before the first a mirror shows the camera itself. Both are black.
    samples
        Rays per pixel and side.
    vignette
        How much darker the rim is than the middle.
    """

    def __init__(
        self,
        camera: Camera,
        world_from_cam: Pose | None = None,
        room: Room | None = None,
        *,
        theta: tuple[float, float] = (0.0, np.pi),
        samples: int = 2,
        vignette: float = 0.25,
    ) -> None:
        self.camera, self.theta, self.samples, self.vignette = camera, theta, samples, vignette
        pose, room = world_from_cam or Pose(), room or Room()
        world_from_bearing = pose.rotation.T.astype(np.float32)
        self._room = np.zeros((camera.height, camera.width, 3), np.float32)
        self._light = np.zeros((camera.height, camera.width, 1), np.float32)
        for rows in _chunks(slice(0, camera.height), camera.width * samples**2):
            bearings = self._bearings(rows, slice(0, camera.width), samples)
            self._room[rows] = _average(room.colours(pose.translation, bearings @ world_from_bearing), samples)
            self._light[rows] = _average(self._brightness(bearings)[..., None], samples)

    def __call__(
        self,
        boards: Sequence[BoardInScene] = (),
        rng: np.random.Generator | None = None,
        *,
        blur: float = 0.5,
        noise: float = 1.5,
    ) -> Picture:
        """Take a picture.

        Parameters
        ----------
        boards
            What is held up; the nearer hides the farther.
        rng
            Makes the sensor's noise; without it every picture has the same.
        blur
            Standard deviation of the lens' blur, px.
        noise
            Standard deviation of the sensor's noise, of 255.
        """
        import cv2

        scene = self._room.copy()
        for board in sorted(boards, key=lambda b: -b.distance):
            self._place(board, scene)
        scene *= self._light
        if blur > 0:
            scene = np.asarray(cv2.GaussianBlur(scene, (0, 0), blur))
        if noise > 0:
            rng = rng or np.random.default_rng(0)
            scene += np.float32(noise) * rng.standard_normal(scene.shape, np.float32)
        image = np.clip(np.rint(scene), 0, 255).astype(np.uint8)
        return Picture(image, tuple(board.corners(self.camera) for board in boards))

    def _place(self, board: BoardInScene, scene: Floats) -> None:
        """Draw a board into a scene, tracing only the pixels around its outline."""
        outline, valid = self.camera.project(board.outline())
        if not valid.any():
            return
        low, high = np.floor(outline[valid].min(0)) - 2, np.ceil(outline[valid].max(0)) + 3
        # Where part of the outline cannot be projected, the board may reach anywhere.
        (left, top), (right, bottom) = (low, high) if valid.all() else (np.zeros(2), np.array(self.camera.size))
        columns = slice(max(int(left), 0), min(int(right), self.camera.width))
        whole = slice(max(int(top), 0), min(int(bottom), self.camera.height))
        if columns.start >= columns.stop:
            return
        for rows in _chunks(whole, (columns.stop - columns.start) * self.samples**2):
            shade, hit = board.trace(self._bearings(rows, columns, self.samples))
            share = _average(hit[..., None].astype(np.float32), self.samples)
            paper = _average(np.where(hit, shade, 0)[..., None], self.samples)
            scene[rows, columns] = (1 - share) * scene[rows, columns] + paper

    def _bearings(self, rows: slice, columns: slice, samples: int) -> Floats:
        """Give the bearings (rows x samples, columns x samples, 3) of the rays of some pixels; NaN where not valid."""
        fine = (np.arange(samples) + 0.5) / samples - 0.5
        v = (np.arange(rows.start, rows.stop)[:, None] + fine).ravel()
        u = (np.arange(columns.start, columns.stop)[:, None] + fine).ravel()
        pixels = np.stack(np.broadcast_arrays(u, v[:, None]), -1)
        return self.camera.unproject(pixels)[0].astype(np.float32)

    def _brightness(self, bearings: Floats) -> Floats:
        theta = np.arctan2(np.hypot(bearings[..., 0], bearings[..., 1]), bearings[..., 2])
        near, far = self.theta
        light = 1 - np.float32(self.vignette) * (theta / min(far, np.pi)) ** 4
        light *= np.clip((far - theta) / RIM + 0.5, 0, 1) if far < np.pi else 1
        light *= np.clip((theta - near) / RIM + 0.5, 0, 1) if near > 0 else 1
        return np.nan_to_num(light).astype(np.float32)


def _average(rays: Floats, samples: int) -> Floats:
    """Average the rays of each pixel."""
    rows, columns, channels = rays.shape
    return rays.reshape(rows // samples, samples, columns // samples, samples, channels).mean((1, 3), dtype=np.float32)


def _chunks(rows: slice, rays_per_row: int) -> Iterator[slice]:
    """Cut rows into parts of bounded memory."""
    step = max(1, RAYS_AT_ONCE // max(rays_per_row, 1))
    for start in range(rows.start, rows.stop, step):
        yield slice(start, min(start + step, rows.stop))


def render(
    camera: Camera,
    boards: Sequence[BoardInScene] = (),
    rng: np.random.Generator | None = None,
    *,
    world_from_cam: Pose | None = None,
    room: Room | None = None,
    theta: tuple[float, float] = (0.0, np.pi),
    samples: int = 2,
    vignette: float = 0.25,
    blur: float = 0.5,
    noise: float = 1.5,
) -> Picture:
    """Take one picture; see `Renderer`, which is for several from one place."""
    renderer = Renderer(camera, world_from_cam, room, theta=theta, samples=samples, vignette=vignette)
    return renderer(boards, rng, blur=blur, noise=noise)
