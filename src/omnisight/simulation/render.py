"""Rendering of a scene through any camera by ray casting, with ground truth."""

from collections.abc import Iterator, Sequence
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
from omnisight.simulation.rendered import GroundTruth, RenderedImage
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes import scene_named
from omnisight.simulation.sensor import develop
from omnisight.simulation.vignetting import lens_extent

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Poses = Pose | Sequence[Pose]

# Rays held in memory at a time.
MAX_RAYS = 400_000
# Width of the soft edge of the image circle.
EDGE_RAD = 0.012
# Image rows per task of a thread.
ROWS_PER_TASK = 8
# Fixed-point iterations for the row, and thus the pose, of a point under a rolling shutter.
ROLLING_SHUTTER_ITERATIONS = 4
# A point is hidden if something is nearer by more than this share of its distance.
OCCLUSION_TOLERANCE = 1e-6


class Renderer:
    """A renderer for one camera pose. The scene is rendered once; for each image only the regions of boards are redone.

    Parameters
    ----------
    camera
        Any object with `rays`, `project` and `size`. A negative fx mirrors the image, as a mirror does.
    world_from_cam
        Pose, metres; or one pose for each image row, for a rolling shutter. The default is the scene frame.
    scene
        The room by default.
    theta
        Range of angles from the axis (radians) in view. The image is black outside the image circle (beyond the second)
        and where a mirror shows the camera itself (below the first).
    samples
        Rays per side of a pixel.
    vignette
        Relative loss of light at the edge of the lens's image: the image circle, or the farthest corner. It grows with
        the fourth power of the distance from the principal point. Panoramas have none.
    shutter_poses
        Poses at equal steps of time during the exposure, for motion blur: at each, one of the rays of every pixel is
        traced. Ground truth is that of `world_from_cam`.

    Raises
    ------
    ValueError
        If the number of poses differs from the number of rows.
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
        shutter_poses: Sequence[Poses] = (),
    ) -> None:
        self.camera, self.theta, self.samples, self.vignette = camera, theta, samples, vignette
        self.scene = scene_named("room") if scene is None else scene
        self._width, self._height = camera.size
        self._rotations, self._eyes = self._row_poses(Pose() if world_from_cam is None else world_from_cam)
        self._shutter = [self._row_poses(poses) for poses in shutter_poses]

    def _row_poses(self, poses: Poses) -> tuple[Array, Array]:
        """Return the rotations (H, 3, 3) and translations (H, 3) of the rows."""
        rows = poses if isinstance(poses, Sequence) else [poses] * self._height
        if len(rows) != self._height:
            raise ValueError(f"an image of {self._height} rows needs as many poses, got {len(rows)}")
        return np.array([pose.rotation for pose in rows], float), np.array([pose.translation for pose in rows], float)

    @property
    def world_from_cam(self) -> Pose:
        """Pose of the camera; for a rolling shutter, that of the middle row."""
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
        """Render an image.

        Parameters
        ----------
        boards
            Boards in front of the camera.
        rng
            Source of the sensor noise; by default a fixed seed.
        exposure, blur, noise, jpeg
            See `develop`.
        """
        light = self.light(boards)
        image = develop(light, rng or np.random.default_rng(0), exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
        if self._still:
            return RenderedImage(image, tuple(board.corners(self.camera) for board in boards))
        in_world = [self.world_from_cam @ (board.cam_from_board @ board.board.points) for board in boards]
        return RenderedImage(image, tuple(self._project_world(points)[0] for points in in_world))

    def light(self, boards: Sequence[BoardInScene] = ()) -> Floats:
        """Return the light (H, W, 3) on the sensor, 1 for white."""
        if not boards:
            return self._background.copy()
        scene = self._scene_with(boards)
        # A shadow can be anywhere, and with several poses each sees the board elsewhere.
        if self.scene.sun[1] > 0 or not self._still or self._shutter:
            return self._render(scene, slice(0, self._height), slice(0, self._width))
        light = self._background.copy()
        for board in boards:
            window = self._window(board)
            light[window] = self._render(scene, *window)
        return light

    def truth(self, boards: Sequence[BoardInScene] = ()) -> GroundTruth:
        """Return the exact ground truth at the pixel centres."""
        scene = self._scene_with(boards)
        shape = (self._height, self._width)
        depth, normals, points = np.empty(shape), np.empty((*shape, 3)), np.empty((*shape, 3))
        instances = np.empty(shape, np.int32)
        for rows in _chunks(slice(0, self._height), self._width):
            rays = self._rays(rows, slice(0, self._width), 1)
            turn = self._rotations[rows]
            origins = rays.origins @ turn.transpose(0, 2, 1) + self._eyes[rows, None]
            bearings = rays.bearings @ turn.transpose(0, 2, 1)
            bearings[~self._in_view(rays.bearings)] = np.nan
            hits = scene.cast(origins, bearings)
            depth[rows], instances[rows] = hits.distances, hits.instances
            normals[rows] = hits.normals @ turn
            points[rows] = origins + hits.distances[..., None] * bearings
        return GroundTruth(depth, normals, instances, points)

    def locate(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the world into the image, with occlusion.

        Parameters
        ----------
        points
            (..., 3), on the surfaces of the scene, such as `GroundTruth.points`.

        Returns
        -------
        pixels
            (..., 2), NaN where not visible.
        visible
            (...), whether the point is in the image and not occluded.
        """
        x = np.asarray(points, float)
        pixels, valid, row = self._project_world(x)
        with np.errstate(invalid="ignore"):
            valid = valid & ((pixels >= -0.5) & (pixels < np.array(self.camera.size) - 0.5)).all(-1)
        rays = self.camera.rays(np.where(valid[..., None], pixels, np.nan))
        valid &= rays.valid & self._in_view(rays.bearings)
        origins = np.einsum("...ij,...j->...i", self._rotations[row], rays.origins) + self._eyes[row]
        with np.errstate(invalid="ignore"):
            distance = np.linalg.norm(x - origins, axis=-1)
            hits = self.scene.cast(origins, np.where(valid[..., None], (x - origins) / distance[..., None], np.nan))
            valid &= ~(hits.distances < distance * (1 - OCCLUSION_TOLERANCE))
        return np.where(valid[..., None], pixels, np.nan), valid

    @cached_property
    def _still(self) -> bool:
        return bool((self._rotations == self._rotations[0]).all() and (self._eyes == self._eyes[0]).all())

    def _project_world(self, points: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
        """Project points of the world, each by the pose of the row it falls on; return that row too."""
        row = np.full(points.shape[:-1], self._height // 2)
        pixels, valid = self._project_by_row(points, row)
        for _ in range(0 if self._still else ROLLING_SHUTTER_ITERATIONS):
            row = np.clip(np.rint(np.nan_to_num(pixels[..., 1])), 0, self._height - 1).astype(np.int64)
            pixels, valid = self._project_by_row(points, row)
        return pixels, valid, row

    def _project_by_row(self, points: Array, row: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the world by the poses of rows."""
        return self.camera.project(np.einsum("...ji,...j->...i", self._rotations[row], points - self._eyes[row]))

    @cached_property
    def _background(self) -> Floats:
        return self._render(self.scene, slice(0, self._height), slice(0, self._width))

    def _scene_with(self, boards: Sequence[BoardInScene]) -> Scene:
        if not boards:
            return self.scene
        pose = self.world_from_cam
        return self.scene.with_solids([b.solid(pose, f"board {i + 1}") for i, b in enumerate(boards)])

    def _render(self, scene: Scene, whole: slice, columns: slice) -> Floats:
        """Return the light of a window of rows and columns."""
        from omnisight.simulation import _render_rows

        result = np.zeros((whole.stop - whole.start, columns.stop - columns.start, 3), np.float32)
        world = scene.world_with_light
        # One of the rays of each pixel at each pose of the exposure, or all of them at one pose.
        moments = self._shutter or [(self._rotations, self._eyes)]
        order = np.random.default_rng(0).permutation(self.samples**2)
        for rows in _chunks(whole, (columns.stop - columns.start) * self.samples**2):
            rays = self._rays(rows, columns, self.samples)
            part = result[rows.start - whole.start : rows.stop - whole.start]
            for k, (rotations, eyes) in enumerate(moments):
                light, only = np.empty_like(part), int(order[k % len(order)]) if self._shutter else -1
                poses = rotations[rows], eyes[rows]
                fixed: Any = (world, rays.origins, rays.bearings, *poses, self.samples, only, light)
                parallel_for(
                    lambda first, last, f=fixed: _render_rows.render_rows(
                        *f, scratch_arrays(self.samples), first, last
                    ),
                    len(part),
                    ROWS_PER_TASK,
                )
                part += light / len(moments)
            if self.vignette or self.theta != (0.0, np.pi):
                part *= self.vignetting(rows, columns)[..., None]
        return result

    def _window(self, board: BoardInScene) -> tuple[slice, slice]:
        """Return the rows and columns that contain a board."""
        outline, valid = self.camera.project(board.outline())
        if not valid.all():  # the extent in the image is unknown
            return slice(0, self._height), slice(0, self._width)
        low, high = np.floor(outline.min(0)) - 2, np.ceil(outline.max(0)) + 3
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, self.camera.size)
        return slice(int(top), max(int(bottom), int(top))), slice(int(left), max(int(right), int(left)))

    def _rays(self, rows: slice, columns: slice, samples: int) -> Rays:
        """Return the rays (rows x samples, columns x samples) of a window in the camera frame."""
        fine = (np.arange(samples) + 0.5) / samples - 0.5
        v = (np.arange(rows.start, rows.stop)[:, None] + fine).ravel()
        u = (np.arange(columns.start, columns.stop)[:, None] + fine).ravel()
        return self.camera.rays(np.stack(np.broadcast_arrays(u, v[:, None]), -1))

    def _in_view(self, bearings: Array) -> NDArray[np.bool_]:
        if self.theta == (0.0, np.pi):
            return ~np.isnan(bearings[..., 0])
        theta = angle_from_axis(bearings)
        with np.errstate(invalid="ignore"):
            return (theta >= self.theta[0]) & (theta <= self.theta[1])

    def vignetting(self, rows: slice = slice(None), columns: slice = slice(None)) -> Floats:
        """Return the share of light (H, W) that reaches each pixel of a window: the lens's, and its image circle's."""
        v, u = np.arange(self._height)[rows], np.arange(self._width)[columns]
        light = np.ones((len(v), len(u)))
        if self.vignette and self._lens_extent is not None:
            (cx, cy), radius = self._lens_extent
            light -= self.vignette * np.minimum(np.hypot(u - cx, v[:, None] - cy) / radius, 1) ** 4
        near, far = self.theta
        if self.theta != (0.0, np.pi) and light.size:
            theta = angle_from_axis(self._rays(_bounds(v), _bounds(u), 1).bearings)
            light *= np.clip((far - theta) / EDGE_RAD + 0.5, 0, 1) if far < np.pi else 1
            light *= np.clip((theta - near) / EDGE_RAD + 0.5, 0, 1) if near > 0 else 1
        return np.nan_to_num(light).astype(np.float32)

    @cached_property
    def _lens_extent(self) -> tuple[tuple[float, float], float] | None:
        return lens_extent(self.camera, self._in_view)


def scratch_arrays(samples: int) -> tuple[NDArray[Any], ...]:
    """Return the working memory of a thread for the rays of a pixel; see `_render_rows.render_rows`."""
    count = samples**2
    rays, shadows = np.empty((2, count, 3)), np.empty((2, count, 3))
    places, hits, hidden = np.empty((count, 2), np.int64), np.empty((count, 2), np.int64), np.empty(count, np.int64)
    return rays, places, np.empty((count, 5)), shadows, np.empty((count, 6)), np.empty(count), hits, hidden


def _bounds(indices: NDArray[np.int64]) -> slice:
    """Return the slice of consecutive indices."""
    return slice(int(indices[0]), int(indices[-1]) + 1)


def _chunks(rows: slice, rays_per_row: int) -> Iterator[slice]:
    """Split rows into parts of bounded memory."""
    step = max(1, MAX_RAYS // max(rays_per_row, 1))
    for start in range(rows.start, rows.stop, step):
        yield slice(start, min(start + step, rows.stop))


def dense_correspondences(first: Renderer, second: Renderer) -> Array:
    """Return for each pixel of the first image the pixel (H, W, 2) of the same scene point in the second.

    NaN where the point is outside the second image or occluded, or there is no point.
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
    """Render one image. Use `Renderer` for several images from one pose; it documents the parameters."""
    renderer = Renderer(camera, world_from_cam, scene, theta=theta, samples=samples, vignette=vignette)
    return renderer(boards, rng, exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
