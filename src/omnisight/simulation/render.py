"""Takes images of a scene through any camera, by casting rays, with the truth beside them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.parallel import parallel_for
from omnisight.simulation.board import BoardInScene
from omnisight.simulation.camera_protocol import RenderableCamera
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes import scene_named
from omnisight.simulation.sensor import develop

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Poses = Pose | Sequence[Pose]

RAYS_AT_ONCE = 400_000
RIM = 0.012  # radians over which the rim of the image circle fades
GRAIN = 8  # rows worth a thread
SETTLED = 4  # times that the row of a pixel of a rolling shutter is asked for
HIDDEN = 1e-6  # of the distance, by which what hides a point is nearer


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """A rendered image.

    Attributes
    ----------
    image
        (H, W, 3) uint8 RGB.
    corners
        For each board the exact pixels (N, 2) of its points, in the order of `Board.points`.
    """

    image: NDArray[np.uint8]
    corners: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """What each pixel's middle sees; NaN, and instance 0, where that is the sky or nothing.

    Attributes
    ----------
    depth
        (H, W) metres along the bearing, from the ray's origin.
    normals
        (H, W, 3) unit, in the camera's frame, towards the camera.
    instances
        (H, W), 1 + the place in `Scene.names`.
    points
        (H, W, 3) in the world.
    """

    depth: Array
    normals: Array
    instances: NDArray[np.int32]
    points: Array


class Renderer:
    """A camera in its place: the scene is painted once, each image then only where its boards are.

    Parameters
    ----------
    camera
        Anything with `rays`, `project` and `size`. A negative fx mirrors the image, as one mirror does.
    world_from_cam
        Where it stands, metres; or where it is as each row of the image is read, for a rolling shutter. The scene's
        frame unless told otherwise.
    scene
        The room unless given.
    theta
        From which angle to which (radians from the axis) it sees the world: past the second its image circle ends,
        before the first a mirror shows the camera itself. Both are black.
    samples
        Rays per pixel and side.
    vignette
        How much less light the rim gets than the middle.

    Raises
    ------
    ValueError
        If there are not as many poses as rows.
    """

    def __init__(
        self,
        camera: RenderableCamera,
        world_from_cam: Poses | None = None,
        scene: Scene | None = None,
        *,
        theta: tuple[float, float] = (0.0, np.pi),
        samples: int = 2,
        vignette: float = 0.35,
    ) -> None:
        self.camera, self.theta, self.samples, self.vignette = camera, theta, samples, vignette
        self.scene = scene_named("room") if scene is None else scene
        self._width, self._height = camera.size
        poses = world_from_cam if isinstance(world_from_cam, Sequence) else [world_from_cam or Pose()] * self._height
        if len(poses) != self._height:
            raise ValueError(f"an image of {self._height} rows needs as many poses, got {len(poses)}")
        self._rotations = np.array([pose.rotation for pose in poses], float)
        self._eyes = np.array([pose.translation for pose in poses], float)

    @property
    def world_from_cam(self) -> Pose:
        """Where the camera is; for a rolling shutter, as it reads its middle row."""
        return Pose(self._rotations[self._height // 2], self._eyes[self._height // 2])

    def __call__(
        self,
        boards: Sequence[BoardInScene] = (),
        rng: np.random.Generator | None = None,
        *,
        exposure: float = 0.0,
        blur: float = 0.7,
        noise: float = 1.5,
        jpeg: int | None = None,
    ) -> RenderedImage:
        """Take an image.

        Parameters
        ----------
        boards
            What is held up.
        rng
            Makes the sensor's noise; without it every image has the same.
        exposure, blur, noise, jpeg
            See `develop`.
        """
        light = self.light(boards)
        image = develop(light, rng or np.random.default_rng(0), exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
        if self._still:
            return RenderedImage(image, tuple(board.corners(self.camera) for board in boards))
        in_world = [self.world_from_cam @ (board.cam_from_board @ board.board.points) for board in boards]
        return RenderedImage(image, tuple(self._settled(points)[0] for points in in_world))

    def light(self, boards: Sequence[BoardInScene] = ()) -> Floats:
        """Give the light (H, W, 3) that falls on the sensor, 1 for white."""
        if not boards:
            return self._empty.copy()
        scene = self._with(boards)
        # A board's shadow falls anywhere, and each row of a rolling shutter sees it elsewhere.
        if self.scene.sun[1] > 0 or not self._still:
            return self._painted(scene, slice(0, self._height), slice(0, self._width))
        light = self._empty.copy()
        for board in boards:
            window = self._window(board)
            light[window] = self._painted(scene, *window)
        return light

    def truth(self, boards: Sequence[BoardInScene] = ()) -> GroundTruth:
        """Give what each pixel's middle sees, exactly."""
        scene = self._with(boards)
        shape = (self._height, self._width)
        depth, normals, points = np.empty(shape), np.empty((*shape, 3)), np.empty((*shape, 3))
        instances = np.empty(shape, np.int32)
        for rows in _chunks(slice(0, self._height), self._width):
            rays = self._rays(rows, slice(0, self._width), 1)
            turn = self._rotations[rows]
            origins = rays.origins @ turn.transpose(0, 2, 1) + self._eyes[rows, None]
            bearings = rays.bearings @ turn.transpose(0, 2, 1)
            bearings[~self._sees(rays.bearings)] = np.nan
            hits = scene.cast(origins, bearings)
            depth[rows], instances[rows] = hits.distances, hits.instances
            normals[rows] = hits.normals @ turn
            points[rows] = origins + hits.distances[..., None] * bearings
        return GroundTruth(depth, normals, instances, points)

    def locate(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Say where points of the world are seen.

        Parameters
        ----------
        points
            (..., 3), on the surfaces of the scene such as `GroundTruth.points`.

        Returns
        -------
        pixels
            (..., 2), NaN where not seen.
        seen
            (...), whether the point is in the image and nothing of the scene hides it.
        """
        x = np.asarray(points, float)
        pixels, valid, row = self._settled(x)
        with np.errstate(invalid="ignore"):
            valid = valid & ((pixels >= -0.5) & (pixels < np.array(self.camera.size) - 0.5)).all(-1)
        rays = self.camera.rays(np.where(valid[..., None], pixels, np.nan))
        valid &= rays.valid & self._sees(rays.bearings)
        origins = np.einsum("...ij,...j->...i", self._rotations[row], rays.origins) + self._eyes[row]
        with np.errstate(invalid="ignore"):
            distance = np.linalg.norm(x - origins, axis=-1)
            met = self.scene.cast(origins, np.where(valid[..., None], (x - origins) / distance[..., None], np.nan))
            valid &= ~(met.distances < distance * (1 - HIDDEN))
        return np.where(valid[..., None], pixels, np.nan), valid

    @cached_property
    def _still(self) -> bool:
        return bool((self._rotations == self._rotations[0]).all() and (self._eyes == self._eyes[0]).all())

    def _settled(self, points: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
        """Project points of the world, each by the pose of the row that it falls on; give that row too."""
        row = np.full(points.shape[:-1], self._height // 2)
        pixels, valid = self._projected(points, row)
        for _ in range(0 if self._still else SETTLED):
            row = np.clip(np.rint(np.nan_to_num(pixels[..., 1])), 0, self._height - 1).astype(np.int64)
            pixels, valid = self._projected(points, row)
        return pixels, valid, row

    def _projected(self, points: Array, row: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the world by the poses of rows."""
        return self.camera.project(np.einsum("...ji,...j->...i", self._rotations[row], points - self._eyes[row]))

    @cached_property
    def _empty(self) -> Floats:
        return self._painted(self.scene, slice(0, self._height), slice(0, self._width))

    def _with(self, boards: Sequence[BoardInScene]) -> Scene:
        if not boards:
            return self.scene
        pose = self.world_from_cam
        return self.scene.with_solids([b.solid(pose, f"board {i + 1}") for i, b in enumerate(boards)])

    def _painted(self, scene: Scene, whole: slice, columns: slice) -> Floats:
        """Give the light of some rows and columns."""
        from omnisight.simulation import _shading

        result = np.zeros((whole.stop - whole.start, columns.stop - columns.start, 3), np.float32)
        world = scene.world_with_light
        for rows in _chunks(whole, (columns.stop - columns.start) * self.samples**2):
            rays = self._rays(rows, columns, self.samples)
            part = result[rows.start - whole.start : rows.stop - whole.start]
            fixed: Any = (world, rays.origins, rays.bearings, self._rotations[rows], self._eyes[rows], self.samples)
            parallel_for(lambda first, last, f=fixed, p=part: _shading.paint(*f, p, first, last), len(part), GRAIN)
            if self.vignette or self.theta != (0.0, np.pi):
                middles = rays if self.samples == 1 else self._rays(rows, columns, 1)
                part *= self._brightness(middles.bearings)[..., None]
        return result

    def _window(self, board: BoardInScene) -> tuple[slice, slice]:
        """Give the rows and columns in which a board can be seen."""
        outline, valid = self.camera.project(board.outline())
        if not valid.all():  # it may reach anywhere
            return slice(0, self._height), slice(0, self._width)
        low, high = np.floor(outline.min(0)) - 2, np.ceil(outline.max(0)) + 3
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, self.camera.size)
        return slice(int(top), max(int(bottom), int(top))), slice(int(left), max(int(right), int(left)))

    def _rays(self, rows: slice, columns: slice, samples: int) -> Rays:
        """Give the rays (rows x samples, columns x samples) of some pixels in the camera's frame."""
        fine = (np.arange(samples) + 0.5) / samples - 0.5
        v = (np.arange(rows.start, rows.stop)[:, None] + fine).ravel()
        u = (np.arange(columns.start, columns.stop)[:, None] + fine).ravel()
        return self.camera.rays(np.stack(np.broadcast_arrays(u, v[:, None]), -1))

    def _sees(self, bearings: Array) -> NDArray[np.bool_]:
        if self.theta == (0.0, np.pi):
            return ~np.isnan(bearings[..., 0])
        theta = angle_from_axis(bearings)
        with np.errstate(invalid="ignore"):
            return (theta >= self.theta[0]) & (theta <= self.theta[1])

    def _brightness(self, bearings: Array) -> Floats:
        theta = angle_from_axis(bearings)
        near, far = self.theta
        light = 1 - self.vignette * (theta / min(far, np.pi)) ** 4
        light *= np.clip((far - theta) / RIM + 0.5, 0, 1) if far < np.pi else 1
        light *= np.clip((theta - near) / RIM + 0.5, 0, 1) if near > 0 else 1
        return np.nan_to_num(light).astype(np.float32)


def _chunks(rows: slice, rays_per_row: int) -> Iterator[slice]:
    """Cut rows into parts of bounded memory."""
    step = max(1, RAYS_AT_ONCE // max(rays_per_row, 1))
    for start in range(rows.start, rows.stop, step):
        yield slice(start, min(start + step, rows.stop))


def dense_correspondences(first: Renderer, second: Renderer) -> Array:
    """Give for each pixel of the first image where the second shows the same point: pixels (H, W, 2).

    NaN where it does not: outside its image, hidden there, or no point at all.
    """
    return second.locate(first.truth().points)[0]


def render(
    camera: RenderableCamera,
    boards: Sequence[BoardInScene] = (),
    rng: np.random.Generator | None = None,
    *,
    world_from_cam: Poses | None = None,
    scene: Scene | None = None,
    theta: tuple[float, float] = (0.0, np.pi),
    samples: int = 2,
    vignette: float = 0.35,
    exposure: float = 0.0,
    blur: float = 0.7,
    noise: float = 1.5,
    jpeg: int | None = None,
) -> RenderedImage:
    """Take one image; see `Renderer`, which is for several from one place."""
    renderer = Renderer(camera, world_from_cam, scene, theta=theta, samples=samples, vignette=vignette)
    return renderer(boards, rng, exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
