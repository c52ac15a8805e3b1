"""Resection: the pose of each board from the bearings of its points, without an initial guess."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._resection_kernel import MIN_CHORD_RAD, ROBUST_SCALE, refine_poses, squared_chords
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.loss import geman_mcclure_weights
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Poses = tuple[Array, Array]

# A pose from a plane needs four points; two more give a residual that reveals a wrong one.
MIN_POINTS = 6
# Rounds of iteratively reweighted linear least squares.
LINEAR_ROUNDS = 2
# Thickness of a point set relative to its size above which it is also posed as points in space.
MIN_RELATIVE_THICKNESS = 0.03
# Distance (in board units) of a board that cannot be posed yet.
UNKNOWN_DISTANCE = 1e3
# Median residual relative to that of the other views above which a pose may be a wrong local minimum.
POSE_OUTLIER_RATIO = 4.0
# Residual length (px) above which a corner does not contribute to the choice between two poses.
MAX_COMPARED_PX = 50.0


def resect(model: CameraModel, observations: Observations) -> State:
    """Estimate the pose of every board by a central camera."""
    return resolve_flip(resect_linear(model, observations), observations)


def resect_linear(model: CameraModel, observations: Observations) -> State:
    """Estimate the pose of every board linearly; a board that cannot be posed is placed far ahead."""
    return resect_linear_each([model], observations)[0]


def resect_linear_each(models: Sequence[CameraModel], observations: Observations) -> list[State]:
    """Estimate the pose of every board linearly by each of several cameras."""
    if not models:
        return []
    bearings = np.stack([model.unproject_numpy(observations.pixels)[0] for model in models])
    rotations, translations = linear_board_poses(observations, bearings)
    unknown = ~np.isfinite(rotations).all((2, 3))
    rotations[unknown], translations[unknown] = np.eye(3), (0.0, 0.0, UNKNOWN_DISTANCE)
    return [State(*camera) for camera in zip(models, rotations, translations, strict=True)]


def resolve_flip(state: State, observations: Observations) -> State:
    """Refine every pose and its mirror image about the line of sight on the sphere, and keep the better one."""
    bearings, _ = state.central_model.unproject_numpy(observations.pixels)
    return State(state.model, *refine_board_poses(observations, bearings, state.rotations, state.translations))


def reresect(state: State, observations: Observations) -> State:
    """Estimate every pose anew and keep the better one: corrects boards behind the camera or flipped."""
    fresh = resect(state.central_model, observations)
    starts = observations.starts[:-1]
    old, new = (np.add.reduceat(np.minimum(s.lengths(observations), MAX_COMPARED_PX), starts) for s in (state, fresh))
    better = new < old
    return replace(
        state,
        rotations=np.where(better[:, None, None], fresh.rotations, state.rotations),
        translations=np.where(better[:, None], fresh.translations, state.translations),
    )


def has_pose_outlier(state: State, observations: Observations) -> bool:
    """Return whether the residuals of a view exceed those of the others so much that its pose may be wrong."""
    lengths = state.lengths(observations)
    medians = [float(np.median(lengths[rows])) for rows in observations.groups]
    return max(medians) > POSE_OUTLIER_RATIO * float(np.median(medians))


def linear_board_poses(observations: Observations, bearings: Array) -> Poses:
    """Estimate cam_from_board of every view from the bearings of its points, robustly and without an initial guess.

    Each board is posed twice: as an affine image of a plane seen from far, and linearly as a plane seen from near; the
    pose with the smaller robust error is kept. The plane is that of the points observed in the view. Points that lie on
    no plane are posed in both ways as points in space too.

    Parameters
    ----------
    observations
        Board points; their pixels are not used.
    bearings
        (..., N, 3) unit, by one or more cameras; rows of NaN are ignored.

    Returns
    -------
    rotations, translations
        (..., V, 3, 3) and (..., V, 3), NaN for a view with fewer than `MIN_POINTS` points.
    """
    groups = _Groups(observations, bearings.reshape(-1, 3))
    poses = groups.better(_near_plane_poses(groups), _far_plane_poses(groups))
    if (groups.thickness > MIN_RELATIVE_THICKNESS).any():
        poses = groups.better(poses, groups.better(_near_space_poses(groups), _far_space_poses(groups)))
    rotations, translations = poses
    rotations[groups.count < MIN_POINTS], translations[groups.count < MIN_POINTS] = np.nan, np.nan
    lead = *bearings.shape[:-2], len(observations)
    return rotations.reshape(*lead, 3, 3), translations.reshape(*lead, 3)


def refine_board_poses(observations: Observations, bearings: Array, rotations: Array, translations: Array) -> Poses:
    """Refine poses on the sphere, each also started from its mirror image, robustly.

    A small or far board looks nearly the same when its tilt is mirrored about the line of sight: the cost has two
    minima (Schweighofer and Pinz, Robust pose estimation from a planar target, PAMI 2006). Both are refined, and the
    better one is kept.

    Parameters
    ----------
    observations
        Board points; their pixels are not used.
    bearings
        (N, 3) unit; rows of NaN are ignored.
    rotations, translations
        (V, 3, 3) and (V, 3), finite: the initial poses.
    """
    groups = _Groups(observations, bearings)
    starts = (rotations, translations), groups.mirrored(rotations, translations)
    poses, mirrored = (np.concatenate([r, t[:, :, None]], -1) for r, t in starts)
    used = groups.use > 0
    refine_poses(groups.points[used], groups.bearings[used], np.append(0, np.cumsum(groups.count)), poses, mirrored)
    return poses[:, :, :3].copy(), poses[:, :, 3].copy()


def _near_plane_poses(groups: "_Groups") -> Poses:
    """Pose planes linearly: a point (X, Y, 0) has the bearing H (X, Y, 1) up to scale, with H = [r1 r2 t]."""
    h = _direct_linear_transform(groups, _homogeneous(groups.plane))
    scale = np.sqrt(np.linalg.norm(h[:, :, 0], axis=1) * np.linalg.norm(h[:, :, 1], axis=1))
    r1, r2, t = np.moveaxis(h / np.where(scale > 0, scale, 1.0)[:, None, None], -1, 0)
    return groups.in_board_frame(np.stack([r1, r2, np.cross(r1, r2)], -1), t)


def _near_space_poses(groups: "_Groups") -> Poses:
    """Pose points in space linearly: a point X has the bearing [R t] (X, 1) up to scale."""
    h = _direct_linear_transform(groups, _homogeneous(groups.local))
    scale = np.cbrt(np.abs(np.linalg.det(h[:, :, :3])))[:, None, None]
    h = h / np.where(scale > 1e-12, scale, 1.0)
    return groups.in_board_frame(h[:, :, :3], h[:, :, 3])


def _direct_linear_transform(groups: "_Groups", x: Array) -> Array:
    """Return the matrices (V, 3, K) that map coordinates x (N, K) to the bearings b, in least squares.

    b x H x = 0: 3 K unknowns up to scale, whatever the angle from the axis (Hartley and Zisserman, Multiple view
    geometry, ch. 7 and 8, on the sphere). The sign puts the points at positive distances along their bearings.
    """
    b, k = groups.bearings, x.shape[1]
    weight, h = groups.nearby, np.zeros((len(groups.count), 3, k))
    for _ in range(LINEAR_ROUNDS):
        _, vectors = np.linalg.eigh(_bearing_map_normals(groups, x, weight))
        h = vectors[:, :, 0].reshape(-1, 3, k)
        seen = np.einsum("nij,nj->ni", h[groups.view], x)
        ahead = np.einsum("ni,ni->n", seen, b)
        h *= np.where(groups.sum(weight * ahead) < 0, -1.0, 1.0)[:, None, None]
        squares = np.maximum((seen**2).sum(-1), 1e-300)
        weight = groups.weights(2 - 2 * np.abs(ahead) / np.sqrt(squares)) / squares
    return h


def _bearing_map_normals(groups: "_Groups", x: Array, weight: Array) -> Array:
    """Return the normal equations (V, 3 K, 3 K) of b x H x = 0 for the elements of H (3, K), given x (N, K)."""
    k = x.shape[1]
    products = (groups.bearings[:, :, None] * x[:, None, :]).reshape(-1, 3 * k)
    # [b]x^T [b]x = I - b b^T for a unit b.
    across = np.einsum("ij,vpq->vipjq", np.eye(3), groups.gram(x, weight)).reshape(-1, 3 * k, 3 * k)
    return across - groups.gram(products, weight)


def _far_plane_poses(groups: "_Groups") -> Poses:
    """Pose planes under weak perspective: directions are an affine map of the plane.

    Its larger singular value is the scale; the smaller one gives the tilt up to its sign.
    """
    frame, affine = _affine_transform(groups, _homogeneous(groups.plane))
    columns = np.swapaxes(affine[:, :2], 1, 2)
    scale = np.maximum(np.linalg.svd(columns, compute_uv=False)[:, 0], 1e-12)
    first, second = np.moveaxis(columns / scale[:, None, None], -1, 0)
    z1, z2 = (np.sqrt(np.maximum(1 - (p**2).sum(-1), 0)) for p in (first, second))
    z2 = np.where((first * second).sum(-1) > 0, -z2, z2)
    r1, r2 = np.column_stack([first, z1]), np.column_stack([second, z2])
    t = np.column_stack([affine[:, 2], np.ones(len(scale))]) / scale[:, None]
    return groups.in_board_frame(frame @ np.stack([r1, r2, np.cross(r1, r2)], -1), np.einsum("vij,vj->vi", frame, t))


def _far_space_poses(groups: "_Groups") -> Poses:
    """Pose points in space under weak perspective: the nearest two rows of a rotation, times the scale."""
    frame, affine = _affine_transform(groups, _homogeneous(groups.local))
    left, values, right = np.linalg.svd(np.swapaxes(affine[:, :3], 1, 2), full_matrices=False)
    scale = np.maximum(values.mean(1), 1e-12)
    r1, r2 = np.moveaxis(left @ right, 1, 0)
    t = np.column_stack([affine[:, 3], np.ones(len(scale))]) / scale[:, None]
    return groups.in_board_frame(frame @ np.stack([r1, r2, np.cross(r1, r2)], 1), np.einsum("vij,vj->vi", frame, t))


def _affine_transform(groups: "_Groups", x: Array) -> tuple[Array, Array]:
    """Return frames (V, 3, 3) about the middle of each view, and affine maps (V, K, 2) of coordinates x (N, K) there.

    Directions are projected stereographically about the middle: finite for all but the opposite direction.
    """
    middle = groups.middle / np.maximum(np.linalg.norm(groups.middle, axis=1), 1e-300)[:, None]
    least = np.eye(3)[np.abs(middle).argmin(1)]
    right = np.cross(least, middle)
    right /= np.maximum(np.linalg.norm(right, axis=1), 1e-300)[:, None]
    frame = np.stack([right, np.cross(middle, right), middle], -1)
    local = np.einsum("nij,ni->nj", frame[groups.view], groups.bearings)
    y = 2 * local[:, :2] / np.maximum(1 + local[:, 2:], 1e-3)
    weight, affine = groups.nearby, np.zeros((len(groups.count), x.shape[1], 2))
    for _ in range(LINEAR_ROUNDS):
        normal = groups.gram(x, weight) + 1e-12 * np.eye(x.shape[1])
        affine = np.asarray(np.linalg.solve(normal, groups.gram(x, weight, y)), float)
        weight = groups.weights(((np.einsum("ni,nij->nj", x, affine[groups.view]) - y) ** 2).sum(-1))
    return frame, affine


def _reflection(normals: Array) -> Array:
    """Return the reflections (V, 3, 3) about the planes across normals (V, 3)."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    return np.eye(3) - 2 * unit[:, :, None] * unit[:, None, :]


def _homogeneous(x: Array) -> Array:
    return np.concatenate([x, np.ones((len(x), 1))], -1)


class _Groups:
    """The points of each view of each camera that have a bearing, and sums and medians over them.

    The M cameras have N bearings each; their views count separately.
    """

    def __init__(self, observations: Observations, bearings: Array) -> None:
        rows, views = len(observations.points), len(observations)
        cameras = len(bearings) // max(rows, 1)
        self.points = np.tile(observations.points, (cameras, 1))
        self.view = (observations.view_of_row + views * np.arange(cameras)[:, None]).ravel()
        starts = observations.starts[:-1] + rows * np.arange(cameras)[:, None]
        self.starts = np.append(starts.ravel(), rows * cameras)
        finite: NDArray[np.bool_] = np.all(np.isfinite(bearings), axis=-1)
        self.use = finite.astype(float)
        self.bearings = np.where(finite[:, None], bearings, 0.0)
        self.count = np.bincount(self.view, self.use, views * cameras).astype(np.intp)
        # Row and column of each point in a table with one row per view.
        self.place = np.arange(len(self.view)) - self.starts[self.view]
        self.table = views * cameras, int(self.place.max(initial=0)) + 1
        # Coordinates (N, 3) about the centre (V, 3) of each view's points, divided by their size (V,), in a principal
        # frame (V, 3, 3): the third axis has the least variance. `plane` (N, 2) are the first two.
        self.centre = self.sum(self.points * self.use[:, None]) / np.maximum(self.count, 1)[:, None]
        about = (self.points - self.centre[self.view]) * self.use[:, None]
        self.frame, self.thickness = np.tile(np.eye(3), (len(self.count), 1, 1)), np.zeros(len(self.count))
        if not observations.is_planar:
            variances, axes = np.linalg.eigh(self.sum(about[:, :, None] * about[:, None, :]))
            self.frame = np.stack([axes[:, :, 2], axes[:, :, 1], np.cross(axes[:, :, 2], axes[:, :, 1])], -1)
            self.thickness = np.sqrt(np.maximum(variances[:, 0], 0) / np.maximum(variances.sum(1), 1e-300))
            about = np.einsum("nij,ni->nj", self.frame[self.view], about)
        size = np.sqrt(self.sum((about**2).sum(-1)) / np.maximum(self.count, 1))
        self.size = np.where(size > 0, size, 1.0)
        self.local = about / self.size[self.view][:, None]
        self.plane = self.local[:, :2]

    @cached_property
    def middle(self) -> Array:
        """Medians (V, 3) of the bearings."""
        return np.stack([self.medians(self.bearings[:, i]) for i in range(3)], -1)

    @cached_property
    def nearby(self) -> Array:
        """Weights (N,): a bearing far from the others is an outlier, or of a board so large that it can be spared."""
        return self.weights(((self.bearings - self.middle[self.view]) ** 2).sum(-1))

    def sum(self, values: Array) -> Array:
        """Return the sums of values (N, ...) by view."""
        # A last row of zeros, because the last view may have no points.
        sums = np.add.reduceat(np.concatenate([values, np.zeros((1, *values.shape[1:]))]), self.starts[:-1])
        sums[self.starts[:-1] == self.starts[1:]] = 0.0
        return sums

    def gram(self, a: Array, weights: Array, b: Array | None = None) -> Array:
        """Return A^T W B (V, K, L) of coordinates a (N, K) and b (N, L), by default a, by view."""
        weighted = weights[:, None] * (a if b is None else b)
        return np.stack([a[first:last].T @ weighted[first:last] for first, last in pairwise(self.starts)])

    def medians(self, values: Array) -> Array:
        """Return the median of values (N,) by view, over the points that have a bearing."""
        table = np.full(self.table, np.inf)
        table[self.view, self.place] = np.where(self.use > 0, values, np.inf)
        table.sort(axis=1)
        middle = table[np.arange(len(table)), np.maximum(self.count - 1, 0) // 2]
        return np.where(self.count > 0, middle, 0.0)

    def scale(self, squares: Array) -> Array:
        """Return the squared scale (N,) of the Geman-McClure weights, from the squared chords of each view."""
        return (ROBUST_SCALE**2 * self.medians(squares) + MIN_CHORD_RAD**2)[self.view]

    def weights(self, squares: Array) -> Array:
        """Return the Geman-McClure weights of squared chords (N,)."""
        return self.use * geman_mcclure_weights(squares, self.scale(squares))

    def in_board_frame(self, frames: Array, translations: Array) -> Poses:
        """Return poses for board coordinates from near-rotations (V, 3, 3) and translations for local ones."""
        rotations = so3.nearest(frames) @ np.swapaxes(self.frame, 1, 2)
        return rotations, translations * self.size[:, None] - np.einsum("vij,vj->vi", rotations, self.centre)

    def squares(self, poses: Poses) -> Array:
        """Return the squared chords (N,) between bearings and the directions of the posed points."""
        return squared_chords(self.points, self.view, *poses, self.bearings)

    def mirrored(self, rotations: Array, translations: Array) -> Poses:
        """Return poses whose boards are mirrored about the plane across the line of sight of their middle."""
        middle = np.einsum("vij,vj->vi", rotations, self.centre) + translations
        # (I - 2 s s^T) R (I - 2 n n^T), so that the result is a rotation.
        mirrored = _reflection(middle) @ rotations @ _reflection(self.frame[:, :, 2])
        return mirrored, middle - np.einsum("vij,vj->vi", mirrored, self.centre)

    def better(self, first: Poses, second: Poses) -> Poses:
        """Return for each view that of two poses which has the smaller robust cost."""
        squares = self.squares(first), self.squares(second)
        scale = (ROBUST_SCALE**2 * np.minimum(*(self.medians(s) for s in squares)) + MIN_CHORD_RAD**2)[self.view]
        cost = [self.sum(self.use * s / (s + scale)) for s in squares]
        wins = cost[1] < cost[0]
        return np.where(wins[:, None, None], second[0], first[0]), np.where(wins[:, None], second[1], first[1])
