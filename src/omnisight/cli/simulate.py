"""omnisight simulate."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from omnisight.cli._progress import progress
from omnisight.cli._size import parse_range

Angles = Annotated[str | None, Parameter(allow_leading_hyphen=True)]

FRAMES, FPS = 60, 30.0
MOST_FRAMES, MOST_PIXELS = 100_000, 50_000_000
COARSE = 200  # pixels looked at across and down, to see whether a circle shows anything


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
    circle: Angles = None,
    exact: bool = False,
    seed: int = 0,
    quiet: bool = False,
    json: bool = False,
) -> None:
    """Render a camera's way through a scene, with the truth of every pixel: a data set to test other software with.

    Written are images, depth, normals and instances as PNG, poses in the TUM format, the camera, and a README.txt that
    says what each of them means.

    Parameters
    ----------
    scene
        room, street, boards or lines.
    camera
        The calibration file of the camera, of any format, non-central ones and rigs included.
    output
        The folder of the data set; made if it is not there. One that holds something else is refused.
    trajectory
        loop, line, turn or still; or a file of world_from_cam, in the TUM format (timestamp tx ty tz qx qy qz qw) or
        CSV of the same columns: the rig's, where the camera is one.
    up
        How loop, line, turn and still carry the camera: top, level; back, looking down as one under a mirror does, or
        front, looking up. A file says so itself.
    frames
        Images to take at most: 60, or as many as the file's time has.
    fps
        Images a second: 30, or where the file has its poses.
    rays
        Per pixel: 1, 4, 9 or 16.
    exposure
        Stops.
    vignette
        How much less light the rim gets than the middle, 0 to 1.
    blur
        Standard deviation of the lens' blur, px.
    noise
        Standard deviation at a middle gray, of 255.
    jpeg
        Write the images as JPEG of this quality.
    rolling_shutter
        Milliseconds from the first row to the last; the poses are those of the middle row.
    circle
        LOW:HIGH in degrees from the axis, outside which images are black; as far as the camera is calibrated, unless
        told otherwise.
    exact
        Write depth and normals as float32 arrays of numpy, not rounded to 16 bits.
    seed
        Of the noise, and of what in the scene is left to chance.
    quiet
        Show no progress.
    json
        Print what was written as JSON.
    """
    import sys
    import time

    import numpy as np

    import omnisight
    from omnisight.cli._dataset import Dataset
    from omnisight.simulation import Renderer, scene_named
    from omnisight.simulation.sensor import check_sensor
    from omnisight.simulation.trajectory import Trajectory

    begun = time.perf_counter()
    _check(frames, fps, rays, vignette, rolling_shutter, seed)
    check_sensor(exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
    heads = _heads(camera, circle)
    samples, readout = int(rays**0.5), rolling_shutter / 1e3
    with progress(quiet) as report:
        report("build the scene", 0, 1)
        place = scene_named(scene, seed)
        motion, times = _motion(trajectory, up, place.free, frames, fps)
        notes = _astray(place, motion, times, heads)
        for note in notes:
            print(f"note: {note}", file=sys.stderr)
        dataset = Dataset.begin(output, heads, exact=exact, jpeg=jpeg)
        report("build the scene", 1, 1)
        total = len(times) * len(heads)
        for k, head in enumerate(heads):
            for i, moment in enumerate(times):
                report("render", k * len(times) + i, total)
                rows = motion.rows(float(moment), head.camera.size[1], readout) if readout else None
                pose: Any = (
                    [p @ head.rig_from_camera for p in rows] if rows else motion.at(moment) @ head.rig_from_camera
                )
                renderer = Renderer(head.camera, pose, place, theta=head.theta, samples=samples, vignette=vignette)
                rng = np.random.default_rng((seed, k, i))
                picture = renderer(rng=rng, exposure=exposure, blur=blur, noise=noise)
                dataset.write(head, i, picture.image, renderer.truth())
            seen = [motion.at(float(moment)) @ head.rig_from_camera for moment in times]
            dataset.finish(head, Trajectory(times, tuple(seen)), scene, place.names)
        report("render", total, total)
    settings = {
        "omnisight": omnisight.__version__,
        "scene": scene,
        "camera": camera.name,
        "trajectory": trajectory,
        "up": up,
        "frames": len(times),
        "rays": rays,
        "exposure": exposure,
        "vignette": vignette,
        "blur": blur,
        "noise": noise,
        "jpeg": jpeg,
        "rolling_shutter_ms": rolling_shutter,
        "circle": circle,
        "seed": seed,
    }
    dataset.describe(settings, [motion.at(float(moment)) for moment in times], times)
    seconds = time.perf_counter() - begun
    if json:
        import json as text

        print(
            text.dumps(
                {
                    "output": str(output),
                    "cameras": [head.name or "camera" for head in heads],
                    **settings,
                    "notes": notes,
                    "seconds": seconds,
                }
            )
        )
        return
    cameras = f" by each of {len(heads)} cameras" if len(heads) > 1 else ""
    count = f"{len(times)} image{'s' if len(times) > 1 else ''}"
    print(f"written: {output}/ ({count} of the {scene}{cameras}, with the truth of each pixel)")
    print(f"{seconds:.0f} s; {output / 'README.txt'} says what is what")


def _check(
    frames: int | None, fps: float | None, rays: int, vignette: float, rolling_shutter: float, seed: int
) -> None:
    """Refuse options that mean nothing, before any work."""
    if rays not in (1, 4, 9, 16):
        raise ValueError(f"--rays must be 1, 4, 9 or 16, got {rays}")
    if frames is not None and not 1 <= frames <= MOST_FRAMES:
        raise ValueError(f"--frames must be from 1 to {MOST_FRAMES}, got {frames}")
    if fps is not None and not 1e-3 <= fps <= 1e5:
        raise ValueError(f"--fps must be from 0.001 to 100000 images a second, got {fps:g}")
    if not 0 <= vignette <= 1:
        raise ValueError(f"--vignette must be from 0 to 1, got {vignette:g}")
    if not 0 <= rolling_shutter <= 1e4:
        raise ValueError(f"--rolling-shutter must be from 0 to 10000 milliseconds, got {rolling_shutter:g}")
    if seed < 0:
        raise ValueError(f"--seed must not be negative, got {seed}")


def _heads(file: Path, circle: str | None) -> list[Any]:
    """Give the cameras of a file with their places on the rig; a lone camera is its own rig."""
    import math

    from omnisight.cli._dataset import Head
    from omnisight.formats import FormatError, load, load_rig
    from omnisight.geometry.pose import Pose
    from omnisight.ray_camera import RayCamera

    try:
        rig = load_rig(file)
        named = list(zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True))
    except FormatError:
        named = [("", load(file), Pose())]
    heads: list[Head] = []
    for name, camera, sensor_from_rig in named:
        if min(camera.size) < 1:
            raise ValueError(f"{file}: does not say how large the camera's images are")
        if camera.size[0] * camera.size[1] > MOST_PIXELS:
            raise ValueError(f"{file}: images of {camera.size[0]}x{camera.size[1]} px are too large to render")
        if isinstance(camera, RayCamera) and camera.unit != "m":
            raise ValueError(
                f"{file}: the lengths of this camera are in {camera.unit}, not metres: calibrate it with --square"
            )
        if not re.fullmatch(r"(\w[\w .-]{0,99})?", name):
            raise ValueError(f"{file}: the camera's name {name[:100]!r} is no name for a folder")
        if circle is None:
            theta = camera.theta_min, math.pi if camera.theta_max is None else camera.theta_max
        else:
            low, high = parse_range(circle, "--circle")
            if not 0 <= low < high <= 180:
                raise ValueError(f"--circle must be two angles from 0 to 180 degrees, such as 0:95, got {circle!r}")
            theta = math.radians(low), math.radians(high)
            if not _shows(camera, theta):
                raise ValueError(f"--circle {circle} leaves nothing of what {file} sees")
        heads.append(Head(name, camera, sensor_from_rig.inverse(), theta))
    return heads


def _shows(camera: Any, theta: tuple[float, float]) -> bool:
    """Say whether any of the image lies between two angles from the axis (radians)."""
    import numpy as np

    from omnisight.geometry.sphere import angle_from_axis

    across, down = (np.linspace(0, side - 1, min(side, COARSE)) for side in camera.size)
    rays = camera.rays(np.stack(np.meshgrid(across, down), -1))
    angle = angle_from_axis(rays.bearings[rays.valid])
    return bool(((angle >= theta[0]) & (angle <= theta[1])).any())


def _astray(scene: Any, motion: Any, times: Any, heads: list[Any]) -> list[str]:
    """Say where a camera stands in a solid or past a wall: its images show what nobody would see."""
    notes: list[str] = []
    for head in heads:
        places = [(motion.at(float(moment)) @ head.rig_from_camera).translation for moment in times]
        held = scene.what_holds(places)
        wrong = [i for i, name in enumerate(held) if name]
        if wrong:
            first = wrong[0]
            x, y, z = places[first]
            notes.append(
                f"{len(wrong)} of {len(times)} images{f' of {head.name}' * bool(head.name)} are taken from inside"
                f" what is solid or past a wall: {first:06d} at ({x:.2f}, {y:.2f}, {z:.2f}) m,"
                f" by {held[first]!r}; a camera may move from {scene.free[0]} to {scene.free[1]}"
            )
    return notes


def _motion(trajectory: str, up: str, free: Any, frames: int | None, fps: float | None) -> tuple[Any, Any]:
    """Give the motion and the times of its images."""
    import numpy as np

    from omnisight.geometry.pose import Pose
    from omnisight.geometry.rotation import look
    from omnisight.simulation.trajectory import PRESETS, Trajectory, preset_trajectory, read_trajectory

    if trajectory in PRESETS:
        count, rate = frames or FRAMES, fps or FPS
        level = preset_trajectory(trajectory, free, count / rate)
        carried = tuple(pose @ Pose(look(up=up)) for pose in level.poses)
        return Trajectory(level.times, carried), np.arange(count) / rate
    if up != "top":
        raise ValueError(f"--up {up} is for {', '.join(PRESETS)}: the poses of a file say themselves where up is")
    if not Path(trajectory).is_file():
        raise ValueError(
            f"--trajectory {trajectory}: there is no such file, and no such motion of {', '.join(PRESETS)}"
        )
    motion = read_trajectory(trajectory)
    times = motion.times
    if fps is not None:
        count = int((times[-1] - times[0]) * fps + 1e-6) + 1
        times = times[0] + np.arange(min(count, frames or MOST_FRAMES + 1)) / fps
    times = times[:frames]
    if len(times) > MOST_FRAMES:
        raise ValueError(f"{trajectory}: asks for more than {MOST_FRAMES} images; --frames or --fps takes fewer")
    return motion, times
