"""The pose of a plane from bearings: nothing here knows a picture."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.views import BoardViews
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Poses = tuple[Array, Array]

FEWEST = 6
# A corner this many times the median of its board's angles off counts a quarter of what one in place does.
FAR = 3.0
# Chords (rad) that are nothing: below, all corners count the same.
TINY = 1e-9
ROUNDS = 2
# Steps of a refinement, and those of them after which what counts as far is settled.
STEPS, SETTLED = 8, 3
# Costs that fall to more than this share of what they were have settled too.
STAYS = 0.999


def plane_poses(views: BoardViews, bearings: Array) -> Poses:
    """Give cam_from_board of every picture from the bearings of its corners, with no start, wrong corners outvoted.

    Each board is posed twice, as if its distance were so large that it looks alike from everywhere, and linearly as a
    plane seen from near; the pose that explains more corners is kept.

    Parameters
    ----------
    views
        The corners; their boards lie in z = 0.
    bearings
        (N, 3) unit; rows of NaN are left out.

    Returns
    -------
    rotations, translations
        (V, 3, 3) and (V, 3), NaN for a picture with too few corners.
    """
    groups = _Groups(views, bearings)
    rotations, translations = groups.better(_near_poses(groups), _far_poses(groups))
    rotations[groups.count < FEWEST], translations[groups.count < FEWEST] = np.nan, np.nan
    return rotations, translations


def settled_poses(views: BoardViews, bearings: Array, rotations: Array, translations: Array) -> Poses:
    """Give the poses nearby that explain the bearings best, each also tried turned over, outliers outvoted.

    A small or far board looks nearly the same when its tilt is turned over about the line of sight: two poses of nearly
    the same cost, and no small step from one to the other (Schweighofer and Pinz, Robust pose estimation from a planar
    target, PAMI 2006). Both are refined on the sphere, and the better is kept.

    Parameters
    ----------
    views
        The corners; their boards lie in z = 0.
    bearings
        (N, 3) unit; rows of NaN are left out.
    rotations, translations
        (V, 3, 3) and (V, 3), finite: where to begin.
    """
    groups = _Groups(views, bearings)
    middle = np.einsum("vij,vj->vi", rotations[:, :, :2], groups.centre) + translations
    sight = middle / np.maximum(np.linalg.norm(middle, axis=1), 1e-300)[:, None]
    over = (np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]) @ rotations * (1.0, 1.0, -1.0)
    moved = middle - np.einsum("vij,vj->vi", over[:, :, :2], groups.centre)
    return groups.better(_refined(groups, (rotations, translations)), _refined(groups, (over, moved)))


def _near_poses(groups: "_Groups") -> Poses:
    """Pose planes linearly.

    A corner (X, Y, 0) is seen along H (X, Y, 1) with H = [r1 r2 t], so that b x H (X, Y, 1) = 0: nine unknowns up to
    scale, whatever the angle from the axis (Hartley and Zisserman, Multiple view geometry, ch. 8, on the sphere). The
    sign is the one that puts the corners at positive distance along their bearings.
    """
    b, x = groups.bearings, np.concatenate([groups.plane, np.ones((len(groups.plane), 1))], -1)
    # [b]x^T [b]x = I - b b^T for a unit b: the normal equations of all corners at once.
    across = np.eye(3) - b[:, :, None] * b[:, None, :]
    outer = (across[:, :, None, :, None] * (x[:, :, None] * x[:, None, :])[:, None, :, None, :]).reshape(-1, 81)
    weight, h = groups.nearby, np.zeros((len(groups.count), 3, 3))
    for _ in range(ROUNDS):
        _, vectors = np.linalg.eigh(groups.sum(outer * weight[:, None]).reshape(-1, 9, 9))
        h = vectors[:, :, 0].reshape(-1, 3, 3)
        seen = np.einsum("nij,nj->ni", h[groups.view], x)
        ahead = np.einsum("ni,ni->n", seen, b)
        h *= np.where(groups.sum(weight * ahead) < 0, -1.0, 1.0)[:, None, None]
        squares = np.maximum((seen**2).sum(-1), 1e-300)
        weight = groups.weights(2 - 2 * np.abs(ahead) / np.sqrt(squares)) / squares
    scale = np.sqrt(np.linalg.norm(h[:, :, 0], axis=1) * np.linalg.norm(h[:, :, 1], axis=1))
    r1, r2, t = np.moveaxis(h / np.where(scale > 0, scale, 1.0)[:, None, None], -1, 0)
    return groups.uncentred(np.stack([r1, r2, np.cross(r1, r2)], -1), t)


def _far_poses(groups: "_Groups") -> Poses:
    """Pose planes as if parallel rays showed them: their directions are an affine map of the plane.

    Its larger singular value is the scale; the other, how far the plane is tilted, this way or the other way.
    """
    b, x = groups.bearings, np.concatenate([groups.plane, np.ones((len(groups.plane), 1))], -1)
    middle = groups.middle / np.maximum(np.linalg.norm(groups.middle, axis=1), 1e-300)[:, None]
    least = np.eye(3)[np.abs(middle).argmin(1)]
    right = np.cross(least, middle)
    right /= np.maximum(np.linalg.norm(right, axis=1), 1e-300)[:, None]
    frame = np.stack([right, np.cross(middle, right), middle], -1)
    local = np.einsum("nij,ni->nj", frame[groups.view], b)
    # Stereographic about the middle: finite for all but what lies straight behind.
    y = 2 * local[:, :2] / np.maximum(1 + local[:, 2:], 1e-3)
    weight, affine = groups.nearby, np.zeros((len(groups.count), 3, 2))
    for _ in range(ROUNDS):
        weighted = x * weight[:, None]
        normal = groups.sum(weighted[:, :, None] * x[:, None, :]) + 1e-12 * np.eye(3)
        affine = np.linalg.solve(normal, groups.sum(weighted[:, :, None] * y[:, None, :]))
        weight = groups.weights(((np.einsum("ni,nij->nj", x, affine[groups.view]) - y) ** 2).sum(-1))
    columns = np.swapaxes(affine[:, :2], 1, 2)
    scale = np.maximum(np.linalg.svd(columns, compute_uv=False)[:, 0], 1e-12)
    first, second = np.moveaxis(columns / scale[:, None, None], -1, 0)
    z1, z2 = (np.sqrt(np.maximum(1 - (p**2).sum(-1), 0)) for p in (first, second))
    z2 = np.where((first * second).sum(-1) > 0, -z2, z2)
    r1, r2 = np.column_stack([first, z1]), np.column_stack([second, z2])
    t = np.column_stack([affine[:, 2], np.ones(len(scale))]) / scale[:, None]
    return groups.uncentred(frame @ np.stack([r1, r2, np.cross(r1, r2)], -1), np.einsum("vij,vj->vi", frame, t))


class _Groups:
    """The corners of each view that have a bearing, and sums and medians over them."""

    def __init__(self, views: BoardViews, bearings: Array) -> None:
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
        # Coordinates on the boards (N, 2) about their centre (V, 2), over their size (V,).
        plane = self.points[:, :2]
        self.centre = self.sum(plane * self.use[:, None]) / np.maximum(self.count, 1)[:, None]
        about = (plane - self.centre[self.view]) * self.use[:, None]
        size = np.sqrt(self.sum((about**2).sum(-1)) / np.maximum(self.count, 1))
        self.size = np.where(size > 0, size, 1.0)
        self.plane = about / self.size[self.view][:, None]
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
        """Give poses for the boards' own coordinates from frames (V, 3, 3), nearly rotations, for the centred ones."""
        rotations = so3.nearest(frames)
        return rotations, translations * self.size[:, None] - np.einsum("vij,vj->vi", rotations[:, :, :2], self.centre)

    def squares(self, poses: Poses) -> Array:
        """Give the squared chords (N,) between bearings and the directions of the corners so posed."""
        rotations, translations = poses
        seen = np.einsum("nij,nj->ni", rotations[self.view], self.points) + translations[self.view]
        seen /= np.maximum(np.linalg.norm(seen, axis=1), 1e-300)[:, None]
        return ((seen - self.bearings) ** 2).sum(-1)

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
        turned = np.einsum("nij,nj->ni", rotations[groups.view], groups.points)
        seen = turned + translations[groups.view]
        length = np.maximum(np.linalg.norm(seen, axis=1), 1e-300)
        seen /= length[:, None]
        residuals = seen - groups.bearings
        squares = (residuals**2).sum(-1)
        if step < SETTLED:
            scale = groups.scale(squares)
        weight = groups.use * (scale / (scale + squares)) ** 2
        # p = (y + t)/|y + t| with y = R X, turned by w and moved by v:  dp = (I - p p^T)(w x y + v)/|y + t|.
        across = (np.eye(3) - seen[:, :, None] * seen[:, None, :]) / length[:, None, None]
        jacobian = np.concatenate([across @ -so3.hat(turned), across], -1)
        weighted = jacobian * weight[:, None, None]
        hessian = groups.sum(np.swapaxes(weighted, 1, 2) @ jacobian)
        gradient = groups.sum(np.einsum("nij,ni->nj", weighted, residuals))
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
