"""Poses of rigs as files hold them: matrices, quaternions, rotation vectors, and contradictory extrinsics."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._limits import MAX_DISTINCT_CAMERAS, MAX_NAME_CHARS
from omnisight.formats._values import MAX_ROTATION_ERROR, number, numbers, rotation_matrix
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

Array = NDArray[np.float64]

IMU = "imu"  # provenance["rig_frame"] of a rig in the frame of its IMU
TIME_OFFSETS = "the time offsets"
TIME_SHIFT = "timeshift_cam_imu"  # of Kalibr, in the fields of a camera
BOTTOM_ROW = (0.0, 0.0, 0.0, 1.0)
# Poses that a file holds twice are rounded and estimated separately; a contradiction is larger. Radians, and share of
# the baseline.
MAX_CONTRADICTION = 0.01
# The inverse explains redundant poses if its difference is this much smaller than that of the pose as it is.
INVERSE_GAIN = 10.0


def pose_of_rows(rows: Any, name: str) -> Pose:
    """Return the pose of a matrix (3, 4) or (4, 4), given as rows, as a flat list or as a storage matrix."""
    if isinstance(rows, dict):
        rows = rows.get("data")
    if isinstance(rows, list) and len(rows) in (12, 16) and not isinstance(rows[0], list):
        rows = [rows[i : i + 4] for i in range(0, len(rows), 4)]
    if not isinstance(rows, list) or len(rows) not in (3, 4):
        raise ValueError(f"{name} must have 4 rows of 4 numbers")
    matrix = np.array([numbers(row, name, 4) for row in rows])
    rotation = rotation_matrix(matrix[:3, :3].tolist(), name)
    if len(matrix) == 4 and np.abs(matrix[3] - BOTTOM_ROW).max() > MAX_ROTATION_ERROR:
        raise ValueError(f"{name} must end with the row 0 0 0 1, got {matrix[3].tolist()}")
    return Pose(rotation, matrix[:3, 3])


def rows_of_pose(pose: Pose) -> list[list[float]]:
    """Return the rows (4, 4) of a pose."""
    return [*pose.matrix.tolist(), list(BOTTOM_ROW)]


def pose_of_quaternion(xyzw: Sequence[float], translation: Sequence[float], name: str) -> Pose:
    """Return the pose of a quaternion; raise ValueError if its length is not 1."""
    length = float(np.linalg.norm(xyzw))
    if not abs(length - 1) <= MAX_CONTRADICTION:
        raise ValueError(f"{name} must be a unit quaternion, got one of length {length:.6g}")
    from scipy.spatial.transform import Rotation  # takes 0.25 s to import

    return Pose(Rotation.from_quat(np.array(xyzw) / length).as_matrix(), np.array(translation, float))


def pose_of_vector(rotation: Sequence[float], translation: Sequence[float]) -> Pose:
    """Return the pose of a rotation vector (radians) and a translation."""
    return Pose(so3.exp(rotation), np.array(translation, float))


def make_rig(sensors: Mapping[str, tuple[Camera, Pose]], time_offsets: Iterable[float] = ()) -> Rig:
    """Return a rig of the cameras of a file, with their number and names checked."""
    check_count(len(sensors))
    if not sensors:
        raise ValueError("holds no camera")
    for name in sensors:
        if not name.isprintable() or not 0 < len(name) <= MAX_NAME_CHARS:
            raise ValueError(f"the name of a camera must be 1 to {MAX_NAME_CHARS} characters, got {name!r:.60}")
    cameras, poses = [camera for camera, _ in sensors.values()], [pose for _, pose in sensors.values()]
    offsets = tuple(time_offsets)
    return Rig(tuple(cameras), tuple(poses), tuple(sensors), time_offsets=offsets if any(offsets) else ())


def check_count(count: int) -> None:
    """Raise ValueError if a file has too many cameras."""
    if count > MAX_DISTINCT_CAMERAS:
        raise ValueError(f"{count} cameras; a rig has at most {MAX_DISTINCT_CAMERAS}")


def cameras_of(rig: Rig) -> dict[str, tuple[Camera, Pose]]:
    """Return the cameras and poses of a rig by name; raise ValueError for a non-central camera, which no format has."""
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, camera, pose in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        if not isinstance(camera, Camera):
            raise ValueError(
                f"holds central cameras, and {name} is non-central ({camera.model.name}): save the rig as native, or"
                " replace the camera by the central one at the distance of the scene (RayCamera.central, Rig.replaced)"
            )
        sensors[name] = camera, pose
    return sensors


def pair_of(rig: Rig) -> tuple[tuple[Camera, Camera], Pose]:
    """Return the two cameras of a rig and the pose second_from_first; raise ValueError for another number."""
    if len(rig) != 2:
        raise ValueError(
            f"holds two cameras, and the rig has {len(rig)} ({', '.join(rig.names)}): save two of them"
            f" (rig.subset({[*rig.names[:2]]}) in Python), or each without its pose (convert --name)"
        )
    (first, _), (second, _) = cameras_of(rig).values()
    return (first, second), rig.with_reference(0).sensor_from_rig[1]


def single(camera: Camera, name: str = "cam0") -> Rig:
    """Return the rig of one camera, in its frame."""
    return Rig((camera,), (Pose(),), (name,))


def rig_notes(rig: Rig, notes: Mapping[str, Iterable[str]], kept: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the notes of the cameras, each once with the names it is about, and what of the rig is not written."""
    by_note: dict[str, list[str]] = {}
    for name, lines in notes.items():
        for line in lines:
            by_note.setdefault(line, []).append(name)
    merged = [n if len(names) == len(rig) else f"{', '.join(names)}: {n}" for n, names in by_note.items()]
    held = {"the covariance of the poses": rig.covariance is not None, TIME_OFFSETS: bool(rig.time_offsets)}
    lost = [what for what, has in held.items() if has and what not in set(kept)]
    merged += [f"not written: {', '.join(lost)}"] if lost else []
    merged += [f"lengths are in {rig.unit}, and the format has metres"] if rig.unit != "m" else []
    return tuple(merged)


def shared_time_offsets(cameras: Iterable[Camera]) -> list[float]:
    """Return the time offset of every camera relative to the IMU; empty if that of a camera is unknown."""
    shifts = [camera.extra.get(TIME_SHIFT) for camera in cameras]
    return [] if None in shifts else [number(shift, TIME_SHIFT) for shift in shifts]


def time_offset_notes(rig: Rig) -> tuple[str, ...]:
    """Return a note if the files of a rig have the time offsets of some cameras only, which the rig leaves out."""
    known = [name for name, camera in zip(rig.names, rig.cameras, strict=True) if TIME_SHIFT in camera.extra]
    unknown = [name for name in rig.names if name not in known]
    if rig.time_offsets or not known or not unknown:
        return ()
    return (f"no time offsets: {TIME_SHIFT} is known of {', '.join(known)} and unknown of {', '.join(unknown)}",)


def imu_poses(rig: Rig) -> list[Pose] | None:
    """Return cam_from_imu of every camera if the pose of an IMU is known, else None.

    It is if the rig frame is that of the IMU (Basalt), or if the cameras have `T_cam_imu` (Kalibr) that agree with the
    poses of the rig.
    """
    if rig.provenance.get("rig_frame") == IMU:
        return list(rig.sensor_from_rig)
    given = [camera.extra.get("T_cam_imu") for camera in rig.cameras]
    if any(rows is None for rows in given):
        return None
    cam_from_imu = [pose_of_rows(rows, f"{name}: T_cam_imu") for name, rows in zip(rig.names, given, strict=True)]
    rig_from_imu = rig.sensor_from_rig[0].inverse() @ cam_from_imu[0]
    poses = [pose @ rig_from_imu for pose in rig.sensor_from_rig]
    agree = all(pose_difference(a, b) <= MAX_CONTRADICTION for a, b in zip(poses, cam_from_imu, strict=True))
    return poses if agree else None


def in_first_frame(rig: Rig) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig in the frame of its first camera, and a note if that changed it."""
    if rig.sensor_from_rig[0] == Pose():
        return rig, ()
    note = f"the format has no rig frame: poses are written relative to {rig.names[0]}"
    return rig.with_reference(0), (note,)


def pose_difference(a: Pose, b: Pose) -> float:
    """Return the larger of the angle (radians) between two poses and of the translations, as a share of the longer."""
    angle = float(np.linalg.norm(so3.log(a.rotation @ b.rotation.T)))
    longest = max(float(np.linalg.norm(a.translation)), float(np.linalg.norm(b.translation)))
    return max(angle, float(np.linalg.norm(a.translation - b.translation)) / longest if longest else 0.0)


def is_inverted(pose: Pose, redundant: Pose) -> bool:
    """Return whether the inverse of a pose, and not the pose, agrees with one that a file holds in another form."""
    difference, inverse = pose_difference(pose, redundant), pose_difference(pose.inverse(), redundant)
    return difference > MAX_CONTRADICTION and inverse * INVERSE_GAIN < difference
