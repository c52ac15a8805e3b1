"""Comparison of two cameras: the counterpart of `omnisight compare`."""

import dataclasses
import math
from os import PathLike
from pathlib import Path

from omnisight.camera import Camera
from omnisight.images.output_paths import image_labels
from omnisight.pipeline.conversion.compare_options import CompareOptions
from omnisight.pipeline.inputs.camera_sources import AnyCameraSource
from omnisight.pipeline.inputs.central_camera import central_approximation, fit_camera, load_camera
from omnisight.quality.camera_comparison import CameraComparison
from omnisight.ray_camera import RayCamera


def compare(a: AnyCameraSource, b: AnyCameraSource, options: CompareOptions = CompareOptions()) -> CameraComparison:
    """Compare two cameras over their common calibrated field of view.

    Poses estimated with a camera absorb rotations of its frame. The difference after the best rotation is therefore the
    one to judge. It is tested against the covariances of both cameras, as independent calibrations have them; two
    calibrations from the same images differ less.

    Parameters
    ----------
    a, b
        Cameras, or calibration files of any format. If the images of b are larger or smaller than those of a, with the
        same aspect ratio, b is scaled.
    options
        Names in files of several cameras, the distance for non-central cameras, and the grid.

    Returns
    -------
    comparison
        Maps of the difference and of both uncertainties, the p-value and the verdict.

    Raises
    ------
    ValueError
        If the aspect ratios differ, the cameras have no field of view in common, or a file cannot be read.
    """
    names = _names((a, b), (options.name, options.other_name))
    cameras = load_camera(a, options.name), load_camera(b, options.other_name, "--other-name")
    if options.distance is not None and all(isinstance(camera, Camera) for camera in cameras):
        raise ValueError("--distance is for non-central cameras, and both are central: leave it out")
    first, second = (_central(camera, options, name) for camera, name in zip(cameras, names, strict=True))
    if not all(first.size):
        first = dataclasses.replace(first, size=second.size)
    if not all(first.size):
        raise ValueError(f"{names[0]} and {names[1]}: have no image size; add it to a file")
    second = fit_camera(second, first.size, f"{names[1]} is compared with {names[0]}", scale=True)
    max_theta = math.pi if options.max_theta is None else math.radians(options.max_theta)
    return CameraComparison.of(first, second, names, columns=options.columns, max_theta=max_theta)


def _central(camera: Camera | RayCamera, options: CompareOptions, label: str) -> Camera:
    """Return a central camera, or the one that approximates a non-central camera."""
    distance = options.distance if isinstance(camera, RayCamera) else None
    return central_approximation(camera, distance, label)


def _names(sources: tuple[AnyCameraSource, AnyCameraSource], cameras: tuple[str | None, str | None]) -> tuple[str, str]:
    """Return the names of two files and of the cameras in them, with folders if they are equal, or "a" and "b"."""
    paths = [Path(s) if isinstance(s, str | PathLike) else Path(name) for s, name in zip(sources, "ab", strict=True)]
    suffixes = [f" ({camera})" if camera else "" for camera in cameras]
    a, b = (path.name + suffix for path, suffix in zip(paths, suffixes, strict=True))
    if a == b:
        a, b = (label + suffix for label, suffix in zip(image_labels(paths), suffixes, strict=True))
    return a, b
