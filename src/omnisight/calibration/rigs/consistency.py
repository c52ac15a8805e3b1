"""Consistency of every view with the extrinsics: views that were not simultaneous, and cameras that moved."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from omnisight.calibration.rigs.bundle import RigBundle, pose_derivatives
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.state import RigState
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

POSE_DOF = 6
# Significance at which a view contradicts the extrinsics, or a camera moved; false alarms must be rare in hundreds of
# views.
SIGNIFICANCE = 1e-6
# Views on each side of a change: the pose of one board is no evidence of a lasting one.
MIN_VIEWS_EACH_SIDE = 3
# Rounds of iteratively reweighted least squares.
ROBUST_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Deviations:
    """For the views of one camera, the pose of the camera in each view relative to the extrinsics.

    Attributes
    ----------
    camera
        The camera.
    names
        (V,) names of the images.
    groups
        (V,) simultaneous groups, ascending.
    joined
        (V,) whether the view shares the pose of its group with another.
    steps
        (V, 6) steps (w, v) of `sensor_from_rig` that would fit the view best.
    information
        (V, 6, 6) their inverse covariances, from the noise of the corners.
    """

    camera: int
    names: tuple[str, ...]
    groups: Indices
    joined: Bools
    steps: Array
    information: Array

    @property
    def chi_square(self) -> Array:
        """(V,) squared steps relative to their covariance."""
        return np.einsum("vi,vij,vj->v", self.steps, self.information, self.steps)


@dataclass(frozen=True)
class CameraMove:
    """A camera that moved relative to the others between two images.

    Attributes
    ----------
    camera
        The camera.
    before, after
        Names of its last image before and its first image after.
    distance
        Distance it moved, in the unit of the board.
    angle
        Angle it rotated by, radians.
    """

    camera: int
    before: str
    after: str
    distance: float
    angle: float


@dataclass(frozen=True, eq=False)
class _View:
    """A view: its camera and name, the groups it was taken with and is posed with, and its normal equations."""

    camera: int
    name: str
    frame: int
    group: int
    information: Array
    gradient: Array
    by_group: Array


def deviations(problem: RigBundle, state: RigState, together: RigObservations) -> list[Deviations]:
    """Return the deviations of each camera that observes boards together with others.

    Of a view with gradient g and normal equations H_v of its group's pose, and H_o those of the other views of the
    group, the pose from the view alone differs from that of the others by -(H_v^-1 + H_o^-1) g to first order. For a
    view that shares its group with no other, the poses of both groups are compared.

    Parameters
    ----------
    problem, state
        The refined rig; views that contradicted their group are in groups of their own.
    together
        The observations with the original groups.
    """
    frames: dict[int, list[_View]] = {}
    for view in _views(problem, state, together):
        frames.setdefault(view.frame, []).append(view)
    found: dict[int, list[tuple[int, str, bool, Array, Array]]] = {}
    for frame, views in sorted(frames.items()):
        for view in views:
            others = [other for other in views if other.camera != view.camera]
            if not others:
                continue
            joined = [other for other in others if other.group == view.group]
            group = view.group if joined else max(others, key=lambda other: np.trace(other.information)).group
            reference = np.sum([other.information for other in others if other.group == group], axis=0)
            step, information = _deviation(state, view, group, reference)
            found.setdefault(view.camera, []).append((frame, view.name, bool(joined), step, information))
    return [_collected(camera, entries) for camera, entries in sorted(found.items())]


def _views(problem: RigBundle, state: RigState, together: RigObservations) -> Iterator[_View]:
    """Yield all views whose corners determine a pose."""
    for index, (part, original) in enumerate(zip(problem.observations.parts, together.parts, strict=True)):
        block = problem.part_blocks(index, state)[1]
        _, _, by_group = pose_derivatives(state, part, problem.free_parameters)
        for v, name in enumerate(part.observations.names):
            if np.linalg.matrix_rank(block.local[v]) == POSE_DOF:
                groups = int(original.group[v]), int(part.group[v])
                yield _View(part.camera, name, *groups, block.local[v], block.local_gradient[v], by_group[v])


def _deviation(state: RigState, view: _View, group: int, reference: Array) -> tuple[Array, Array]:
    """Return the step of the camera's pose that fits a view best, given the pose of a group, and its information."""
    covariance = np.linalg.inv(view.information) + np.linalg.inv(reference)
    to_sensor = np.linalg.solve(_by_sensor(state, view.camera, group), view.by_group)
    if view.group == group:
        step = -to_sensor @ covariance @ view.gradient
    else:
        sensor = state.sensor_from_rig.one(view.camera)
        fitted = sensor @ state.rig_from_group.one(view.group) @ state.rig_from_group.one(group).inverse()
        turn = so3.log(fitted.rotation @ sensor.rotation.T)
        step = np.concatenate([turn, fitted.translation - sensor.translation])
    return step, np.asarray(np.linalg.inv(to_sensor @ covariance @ to_sensor.T), float)


def _collected(camera: int, entries: list[tuple[int, str, bool, Array, Array]]) -> Deviations:
    """Return the deviations of a camera."""
    groups, names, joined, steps, information = zip(*entries, strict=True)
    return Deviations(camera, names, np.array(groups), np.array(joined), np.array(steps), np.array(information))


def _by_sensor(state: RigState, camera: int, group: int) -> Array:
    """Return the derivative (6, 6) of cam_from_group by the step of sensor_from_rig."""
    derivative = np.eye(6)
    arm = state.sensor_from_rig.rotation[camera] @ state.rig_from_group.translation[group]
    derivative[3:, :3] = -so3.hat(arm)
    return derivative


def scatter(all_deviations: list[Deviations]) -> float:
    """Return the robust ratio of squared deviations to those of corner noise; at least 1.

    Errors of the corners of one image are correlated: a flexing board and blur move many of them together.
    """
    squares = np.concatenate([d.chi_square for d in all_deviations]) if all_deviations else np.zeros(0)
    return max(float(np.median(squares) / chi2.median(POSE_DOF)), 1.0) if len(squares) else 1.0


def contradicts(deviation: Deviations, inflation: float) -> Bools:
    """Return which views (V,) contradict the extrinsics significantly."""
    return deviation.chi_square > inflation * chi2.isf(SIGNIFICANCE, POSE_DOF)


def find_move(all_deviations: list[Deviations], inflation: float) -> CameraMove | None:
    """Return the camera that moved between two of its images, and where; None if none did.

    Each camera is divided into the images before and after every one of them. A division counts if on both sides at
    least `MIN_VIEWS_EACH_SIDE` views agree with the pose of their side and contradict that of the other; the division
    with most such views is reported.
    """
    limit = inflation * float(chi2.isf(SIGNIFICANCE, POSE_DOF))
    best: tuple[int, CameraMove] | None = None
    for deviation in all_deviations:
        for k in range(MIN_VIEWS_EACH_SIDE, len(deviation.groups) - MIN_VIEWS_EACH_SIDE + 1):
            first, second = _robust_mean(deviation, slice(0, k), limit), _robust_mean(deviation, slice(k, None), limit)
            near_first, near_second = _squares(deviation, first) <= limit, _squares(deviation, second) <= limit
            before, after = (near_first & ~near_second)[:k].sum(), (near_second & ~near_first)[k:].sum()
            moved = (near_first & ~near_second)[k:].sum() + (near_second & ~near_first)[:k].sum()
            score = int(before + after - 2 * moved)
            if min(before, after) >= MIN_VIEWS_EACH_SIDE and score > (best[0] if best else 0):
                step = second - first
                names = deviation.names[k - 1], deviation.names[k]
                length, angle = float(np.linalg.norm(step[3:])), float(np.linalg.norm(step[:3]))
                best = score, CameraMove(deviation.camera, *names, length, angle)
    return best[1] if best else None


def _squares(deviation: Deviations, step: Array) -> Array:
    """Return the squared distances (V,) of the steps of all views from one step, relative to their covariance."""
    difference = deviation.steps - step
    return np.einsum("vi,vij,vj->v", difference, deviation.information, difference)


def _robust_mean(deviation: Deviations, views: slice, limit: float) -> Array:
    """Return the mean step (6,) of some views with Geman-McClure weights of a scale, from their median."""
    information, steps = deviation.information[views], deviation.steps[views]
    mean = np.median(steps, axis=0)
    for _ in range(ROBUST_ROUNDS):
        weights = (limit / (limit + _squares(deviation, mean)[views])) ** 2
        weighted = weights[:, None, None] * information
        mean = np.linalg.solve(weighted.sum(0), np.einsum("vij,vj->i", weighted, steps))
    return mean
