"""Read the central camera of a calibration file, or the one that approximates a non-central camera, for an image."""

import dataclasses
import re
from os import PathLike
from pathlib import Path

from omnisight.camera import Camera
from omnisight.display import rounded
from omnisight.formats import load, load_all
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.views import sphere
from omnisight.views.image_size import is_resized, size_mismatch

CameraSource = Camera | str | PathLike[str]
AnyCameraSource = CameraSource | RayCamera

MAX_ERROR_PX = 1.0  # of the central approximation at its distance


def central_camera(
    source: AnyCameraSource,
    *,
    name: str | None = None,
    option: str = "--name",
    distance: str | None = None,
    accepts_distance: bool = True,
) -> Camera:
    """Return a camera, or that of a calibration file of any format, as a central one.

    Parameters
    ----------
    source
        The camera, or its file.
    name
        The camera to read if the file holds several.
    option
        The option of the command line that specifies `name`.
    distance
        The distance of the scene from a non-central camera, with its unit: "2m", "20squares" or "inf".
    accepts_distance
        Whether the caller has an option for the distance, which the message then names.

    Raises
    ------
    ValueError
        If the camera is non-central and `distance` is missing or invalid, or central and `distance` is given.
    """
    label = "the camera" if isinstance(source, Camera | RayCamera) else f"{source}, {name}" if name else str(source)
    return central_approximation(load_camera(source, name, option), distance, label, accepts_distance=accepts_distance)


def load_camera(source: AnyCameraSource, name: str | None = None, option: str | None = "--name") -> Camera | RayCamera:
    """Return a camera, or that of a calibration file of any format; `option` specifies the name, see `load`.

    Raises
    ------
    ValueError
        If it is a rig, or the file cannot be read.
    """
    if isinstance(source, Rig):
        names = ", ".join(source.names)
        raise ValueError(f"a rig of {len(source)} cameras ({names}): pass one of them, such as rig.cameras[0]")
    return source if isinstance(source, Camera | RayCamera) else load(Path(source), name=name, option=option)


def load_sensor(path: str | PathLike[str], name: str) -> Camera | RayCamera:
    """Return the camera of a sensor: that of its name in a file of several, such as a rig, else the only one.

    Raises
    ------
    ValueError
        If the file cannot be read, or holds several cameras and none of this name.
    """
    file = Path(path)
    return load(file, name=name if len(load_all(file)) > 1 else None)


def central_approximation(
    camera: Camera | RayCamera, distance: str | None, where: str, *, accepts_distance: bool = True
) -> Camera:
    """Return a central camera as it is, or the one that approximates a non-central camera; see `central_camera`."""
    if isinstance(camera, Camera):
        if distance is not None:
            raise ValueError(f"--distance is for non-central cameras, and {where} is central: leave it out")
        return camera
    reason = f"{where}: a non-central camera ({camera.model.name})"
    if not accepts_distance:
        raise ValueError(f"{reason}, which this command does not support: use the central one, of --model auto")
    if distance is None:
        example = "2m" if camera.unit == "m" else "20squares"
        raise ValueError(
            f"{reason}: specify the distance of the scene, such as --distance {example}; the central camera that fits"
            " there is used"
        )
    length = _parse_distance(distance, camera.unit)
    central, error = camera.central(length)
    if not error <= MAX_ERROR_PX:
        central, error = camera.central(length, "spline")
    if not error <= MAX_ERROR_PX:
        raise ValueError(
            f"{reason}: at {distance} every central camera is at least {rounded(error)} px off, {MAX_ERROR_PX:g}"
            " allowed: specify a larger distance, or inf"
        )
    return central


def camera_of_image(
    source: CameraSource | None,
    size: tuple[int, int],
    image: str,
    *,
    name: str | None,
    option: str = "--name",
    scale: bool,
) -> Camera:
    """Return the camera for an image of a size: a given one, that of a file, or without both an equirectangular one.

    Raises
    ------
    ValueError
        If there is none and the image is not twice as wide as high, or the size does not fit.
    """
    if source is None:
        if size[0] != 2 * size[1]:
            raise ValueError(
                f"{image}: is {size[0]}x{size[1]} px, and only 2:1 equirectangular images need no camera: specify"
                " its calibration file (--camera)"
            )
        return sphere(size[0])
    camera = central_camera(source, name=name, option=option, accepts_distance=False)
    return fit_camera(camera, size, image, scale=scale)


def fit_camera(camera: Camera, size: tuple[int, int], image: str, *, scale: bool) -> Camera:
    """Return the camera for an image of a size, scaled on request.

    Raises
    ------
    ValueError
        If the size does not fit; the message starts with the name of the image.
    """
    if min(camera.size) < 1:  # a file without an image size
        return dataclasses.replace(camera, size=size)
    if size == camera.size:
        return camera
    if not (scale and is_resized(size, camera.size)):
        raise ValueError(f"{image}: {size_mismatch(size, camera.size)}")
    return dataclasses.replace(camera.scaled(size[0] / camera.width), size=size)


def _parse_distance(text: str, unit: str) -> float:
    """Return a distance in the unit of a camera."""
    if text.strip().lower() in ("inf", "far"):
        return float("inf")
    if unit == "m":
        from omnisight.targets.length import parse_length  # takes 0.3 s to import

        return parse_length(text, "--distance")
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(squares?)?\s*", text)
    if match is None or not float(match[1]) > 0:
        raise ValueError(f"--distance {text}: the lengths of this camera are in squares of its board: 20squares")
    return float(match[1])
