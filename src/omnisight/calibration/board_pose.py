"""The pose of a plane, or of points in space, from bearings: nothing here knows an image."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._resection_kernel import chord_normals, squared_chords
from omnisight.geometry import rotation as so3
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Poses = tuple[Array, Array]

FEWEST = 6
# A corner this many times the median of its board's angles off counts a quarter of what one in place does.
FAR = 3.0
# Chords (rad) that are nothing: below, all corners count the same.
TINY = 1e-9
ROUNDS = 2
# Points that stand this share of their spread off a plane are posed as points in space too.
SOLID = 0.03
# Steps of a refinement, and those of them after which what counts as far is settled.
STEPS, SETTLED = 8, 3
# Costs that fall to more than this share of what they were have settled too.
STAYS = 0.999


def linear_board_poses(views: Observations, bearings: Array) -> Poses:
    """Give cam_from_board of every image from the bearings of its corners, with no start, wrong corners outvoted.

    Each board is posed twice, as if its distance were so large that it looks alike from everywhere, and linearly as a
    plane seen from near; the pose that explains more corners is kept. The plane is the one that the corners seen in
    that image lie on: a side of a cube is one. Corners on no plane are posed both ways as points in space too.

    Parameters
    ----------
    views
        The corners.
    bearings
        (N, 3) unit; rows of NaN are left out.

    Returns
    -------
    rotations, translations
        (V, 3, 3) and (V, 3), NaN for an image with too few corners.
    """
    groups = _Groups(views, bearings)
    found = groups.better(_near_poses(groups), _far_poses(groups))
    if (groups.thickness > SOLID).any():
        found = groups.better(found, groups.better(_near_poses_in_space(groups), _far_poses_in_space(groups)))
    rotations, translations = found
    rotations[groups.count < FEWEST], translations[groups.count < FEWEST] = np.nan, np.nan
    return rotations, translations


def refine_board_poses(views: Observations, bearings: Array, rotations: Array, translations: Array) -> Poses:
    """Give the poses nearby that explain the bearings best, each also tried turned over, outliers outvoted.

    A small or far board looks nearly the same when its tilt is turned over about the line of sight: two poses of nearly
    the same cost, and no small step from one to the other (Schweighofer and Pinz, Robust pose estimation from a planar
    target, PAMI 2006). Both are refined on the sphere, and the better is kept.

    Parameters
    ----------
    views
        The corners.
    bearings
        (N, 3) unit; rows of NaN are left out.
    rotations, translations
        (V, 3, 3) and (V, 3), finite: where to begin.
    """
    groups = _Groups(views, bearings)
    middle = np.einsum("vij,vj->vi", rotations, groups.centre) + translations
    sight = middle / np.maximum(np.linalg.norm(middle, axis=1), 1e-300)[:, None]
    over = _mirror(sight) @ rotations @ _mirror(groups.frame[:, :, 2])
    moved = middle - np.einsum("vij,vj->vi", over, groups.centre)
    return groups.better(_refined(groups, (rotations, translations)), _refined(groups, (over, moved)))


def _mirror(normals: Array) -> Array:
    """Give the reflections (V, 3, 3) in the planes of those unit normals (V, 3)."""
    return np.eye(3) - 2 * normals[:, :, None] * normals[:, None, :]


def _near_poses(groups: "_Groups") -> Poses:
    """Pose planes linearly: a corner (X, Y, 0) is seen along H (X, Y, 1) with H = [r1 r2 t]."""
    h = _seen_linearly(groups, _with_one(groups.plane))
    scale = np.sqrt(np.linalg.norm(h[:, :, 0], axis=1) * np.linalg.norm(h[:, :, 1], axis=1))
    r1, r2, t = np.moveaxis(h / np.where(scale > 0, scale, 1.0)[:, None, None], -1, 0)
    return groups.uncentred(np.stack([r1, r2, np.cross(r1, r2)], -1), t)


def _near_poses_in_space(groups: "_Groups") -> Poses:
    """Pose points linearly: a corner X is seen along [R t] (X, 1)."""
    h = _seen_linearly(groups, _with_one(groups.local))
    scale = np.cbrt(np.abs(np.linalg.det(h[:, :, :3])))[:, None, None]
    h = h / np.where(scale > 1e-12, scale, 1.0)
    return groups.uncentred(h[:, :, :3], h[:, :, 3])


def _seen_linearly(groups: "_Groups", x: Array) -> Array:
    """Give the matrices (V, 3, K) that map coordinates x (N, K) along the bearings b, best.

    b x H x = 0: 3 K unknowns up to scale, whatever the angle from the axis (Hartley and Zisserman, Multiple view
    geometry, ch. 7 and 8, on the sphere). The sign is the one that puts the corners at positive distance along their
    bearings.
    """
    b, k = groups.bearings, x.shape[1]
    # [b]x^T [b]x = I - b b^T for a unit b: the normal equations of all corners at once.
    across = np.eye(3) - b[:, :, None] * b[:, None, :]
    outer = (across[:, :, None, :, None] * (x[:, :, None] * x[:, None, :])[:, None, :, None, :]).reshape(-1, 9 * k * k)
    weight, h = groups.nearby, np.zeros((len(groups.count), 3, k))
    for _ in range(ROUNDS):
        _, vectors = np.linalg.eigh(groups.sum(outer * weight[:, None]).reshape(-1, 3 * k, 3 * k))
        h = vectors[:, :, 0].reshape(-1, 3, k)
        seen = np.einsum("nij,nj->ni", h[groups.view], x)
        ahead = np.einsum("ni,ni->n", seen, b)
        h *= np.where(groups.sum(weight * ahead) < 0, -1.0, 1.0)[:, None, None]
        squares = np.maximum((seen**2).sum(-1), 1e-300)
        weight = groups.weights(2 - 2 * np.abs(ahead) / np.sqrt(squares)) / squares
    return h


def _far_poses(groups: "_Groups") -> Poses:
    """Pose planes as if parallel rays showed them: their directions are an affine map of the plane.

    Its larger singular value is the scale; the other, how far the plane is tilted, this way or the other way.
    """
    frame, affine = _seen_from_far(groups, _with_one(groups.plane))
    columns = np.swapaxes(affine[:, :2], 1, 2)
    scale = np.maximum(np.linalg.svd(columns, compute_uv=False)[:, 0], 1e-12)
    first, second = np.moveaxis(columns / scale[:, None, None], -1, 0)
    z1, z2 = (np.sqrt(np.maximum(1 - (p**2).sum(-1), 0)) for p in (first, second))
    z2 = np.where((first * second).sum(-1) > 0, -z2, z2)
    r1, r2 = np.column_stack([first, z1]), np.column_stack([second, z2])
    t = np.column_stack([affine[:, 2], np.ones(len(scale))]) / scale[:, None]
    return groups.uncentred(frame @ np.stack([r1, r2, np.cross(r1, r2)], -1), np.einsum("vij,vj->vi", frame, t))


def _far_poses_in_space(groups: "_Groups") -> Poses:
    """Pose points as if parallel rays showed them: the nearest two rows of a rotation, times the scale."""
    frame, affine = _seen_from_far(groups, _with_one(groups.local))
    left, values, right = np.linalg.svd(np.swapaxes(affine[:, :3], 1, 2), full_matrices=False)
    scale = np.maximum(values.mean(1), 1e-12)
    r1, r2 = np.moveaxis(left @ right, 1, 0)
    t = np.column_stack([affine[:, 3], np.ones(len(scale))]) / scale[:, None]
    return groups.uncentred(frame @ np.stack([r1, r2, np.cross(r1, r2)], 1), np.einsum("vij,vj->vi", frame, t))


def _seen_from_far(groups: "_Groups", x: Array) -> tuple[Array, Array]:
    """Give frames (V, 3, 3) about the middle of each view, and the affine maps (V, K, 2) of coordinates x (N, K) there.

    Directions are taken stereographically about the middle: finite for all but what lies straight behind.
    """
    middle = groups.middle / np.maximum(np.linalg.norm(groups.middle, axis=1), 1e-300)[:, None]
    least = np.eye(3)[np.abs(middle).argmin(1)]
    right = np.cross(least, middle)
    right /= np.maximum(np.linalg.norm(right, axis=1), 1e-300)[:, None]
    frame = np.stack([right, np.cross(middle, right), middle], -1)
    local = np.einsum("nij,ni->nj", frame[groups.view], groups.bearings)
    y = 2 * local[:, :2] / np.maximum(1 + local[:, 2:], 1e-3)
    weight, affine = groups.nearby, np.zeros((len(groups.count), x.shape[1], 2))
    for _ in range(ROUNDS):
        weighted = x * weight[:, None]
        normal = groups.sum(weighted[:, :, None] * x[:, None, :]) + 1e-12 * np.eye(x.shape[1])
        affine = np.asarray(np.linalg.solve(normal, groups.sum(weighted[:, :, None] * y[:, None, :])), float)
        weight = groups.weights(((np.einsum("ni,nij->nj", x, affine[groups.view]) - y) ** 2).sum(-1))
    return frame, affine


def _with_one(x: Array) -> Array:
    return np.concatenate([x, np.ones((len(x), 1))], -1)


class _Groups:
    """The corners of each view that have a bearing, and sums and medians over them."""

    def __init__(self, views: Observations, bearings: Array) -> None:
        self.points = views.points
        self.view = views.view_of_row
        self.starts = np.array([g.start for g in views.groups], np.intp)
        finite: NDArray[np.bool_] = np.all(np.isfinite(bearings), axis=-1)
        self.use = finite.astype(float)
        self.bearings = np.where(finite[:, None], bearings, 0.0)
        self.count = np.bincount(self.view, self.use, len(views)).astype(np.intp)
        # A table with a row for each view, and which column each corner has.
        self.place = np.arange(len(self.view)) - self.starts[self.view]
        self.table = len(views), int(self.place.max(initial=0)) + 1
        # Coordinates (N, 3) about the centre of each view's corners (V, 3), over their size (V,), in a frame (V, 3, 3)
        # whose third axis they stand off least: those on a plane are `plane` (N, 2).
        self.centre = self.sum(self.points * self.use[:, None]) / np.maximum(self.count, 1)[:, None]
        about = (self.points - self.centre[self.view]) * self.use[:, None]
        self.frame, self.thickness = np.tile(np.eye(3), (len(views), 1, 1)), np.zeros(len(views))
        if not views.planar:
            spread, axes = np.linalg.eigh(self.sum(about[:, :, None] * about[:, None, :]))
            self.frame = np.stack([axes[:, :, 2], axes[:, :, 1], np.cross(axes[:, :, 2], axes[:, :, 1])], -1)
            self.thickness = np.sqrt(np.maximum(spread[:, 0], 0) / np.maximum(spread.sum(1), 1e-300))
            about = np.einsum("nij,ni->nj", self.frame[self.view], about)
        size = np.sqrt(self.sum((about**2).sum(-1)) / np.maximum(self.count, 1))
        self.size = np.where(size > 0, size, 1.0)
        self.local = about / self.size[self.view][:, None]
        self.plane = self.local[:, :2]
        # A corner far from where the others are is a wrong one, or one of a board so large that it can be spared.
        self.middle = np.stack([self.medians(self.bearings[:, i]) for i in range(3)], -1)
        self.nearby = self.weights(((self.bearings - self.middle[self.view]) ** 2).sum(-1))

    def sum(self, values: Array) -> Array:
        """Sum values (N, ...) by view."""
        # A last row of zeros: a view without a corner may be the last.
        return np.add.reduceat(np.concatenate([values, np.zeros((1, *values.shape[1:]))]), self.starts)

    def medians(self, values: Array) -> Array:
        """Give the median of values (N,) by view, of those that count."""
        table = np.full(self.table, np.inf)
        table[self.view, self.place] = np.where(self.use > 0, values, np.inf)
        table.sort(axis=1)
        middle = table[np.arange(len(table)), np.maximum(self.count - 1, 0) // 2]
        return np.where(self.count > 0, middle, 0.0)

    def scale(self, squares: Array) -> Array:
        """Give for each corner (N,) the squared chord that counts a quarter, from those of its view."""
        return (FAR**2 * self.medians(squares) + TINY**2)[self.view]

    def weights(self, squares: Array) -> Array:
        """Give Geman and McClure's weights for squared chords (N,)."""
        scale = self.scale(squares)
        return self.use * (scale / (scale + squares)) ** 2

    def uncentred(self, frames: Array, translations: Array) -> Poses:
        """Give poses for the boards' own coordinates from frames (V, 3, 3), nearly rotations, for the local ones."""
        rotations = so3.nearest(frames) @ np.swapaxes(self.frame, 1, 2)
        return rotations, translations * self.size[:, None] - np.einsum("vij,vj->vi", rotations, self.centre)

    def squares(self, poses: Poses) -> Array:
        """Give the squared chords (N,) between bearings and the directions of the corners so posed."""
        return squared_chords(self.points, self.view, *poses, self.bearings)

    def better(self, first: Poses, second: Poses) -> Poses:
        """Give for each view that of two poses which leaves less, wrong corners outvoted."""
        squares = self.squares(first), self.squares(second)
        scale = (FAR**2 * np.minimum(*(self.medians(s) for s in squares)) + TINY**2)[self.view]
        cost = [self.sum(self.use * s / (s + scale)) for s in squares]
        wins = cost[1] < cost[0]
        return np.where(wins[:, None, None], second[0], first[0]), np.where(wins[:, None], second[1], first[1])


def _refined(groups: _Groups, poses: Poses) -> Poses:
    """Refine each pose by Levenberg and Marquardt's steps with a damping of its own."""
    rotations, translations = poses
    damping, index = np.full(len(rotations), 1e-4), np.arange(6)
    scale = np.zeros(0)
    for step in range(STEPS):
        squares = groups.squares((rotations, translations))
        if step < SETTLED:
            scale = groups.scale(squares)
        weights = groups.use * (scale / (scale + squares)) ** 2
        hessian, gradient = chord_normals(groups.points, groups.view, rotations, translations, groups.bearings, weights)
        diagonal = hessian[:, index, index]
        hessian[:, index, index] += damping[:, None] * diagonal + np.where(diagonal > 0, 1e-15 * diagonal, 1.0)
        turn, shift = np.split(-np.linalg.solve(hessian, gradient[..., None])[..., 0], 2, axis=1)
        moved: Poses = so3.exp(turn) @ rotations, np.asarray(translations + shift, float)
        cost = [groups.sum(groups.use * s / (s + scale)) for s in (squares, groups.squares(moved))]
        wins = cost[1] < cost[0]
        rotations = np.where(wins[:, None, None], moved[0], rotations)
        translations = np.where(wins[:, None], moved[1], translations)
        if step >= SETTLED and np.all(wins & (cost[1] > STAYS * cost[0])):
            break
        damping = np.clip(np.where(wins, damping / 5, damping * 10), 1e-12, 1e6)
    return rotations, translations
