"""The cameras of a rig, each calibrated alone or known from a file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.evaluation import evaluate_camera
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.redetection import redetect
from omnisight.calibration.rigs.frame_uncertainty import frame_covariance
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.formats import load
from omnisight.pipeline.calibrate import calibrate, drop_images
from omnisight.pipeline.calibrate_rig_options import CalibrateRigOptions
from omnisight.pipeline.calibration import Calibration
from omnisight.pipeline.detect import load_observations
from omnisight.pipeline.detection_advice import explain_no_detection
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

# Ratio of the residuals of two cameras on the same images below which the better one is theirs: the residuals of one
# camera differ less between its own calibrations.
EXCHANGED_RATIO = 0.7


@dataclass(frozen=True, eq=False)
class RigCamera:
    """A camera of a rig before the joint refinement.

    Attributes
    ----------
    name
        Its name.
    camera
        The camera.
    observations, state
        Its views, with board poses and board warp estimated from it alone.
    directions
        (P, F) free directions of its parameters; F = 0 for a known camera.
    warp
        Whether the board is warped significantly.
    calibration
        Its calibration alone; None for a known camera.
    frame_covariance
        (3, 3) covariance of the orientation of its frame due to the choice of the model, rad^2.
    """

    name: str
    camera: Camera | RayCamera
    observations: Observations
    state: State
    directions: Array
    warp: bool
    calibration: Calibration | None
    frame_covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def rms(self) -> float:
        """Root mean square residual length of the camera alone, px."""
        return float(np.sqrt((self.state.lengths(self.observations) ** 2).mean()))


def rig_camera(name: str, source: Any, options: CalibrateRigOptions, progress: Progress) -> RigCamera:
    """Calibrate a camera of a rig alone, or pose the boards that a known camera observes.

    Raises
    ------
    ValueError
        If the camera sees too few boards, or a known camera is for other images; the message has its name.
    """

    def report(stage: str, done: int, total: int) -> None:
        progress(f"{name}: {stage}", done, total)

    file = options.camera_files.get(name)
    try:
        if file is not None:
            return _known_camera(name, source, file, options, report)
        single = options.single()
        observations = _dropped(load_observations(source, single, progress=report), options)
        calibration = calibrate(observations, single, progress=report)
    except FileNotFoundError:
        raise
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    free = calibration.best.free_parameters
    return RigCamera(
        name,
        calibration.camera,
        calibration.observations,
        replace(calibration.state, bends=None),
        free.directions,
        free.warp,
        calibration,
        frame_covariance(calibration.best, calibration.candidates, calibration.observations),
    )


def _known_camera(name: str, source: Any, file: Path, options: CalibrateRigOptions, progress: Progress) -> RigCamera:
    camera = load(file)
    observations = _dropped(load_observations(source, options.single(), progress=progress), options)
    if not len(observations):
        detections = observations.detections
        raise ValueError("no views of a board" if detections is None else explain_no_detection(detections))
    size = observations.size
    if all(camera.size) and all(size) and camera.size != size:
        raise ValueError(
            f"{file}: for images of {camera.width}x{camera.height} px, but these are {size[0]}x{size[1]} px: are the"
            " folders of two cameras swapped? Otherwise specify images as the camera recorded them"
        )
    evaluation = evaluate_camera(camera, observations, flat=options.flat)
    if isinstance(camera, Camera):
        observations, _ = redetect(observations, evaluation.state, apply_exif=options.apply_exif, progress=progress)
        evaluation = evaluate_camera(camera, observations, flat=options.flat)
    model = camera.model
    directions = np.zeros((len(model.params), 0))
    if options.refine_cameras:
        directions = FreeParameters.of(model, fixed=options.fix, free=options.free).directions
    warp = bool(evaluation.state.warp.any())
    return RigCamera(name, camera, observations, evaluation.state, directions, warp, None)


def _dropped(observations: Observations, options: CalibrateRigOptions) -> Observations:
    """Return the observations without the images to drop that this camera has."""
    known = observations.image_names or observations.names
    return drop_images(observations, [name for name in options.drop if name in known])


def check_not_exchanged(cameras: Sequence[RigCamera]) -> None:
    """Check that no known camera fits the images of another one better than its own.

    Raises
    ------
    ValueError
        If two folders or two camera files seem to be exchanged.
    """
    known = [camera for camera in cameras if camera.calibration is None]
    for own in known:
        for other in known:
            if other is own or other.observations.size != own.observations.size:
                continue
            lengths = evaluate_camera(other.camera, own.observations).lengths
            rms = float(np.sqrt(np.nanmean(lengths**2)))
            if rms < EXCHANGED_RATIO * own.rms:
                raise ValueError(
                    f"the images of {own.name} fit the camera file of {other.name} better than that of {own.name}"
                    f" ({rms:.2f} and {own.rms:.2f} px): are the folders exchanged?"
                )
