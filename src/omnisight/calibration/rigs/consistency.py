"""Consistency of every camera and board with its group: images that were not simultaneous, and what moved."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from omnisight.calibration.rigs.bundle import PartBlocks, RigBundle
from omnisight.calibration.rigs.observations import AGREES, RigObservations
from omnisight.calibration.rigs.pose_steps import POSE_DOF, contradiction_limit, robust_mean, squared_distances
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.state import RigState
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Kind = Literal["camera", "board"]

KINDS: tuple[Kind, ...] = "camera", "board"
# Views on each side of a change: the pose of one board is no evidence of a lasting one.
MIN_VIEWS_EACH_SIDE = 3
# Ratio of the squared deviations of a board to those of a camera above which the board contradicts, not the camera: if
# each camera sees one board, both are equal.
BOARD_RATIO = 1.1


@dataclass(frozen=True, eq=False)
class Deviations(Displayed):
    """For the groups that one camera or board shares with others, its pose relative to that of the others.

    Attributes
    ----------
    kind, index
        The camera, or the board.
    names
        (V,) names of the images.
    groups
        (V,) the groups of the images, as they were before views were separated; ascending.
    joined
        (V,) whether the views share the pose of their group with others.
    steps
        (V, 6) steps (w, v) of `sensor_from_rig`, or of `group_from_board`, that would fit the views best.
    information
        (V, 6, 6) their inverse covariances, from the noise of the corners.
    """

    kind: Kind
    index: int
    names: tuple[str, ...]
    groups: Indices
    joined: Bools
    steps: Array
    information: Array

    @property
    def chi_square(self) -> Array:
        """(V,) squared steps relative to their covariance."""
        return squared_distances(self.steps, np.zeros(POSE_DOF), self.information)


@dataclass(frozen=True)
class Move(Displayed):
    """A camera or a board that moved relative to the others between two images.

    Attributes
    ----------
    kind, index
        The camera, or the board.
    before, after
        Names of the last image before and the first image after.
    distance
        Distance it moved, in the unit of the board.
    angle
        Angle it rotated by, radians.
    groups
        (K,) the groups, as in `Deviations`, of its images before or after: of the side that shares fewer groups.
    """

    kind: Kind
    index: int
    before: str
    after: str
    distance: float
    angle: float
    groups: Indices


@dataclass(eq=False)
class _Member:
    """A camera or board in a group: the normal equations of the group's pose from its views, and the first image."""

    information: Array
    gradient: Array
    name: str


def deviations(problem: RigBundle, state: RigState, together: RigObservations) -> list[Deviations]:
    """Return the deviations of each camera, and of each board, that shares groups with others.

    Of a member of a group with gradient g and normal equations H_m of the group's pose, and H_o those of the other
    members, the pose from the member alone differs from that of the others by -(H_m^-1 + H_o^-1) g to first order. For
    a member whose views were separated from the group, the poses of both groups are compared.

    Parameters
    ----------
    problem, state
        The refined rig; views that contradicted their group are in groups of their own.
    together
        The observations with the original groups.
    """
    blocks = problem.blocks(state)
    origin = _origins(problem.observations, together)
    found = list[Deviations]()
    for kind in KINDS:
        members = _members(problem, state, blocks, kind)
        entries: dict[int, list[tuple[int, str, bool, Array, Array]]] = {}
        for group, own in sorted(members.items(), key=lambda item: (origin[item[0]], item[0])):
            for index, member in own.items():
                unit = problem.observations.unit_of(kind, index)
                is_separate = problem.observations.unit[group] == unit
                place = origin[group] if is_separate else group
                others = [other for k, other in members.get(place, {}).items() if k != index]
                if not others:
                    continue
                reference = np.sum([other.information for other in others], axis=0)
                if not _is_determined(member.information) or not _is_determined(reference):
                    continue
                covariance = np.linalg.inv(member.information) + np.linalg.inv(reference)
                to_member = _by_group(state, kind, index, place)
                step = (
                    _separate_step(state, kind, index, (group, place))
                    if is_separate
                    else -to_member @ covariance @ member.gradient
                )
                information = np.asarray(np.linalg.inv(to_member @ covariance @ to_member.T), float)
                entries.setdefault(index, []).append((origin[group], member.name, not is_separate, step, information))
        found += [_collected(kind, index, rows) for index, rows in sorted(entries.items())]
    return found


def _origins(separated: RigObservations, together: RigObservations) -> dict[int, int]:
    """Return the original group of each group."""
    return {
        new: old
        for part, original in zip(separated.parts, together.parts, strict=True)
        for new, old in zip(part.group.tolist(), original.group.tolist(), strict=True)
    }


def _members(
    problem: RigBundle, state: RigState, blocks: Sequence[PartBlocks], kind: Kind
) -> dict[int, dict[int, _Member]]:
    """Return the cameras, or the boards, of each group."""
    members: dict[int, dict[int, _Member]] = {}
    for part, block in zip(problem.observations.parts, blocks, strict=True):
        back = np.swapaxes(block.by_group, 1, 2)
        information, gradient = back @ block.local @ block.by_group, (back @ block.gradient[..., None])[..., 0]
        index = part.camera if kind == "camera" else part.board
        for v, group in enumerate(part.group.tolist()):
            new = _Member(np.zeros((POSE_DOF, POSE_DOF)), np.zeros(POSE_DOF), part.observations.names[v])
            own = members.setdefault(group, {}).setdefault(index, new)
            own.information = own.information + information[v]
            own.gradient = own.gradient + gradient[v]
    if kind == "camera" and problem.motion is not None:
        # The motion of an exposure is common to all views of a camera in a group.
        motion = problem.motion_normal(blocks, state)
        gain = motion.by_group @ np.linalg.inv(motion.information)
        cameras, groups = problem.observations.exposures
        for e, (camera, group) in enumerate(zip(cameras.tolist(), groups.tolist(), strict=True)):
            own = members[group][camera]
            own.information = own.information - gain[e] @ motion.by_group[e].T
            own.gradient = own.gradient - gain[e] @ motion.gradient[e]
    return members


def _is_determined(information: Array) -> bool:
    return bool(np.linalg.matrix_rank(information) == POSE_DOF)


def _by_group(state: RigState, kind: Kind, index: int, group: int) -> Array:
    """Return the derivative (6, 6) of the step of a camera or a board by that of the pose of its group."""
    derivative, in_rig = np.zeros((POSE_DOF, POSE_DOF)), state.rig_from_group.one(group)
    if kind == "board":
        back = in_rig.rotation.T
        derivative[:3, :3] = derivative[3:, 3:] = back
        derivative[3:, :3] = -so3.hat(state.group_from_board.translation[index]) @ back
        return derivative
    sensor = state.sensor_from_rig.rotation[index]
    derivative[:3, :3] = derivative[3:, 3:] = sensor
    derivative[3:, :3] = so3.hat(sensor @ in_rig.translation) @ sensor
    return derivative


def _separate_step(state: RigState, kind: Kind, index: int, groups: tuple[int, int]) -> Array:
    """Return the step of a camera or a board that explains the pose of its own group, given that of the others."""
    own, others = (state.rig_from_group.one(group) for group in groups)
    if kind == "camera":
        pose = state.sensor_from_rig.one(index)
        return _step(pose, pose @ own @ others.inverse())
    pose = state.group_from_board.one(index)
    return _step(pose, others.inverse() @ own @ pose)


def _step(start: Pose, end: Pose) -> Array:
    return Poses.of(end).steps_from(start)[0]


def _collected(kind: Kind, index: int, entries: list[tuple[int, str, bool, Array, Array]]) -> Deviations:
    """Return the deviations of a camera or a board."""
    groups, names, joined, steps, information = zip(*entries, strict=True)
    return Deviations(kind, index, names, np.array(groups), np.array(joined), np.array(steps), np.array(information))


def scatter(all_deviations: Sequence[Deviations]) -> float:
    """Return the robust ratio of squared deviations to those of corner noise; at least 1.

    Errors of the corners of one image are correlated: a flexing board and blur move many of them together.
    """
    squares = np.concatenate([np.zeros(0), *(d.chi_square for d in all_deviations)])
    return _inflation(squares) if len(squares) else 1.0


def _inflation(squares: Array) -> float:
    """Return the robust ratio of squared distances to those of corner noise; at least 1."""
    return max(float(np.median(squares) / chdtri(POSE_DOF, 0.5)), 1.0)


def contradicting_units(
    together: RigObservations, before: Sequence[Indices], found: Sequence[Deviations], inflation: float
) -> list[Indices]:
    """Return for each part (V,) the camera or board with which each view contradicts its group, or `AGREES`.

    Of the members of a group that contradict, only the worst is separated at a time: it makes the others contradict
    too. Of two, it is the last. A separated one that agrees again is joined.
    """
    members: dict[tuple[int, Kind], int] = {}
    for deviation in found:
        for group in deviation.groups[deviation.joined].tolist():
            members[group, deviation.kind] = members.get((group, deviation.kind), 0) + 1
    worst: dict[tuple[int, Kind], tuple[float, int]] = {}
    largest: dict[tuple[int, Kind], float] = {}
    wrong = dict[tuple[int, int], bool]()
    for deviation in found:
        unit, squares = together.unit_of(deviation.kind, deviation.index), deviation.chi_square
        limit = contradiction_limit(inflation)
        for group, joined, square in zip(deviation.groups.tolist(), deviation.joined, squares.tolist(), strict=True):
            wrong[group, unit] = square > limit
            if joined and square > limit:
                key = group, deviation.kind
                # The chi-squares of two members differ by rounding only.
                worst[key] = max(worst.get(key, (-1.0, -1)), (0.0 if members[key] == 2 else square, unit))
                largest[key] = max(largest.get(key, 0.0), square)
    separated = {
        group: worst[group, "board" if is_board else "camera"][1]
        for group in {group for group, _ in worst}
        for is_board in [largest.get((group, "board"), 0.0) > BOARD_RATIO * largest.get((group, "camera"), 0.0)]
    }
    units = list[Indices]()
    for part, old in zip(together.parts, before, strict=True):
        mine = together.unit_of("camera", part.camera), together.unit_of("board", part.board)
        new = [
            (separated[g] if separated.get(g) in mine else AGREES)
            if unit == AGREES
            else (unit if wrong.get((g, unit), True) else AGREES)
            for g, unit in zip(part.group.tolist(), old.tolist(), strict=True)
        ]
        units.append(np.array(new, np.intp))
    return units


def find_move(all_deviations: Sequence[Deviations], inflation: float) -> Move | None:
    """Return the camera or board that moved between two of its images, and where; None if none did.

    Each is divided into the images before and after every one of them. A division counts if on both sides at least
    `MIN_VIEWS_EACH_SIDE` images agree with the pose of their side and contradict that of the other, relative to the
    scatter about both poses: a motion of the board between the exposures scatters as much about two poses as about one.
    The division that explains the images best is reported, by the decrease of a robust cost; so a camera that did not
    move, but is compared with one that did, is not.
    """
    best: tuple[float, Move] | None = None
    scale = contradiction_limit(inflation)
    for deviation in all_deviations:
        count = len(deviation.groups)
        if count < 2 * MIN_VIEWS_EACH_SIDE:
            continue
        mean = robust_mean(deviation.steps, deviation.information, scale)
        undivided = _robust_cost(squared_distances(deviation.steps, mean, deviation.information))
        for k in range(MIN_VIEWS_EACH_SIDE, count - MIN_VIEWS_EACH_SIDE + 1):
            sides = slice(0, k), slice(k, None)
            first, second = (robust_mean(deviation.steps[s], deviation.information[s], scale) for s in sides)
            from_first, from_second = (
                squared_distances(deviation.steps, pose, deviation.information) for pose in (first, second)
            )
            own = np.concatenate([from_first[:k], from_second[k:]])
            other = np.concatenate([from_second[:k], from_first[k:]])
            # Both poses are estimated from these images.
            limit = contradiction_limit(_inflation(own * count / (count - 2)))
            clear = (own <= limit) & (other > limit)
            score = undivided - _robust_cost(own)
            if min(clear[:k].sum(), clear[k:].sum()) >= MIN_VIEWS_EACH_SIDE and score > (best[0] if best else 0.0):
                step = second - first
                names = deviation.names[k - 1], deviation.names[k]
                length, angle = float(np.linalg.norm(step[3:])), float(np.linalg.norm(step[:3]))
                fewer = deviation.groups[min(sides, key=lambda side: int(deviation.joined[side].sum()))]
                best = score, Move(deviation.kind, deviation.index, *names, length, angle, fewer)
    return best[1] if best else None


def _robust_cost(squares: Array) -> float:
    """Return the Cauchy cost of squared distances relative to the covariances of poses."""
    return float(np.log1p(squares / POSE_DOF).sum())


def with_moved_unit(together: RigObservations, units: Sequence[Indices], move: Move) -> list[Indices]:
    """Return the units of `contradicting_units` with the images on one side of a move separated from their groups."""
    unit = together.unit_of(move.kind, move.index)
    return [
        np.where(np.isin(part.group, move.groups), unit, own)
        if unit == together.unit_of(move.kind, part.camera if move.kind == "camera" else part.board)
        else own
        for part, own in zip(together.parts, units, strict=True)
    ]
