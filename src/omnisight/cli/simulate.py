"""omnisight simulate."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from omnisight.cli._output import is_json, warn, write_json
from omnisight.cli._progress import progress
from omnisight.cli._size import parse_range

GROUP = "Cameras"

Angles = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
Origin = Annotated[str, Parameter(allow_leading_hyphen=True)]


def simulate(
    scene: str,
    /,
    *,
    camera: Path,
    output: Annotated[Path, Parameter(alias="-o")],
    trajectory: str = "loop",
    up: Literal["top", "back", "front"] = "top",
    frames: int | None = None,
    fps: float | None = None,
    rays: int = 4,
    exposure: Annotated[float, Parameter(allow_leading_hyphen=True)] = 0.0,
    vignette: float = 0.35,
    blur: float = 0.7,
    noise: float = 1.5,
    jpeg: int | None = None,
    rolling_shutter: float = 0.0,
    exposure_time: float = 0.0,
    circle: Angles = None,
    exact: bool = False,
    seed: int = 0,
    imu: float = 0.0,
    odometry: float = 0.0,
    gnss: float = 0.0,
    sensor_noise: float = 1.0,
    origin: Origin = "47.3769,8.5417,408",
    time: str | None = None,
    weather: Literal["clear", "overcast", "rain", "fog"] = "clear",
    exposure_drift: float = 0.0,
    visit: int = 0,
    traffic: bool = False,
    export: str = "",
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
    trajectory
        loop, line, turn or still, at the speed of a walking person; loop follows the roads of the town, as a car, and
        enters all rooms of `rooms`. Or a file of world_from_cam poses (world_from_rig for a rig), in the TUM format
        (timestamp tx ty tz qx qy qz qw) or CSV with the same columns.
    up
        Orientation of the camera on loop, line, turn and still: top is level; back looks down, as below a mirror; front
        looks up.
    frames
        Maximum number of images: 60, or all poses of a file.
    fps
        Images per second. By default the images are spread over the motion, or have the timestamps of a file.
    rays
        Rays per pixel: 1, 4, 9 or 16.
    exposure
        Exposure, stops.
    vignette
        Relative loss of light at the edge of the lens's image, 0 to 1; panoramas have none.
    blur
        Standard deviation of the lens blur, px.
    noise
        Standard deviation of the noise at middle gray, of 255.
    jpeg
        Write the images as JPEG of this quality.
    rolling_shutter
        Readout time from the first to the last row, milliseconds; poses are those of the middle row.
    exposure_time
        Duration of the exposure, milliseconds, for motion blur; 0 for sharp images. The pose is that of its middle.
    circle
        LOW:HIGH in degrees from the axis; images are black outside. Default: the calibrated field of view.
    exact
        Write depth and normals as float32 NumPy arrays instead of 16-bit images.
    seed
        Seed of the noise and of random parts of the scene.
    imu
        Samples per second of an IMU at the body's origin, such as 200; 0 for none. With any sensor of the motion, the
        poses are interpolated by a twice continuously differentiable spline.
    odometry
        Samples per second of wheel odometry: forward speed and yaw rate; 0 for none.
    gnss
        Positions per second of a GNSS receiver; 0 for none.
    sensor_noise
        Factor of the noise and biases of these sensors; 0 for exact measurements.
    origin
        LATITUDE,LONGITUDE,ALTITUDE of the world's origin, degrees and metres.
    time
        Local solar time HH:MM of an outdoor scene, such as 17:30, at the latitude of --origin on 1 May; default: the
        scene's usual sun.
    weather
        Weather of an outdoor scene.
    exposure_drift
        Standard deviation of a slow random change of the exposure, stops; exposure.csv has that of each image.
    visit
        Number of the visit of the town: other cars are parked at each, and everything else is the same.
    traffic
        Cars drive and people walk through the town; masks/ is white where the image shows what is static.
    export
        Other formats to write besides, separated by commas: colmap, covisibility (pairs that see the same, and loops),
        euroc, kitti, nerfstudio (transforms.json).
    """
    from omnisight.pipeline.simulate import simulate as render_dataset
    from omnisight.pipeline.simulate_options import Conditions, SimulateOptions
    from omnisight.simulation.motion_sensors import MotionSensors

    options = SimulateOptions(
        scene,
        camera,
        output,
        trajectory=trajectory,
        up=up,
        frames=frames,
        fps=fps,
        rays=rays,
        exposure=exposure,
        vignette=vignette,
        blur=blur,
        noise=noise,
        jpeg=jpeg,
        rolling_shutter=rolling_shutter,
        exposure_time=exposure_time,
        circle=None if circle is None else parse_range(circle, "--circle"),
        exact=exact,
        seed=seed,
        motion_sensors=MotionSensors(imu, odometry, gnss, sensor_noise, _origin(origin)),
        conditions=Conditions(None if time is None else _hours(time), weather, exposure_drift, visit, traffic),
        export=tuple(name.strip() for name in export.split(",") if name.strip()),
    )
    with progress() as report:
        result = render_dataset(options, progress=report, warn=warn)
    names = [head.name or "camera" for head in result.cameras]
    if is_json():
        summary = {"output": str(output), "cameras": names, **result.settings}
        write_json(summary | {"notes": result.notes, "seconds": result.seconds})
        return
    each = f", {len(names)} cameras" if len(names) > 1 else ""
    print(f"scene     {scene}, trajectory {trajectory}{each}")
    print(f"images    {result.frames * len(names)}, with depth, normals, instances and poses; {result.seconds:.0f} s")
    print(f"written   {output}/ (described in {output / 'README.txt'})")


def _origin(text: str) -> tuple[float, float, float]:
    """Parse LATITUDE,LONGITUDE,ALTITUDE."""
    try:
        latitude, longitude, altitude = (float(part) for part in text.split(","))
    except ValueError:
        message = f"--origin must be LATITUDE,LONGITUDE,ALTITUDE, such as 47.3769,8.5417,408, got {text!r}"
        raise ValueError(message) from None
    return latitude, longitude, altitude


def _hours(text: str) -> float:
    """Parse HH:MM."""
    hours, _, minutes = text.partition(":")
    if not (hours.isdecimal() and minutes.isdecimal() and int(hours) < 24 and int(minutes) < 60):
        raise ValueError(f"--time must be HH:MM, such as 17:30, got {text!r}")
    return int(hours) + int(minutes) / 60
