"""omnisight simulate."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, warn, write_json
from omnisight.cli._progress import progress
from omnisight.cli._text_options import parse_range, text_parameter
from omnisight.motion_sensor_options import GnssNoise, ImuNoise, MotionSensors, OdometryNoise
from omnisight.pipeline.simulation.rendering_options import Conditions, RenderingOptions

GROUP = "Cameras"


def _parse_origin(text: str, option: str) -> tuple[float, float, float]:
    """Parse LATITUDE,LONGITUDE,ALTITUDE."""
    try:
        latitude, longitude, altitude = (float(part) for part in text.split(","))
    except ValueError:
        message = f"{option} must be LATITUDE,LONGITUDE,ALTITUDE, such as 47.3769,8.5417,408, got {text!r}"
        raise ValueError(message) from None
    return latitude, longitude, altitude


def _show_origin(origin: tuple[float, ...]) -> str:
    return ",".join(f"{value:g}" for value in origin)


def _parse_hours(text: str, option: str) -> float:
    """Parse HH:MM."""
    hours, _, minutes = text.partition(":")
    if not (hours.isdecimal() and minutes.isdecimal() and int(hours) < 24 and int(minutes) < 60):
        raise ValueError(f"{option} must be HH:MM, such as 17:30, got {text!r}")
    return int(hours) + int(minutes) / 60


def _parse_names(text: str, option: str) -> tuple[str, ...]:
    """Parse names that are separated by commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


@dataclass(frozen=True)
class _MotionSensors(MotionSensors):
    """Sensors of the motion.

    Attributes
    ----------
    origin
        LATITUDE,LONGITUDE,ALTITUDE of the world's origin, degrees and metres.
    """

    noise: Annotated[float, Parameter(name="--sensor-noise")] = MotionSensors.noise
    origin: Annotated[tuple[float, float, float], text_parameter(_parse_origin, _show_origin)] = MotionSensors.origin
    imu_noise: Annotated[ImuNoise, Parameter(parse=False)] = field(default_factory=ImuNoise)
    odometry_noise: Annotated[OdometryNoise, Parameter(parse=False)] = field(default_factory=OdometryNoise)
    gnss_noise: Annotated[GnssNoise, Parameter(parse=False)] = field(default_factory=GnssNoise)


@dataclass(frozen=True)
class _Conditions(Conditions):
    """Conditions of the visit.

    Attributes
    ----------
    time
        Local solar time HH:MM of an outdoor scene, such as 17:30, at the latitude of --origin on 1 May; default: the
        scene's usual sun.
    """

    time: Annotated[float | None, text_parameter(_parse_hours)] = None


@dataclass(frozen=True, kw_only=True)
class _RenderingOptions(RenderingOptions):
    """Options of the data set.

    Attributes
    ----------
    circle
        LOW:HIGH in degrees from the axis; images are black outside. Default: the calibrated field of view.
    export
        Other formats to write besides, separated by commas: colmap, covisibility (pairs that see the same, and loops),
        euroc, kitti, nerfstudio (transforms.json).
    """

    circle: Annotated[tuple[float, float] | None, text_parameter(parse_range)] = None
    motion_sensors: Annotated[_MotionSensors, Parameter(name="*")] = _MotionSensors()
    conditions: Annotated[_Conditions, Parameter(name="*")] = _Conditions()
    export: Annotated[tuple[str, ...], text_parameter(_parse_names, ",".join)] = ()


def simulate(
    scene: str,
    /,
    *,
    camera: Path,
    output: Annotated[Path, Parameter(alias="-o")],
    options: Annotated[_RenderingOptions, Parameter(name="*")] = _RenderingOptions(),
) -> None:
    """Render a data set with ground truth: images of a scene along a trajectory, through any camera.

    Write images, depth, normals and instances as PNG, poses in the TUM format, the camera, and a README.txt that
    describes them.

    Parameters
    ----------
    scene
        room, rooms, street, town, boards or lines.
    camera
        Calibration file of any format; non-central cameras and rigs are supported.
    output
        Folder of the data set; created if needed. A folder with other content is refused.
    """
    from omnisight.pipeline.simulation.simulate import simulate as render_dataset
    from omnisight.pipeline.simulation.simulate_options import SimulateOptions

    with progress() as report:
        result = render_dataset(SimulateOptions(scene, camera, output, **vars(options)), progress=report, warn=warn)
    names = [head.name or "camera" for head in result.cameras]
    if is_json():
        summary = {"output": str(output), "cameras": names, **result.settings}
        write_json(summary | {"notes": result.notes, "seconds": result.seconds})
        return
    each = f", {len(names)} cameras" if len(names) > 1 else ""
    print(f"scene     {scene}, trajectory {options.trajectory}{each}")
    print(f"images    {result.frames * len(names)}, with depth, normals, instances and poses; {result.seconds:.0f} s")
    print(f"written   {output}/ (described in {output / 'README.txt'})")
