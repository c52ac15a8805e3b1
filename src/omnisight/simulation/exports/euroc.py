"""EuRoC's ASL format: images, IMU and ground truth of a visual-inertial sequence."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats import kalibr
from omnisight.geometry.pose import Pose
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import ExportFile, SimulatedSequence
from omnisight.simulation.motion_sensor_files import imu_table, nanoseconds, table
from omnisight.simulation.motion_sensors import EAST_NORTH_UP
from omnisight.simulation.trajectory import quaternion

DESCRIPTION = """\
euroc/       EuRoC's ASL format: mav0/cam0, imu0, state_groundtruth_estimate0. The world is x right, y forward,
             z up; the body frame is that of the IMU, the rig or the single camera. Images are links.
"""
NEEDS_IMU, NEEDS_SAMPLES = True, False

CAMERA_HEADER = "#timestamp [ns],filename"
STATE_HEADER = (
    "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],"
    "b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],"
    "b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
# Names of Kalibr, and those of EuRoC.
EUROC_NAMES = {
    "distortion_coeffs:": "distortion_coefficients:",
    "distortion_model: radtan": "distortion_model: radial-tangential",
}
IMU_YAML = """sensor_type: imu
comment: simulated
T_BS:
{pose}
rate_hz: {rate:.10g}
"""
CAMERA_YAML = """sensor_type: camera
comment: simulated
T_BS:
{pose}
rate_hz: {rate:.10g}
{lens}"""


def check(cameras: Sequence[MountedCamera]) -> None:
    """Check that Kalibr's models hold the cameras."""
    for camera in cameras:
        _lens(camera)


def files(sequence: SimulatedSequence) -> Iterator[ExportFile]:
    """Return the files of mav0."""
    imu = sequence.measurements.imu
    assert imu is not None
    yield "euroc/mav0/body.yaml", b"comment: simulated by omnisight\n"
    stamps = nanoseconds(sequence.times)
    rate = 1 / float(np.diff(sequence.times).mean()) if len(stamps) > 1 else 0.0
    for k, camera in enumerate(sequence.cameras):
        place = f"euroc/mav0/cam{k}"
        names = [f"{stamp}{sequence.suffix}" for stamp in stamps]
        for frame, name in enumerate(names):
            yield f"{place}/data/{name}", sequence.file(k, frame)
        lines = [CAMERA_HEADER, *(f"{stamp},{name}" for stamp, name in zip(stamps, names, strict=True))]
        yield f"{place}/data.csv", ("\n".join(lines) + "\n").encode()
        text = CAMERA_YAML.format(pose=_matrix(camera.rig_from_camera), rate=rate, lens=_lens(camera))
        yield f"{place}/sensor.yaml", text.encode()
    step = float(np.diff(imu.times).mean()) if len(imu.times) > 1 else 1.0
    yield "euroc/mav0/imu0/data.csv", imu_table(imu)
    noise = (sequence.folder / "motion" / "imu.yaml").read_text(encoding="utf-8").splitlines()
    densities = "".join(f"{line}\n" for line in noise if "noise_density" in line or "random_walk" in line)
    yield "euroc/mav0/imu0/sensor.yaml", (IMU_YAML.format(pose=_matrix(Pose()), rate=1 / step) + densities).encode()
    yield "euroc/mav0/state_groundtruth_estimate0/data.csv", table(STATE_HEADER, imu.times, _states(sequence))


def _states(sequence: SimulatedSequence) -> NDArray[np.float64]:
    """Return position, quaternion w x y z, velocity and biases (N, 16) at the times of the IMU, z up."""
    imu = sequence.measurements.imu
    assert imu is not None
    true = sequence.spline.kinematics(imu.times)
    quaternions = np.array([quaternion(EAST_NORTH_UP @ rotation) for rotation in true.rotation])[:, [3, 0, 1, 2]]
    linear = [part @ EAST_NORTH_UP.T for part in (true.position, true.velocity)]
    return np.column_stack([linear[0], quaternions, linear[1], imu.gyroscope_bias, imu.accelerometer_bias])


def _lens(camera: MountedCamera) -> str:
    """Return the fields of the lens, with the names of EuRoC; raise ValueError with the remedy if Kalibr has none."""
    label = f"camera {camera.name}" if camera.name else "the camera"
    if not isinstance(camera.camera, Camera):
        raise ValueError(f"--export euroc: {label} is non-central, and EuRoC's sensor.yaml has central cameras only")
    # Without poses of the camera's own file, which T_BS replaces.
    bare = replace(camera.camera, extra={})
    try:
        lines = kalibr.serialize(bare)[0].splitlines()[1:]
    except ValueError as error:
        raise ValueError(f"--export euroc: {label}: Kalibr {error}") from error
    text = "".join(f"{line.strip()}\n" for line in lines)
    for of_kalibr, of_euroc in EUROC_NAMES.items():
        text = text.replace(of_kalibr, of_euroc)
    return text


def _matrix(pose: Pose) -> str:
    """Return a pose as EuRoC's 4 x 4 matrix."""
    rows = [*pose.matrix.tolist(), [0.0, 0.0, 0.0, 1.0]]
    text = ",\n         ".join(", ".join(f"{value:.12g}" for value in row) for row in rows)
    return f"  cols: 4\n  rows: 4\n  data: [{text}]"
