"""Evaluation of calibrated cameras on images they were not calibrated on: `omnisight evaluate`."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from omnisight.calibration.evaluation import Evaluation, evaluate_camera
from omnisight.camera import Camera
from omnisight.choices import check_options
from omnisight.formats import load
from omnisight.pipeline.calibration.calibrate_options import EvaluateOptions
from omnisight.pipeline.detection.detect import Source, load_observations
from omnisight.pipeline.detection.detection_advice import explain_no_detection
from omnisight.progress import Progress, no_progress
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

AnyCamera = Camera | RayCamera


def evaluate(
    cameras: AnyCamera | str | PathLike[str] | Mapping[str, AnyCamera],
    source: Source,
    options: EvaluateOptions = EvaluateOptions(),
    *,
    progress: Progress = no_progress,
) -> dict[str, Evaluation]:
    """Evaluate cameras on images of a board, or on corners; only board poses and board warp are estimated.

    Corners are used as first detected, without re-detection, which would favour the camera that predicts them.

    Parameters
    ----------
    cameras
        A camera or its file, or several cameras by name, all evaluated on the same corners.
    source
        As in `load_observations`.
    options
        Options of the command.
    progress
        Called with (stage, done, total).

    Returns
    -------
    dict
        The evaluation of each camera by its name; "camera" for a single one.

    Raises
    ------
    ValueError
        If the cameras are of another type, there are no corners, or a camera is for images of another size or in
        another unit than the board.
    """
    check_options(options, EvaluateOptions)
    cameras = _by_name(cameras)
    observations = load_observations(source, options, progress=progress)
    if not len(observations) and observations.detections is not None:
        raise ValueError(explain_no_detection(observations.detections))
    evaluations: dict[str, Evaluation] = {}
    for i, (name, camera) in enumerate(cameras.items()):
        progress("evaluate", i, len(cameras))
        _check_camera(camera, name, observations)
        evaluations[name] = evaluate_camera(camera, observations, threshold=options.threshold, flat=options.flat)
    progress("evaluate", len(cameras), len(cameras))
    return evaluations


def _by_name(cameras: Any) -> dict[str, AnyCamera]:
    """Return the cameras by name."""
    if isinstance(cameras, str | PathLike):
        return {Path(cameras).name: load(Path(cameras), option=None)}
    if isinstance(cameras, Camera | RayCamera):
        return {"camera": cameras}
    if not isinstance(cameras, Mapping) or not all(isinstance(c, Camera | RayCamera) for c in cameras.values()):
        raise ValueError(
            f"cameras must be a Camera, its file, or a dict of cameras by name, got {type(cameras).__name__}"
        )
    return dict(cameras)


def _check_camera(camera: Camera | RayCamera, name: str, observations: Observations) -> None:
    """Check that a camera is for images of this size, and in the unit of the board if it is non-central."""
    size = observations.size
    if all(camera.size) and all(size) and camera.size != size:
        raise ValueError(
            f"{name}: for images of {camera.width}x{camera.height} px, but these are {size[0]}x{size[1]} px: specify"
            " images as the camera recorded them"
        )
    if isinstance(camera, RayCamera) and camera.unit != observations.unit:
        action = "specify --square, such as --square 30mm" if camera.unit == "m" else "leave out --square"
        raise ValueError(
            f"{name}: a non-central camera with lengths in {camera.unit}, but those of the board are in"
            f" {observations.unit}: {action}"
        )
