"""A rig from several calibration files whose cameras have poses relative to the same IMU."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from omnisight.camera import Camera
from omnisight.formats._registry import is_rig_file, load_all, load_rig
from omnisight.formats._rigs import IMU, imu_poses, make_rig, shared_time_offsets
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig


def load_joined_rig(paths: Sequence[Path]) -> Rig:
    """Return the rig of one file, or of several that share an IMU, such as Kalibr's camchains with `T_cam_imu`.

    The frame of a joined rig is that of its first camera. A camera whose name occurs in several files is named after
    its topic, or else its file.

    Raises
    ------
    ValueError
        If the pose of a camera relative to the IMU is unknown, or files hold the same camera.
    """
    if len(paths) == 1:
        return load_rig(paths[0])
    found = [(path, name, camera, pose) for path in paths for name, camera, pose in _cameras_of_imu(path)]
    names = _distinct_names([(path, name, camera) for path, name, camera, _ in found])
    offsets = shared_time_offsets(camera for _, _, camera, _ in found)
    sensors = [(_without_overlaps(camera), pose) for _, _, camera, pose in found]
    return make_rig(dict(zip(names, sensors, strict=True)), offsets).with_reference(0)


def _cameras_of_imu(path: Path) -> list[tuple[str, Camera, Pose]]:
    """Return name, camera and cam_from_imu of the cameras of a file."""
    if is_rig_file(path):
        rig = load_rig(path)
        names, sensors, poses = rig.names, rig.cameras, imu_poses(rig)
    else:
        cameras = load_all(path)
        names, sensors = tuple(cameras), tuple(cameras.values())
        poses = imu_poses(Rig(sensors[:1], (Pose(),), names[:1]))
    central = [camera for camera in sensors if isinstance(camera, Camera)]
    if poses is None or len(central) < len(sensors) or len(poses) < len(sensors):
        raise ValueError(
            f"{path}: the pose of {names[0]} relative to the {IMU} is unknown, which joins the cameras of several"
            " files: it needs T_cam_imu of every camera, as Kalibr's camchain-imucam files have"
        )
    return list(zip(names, central, poses, strict=True))


def _without_overlaps(camera: Camera) -> Camera:
    """Return a camera without the numbers of the overlapping cameras of its file."""
    return replace(camera, extra={key: value for key, value in camera.extra.items() if key != "cam_overlaps"})


def _distinct_names(cameras: Sequence[tuple[Path, str, Camera]]) -> list[str]:
    """Return a name for each camera, no two of them equal."""
    candidates = (
        [name for _, name, _ in cameras],
        [_topic_name(camera) or name for _, name, camera in cameras],
        [f"{path.stem}-{name}" for path, name, _ in cameras],
    )
    for names in candidates:
        if len(set(names)) == len(names):
            return names
    repeated = Counter(candidates[-1]).most_common(1)[0][0]
    raise ValueError(f"{repeated}: this camera is specified twice")


def _topic_name(camera: Camera) -> str:
    """Return the part of a ROS topic that names its camera: cam2 of /alphasense/cam2/image_raw; empty without one."""
    parts = [part for part in str(camera.extra.get("rostopic", "")).split("/") if part]
    return parts[-2] if len(parts) > 1 else ""
