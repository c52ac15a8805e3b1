"""The cameras of a rig, each calibrated alone or known from a file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.evaluation import evaluate_camera
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.redetection import redetect
from omnisight.calibration.resection import resect
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.pipeline.calibration.calibrate import calibrate, drop_images
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.detection.detect import load_observations
from omnisight.pipeline.detection.detection_advice import ForceRequired, explain_no_detection
from omnisight.pipeline.inputs.central_camera import load_sensor
from omnisight.pipeline.rig_calibration.calibrate_rig_options import CalibrateRigOptions
from omnisight.progress import Progress
from omnisight.ray_camera import RayCamera
from omnisight.targets import Board
from omnisight.targets.observations import Observations
from omnisight.targets.set_checks import is_mirrored

Array = NDArray[np.float64]
Boards = Mapping[str, Observations]

# Ratio of the residuals of two cameras on the same images below which the better one is theirs: the residuals of one
# camera differ less between its own calibrations.
EXCHANGED_RATIO = 0.7


@dataclass(frozen=True, eq=False)
class RigCamera(Displayed):
    """A camera of a rig before the joint refinement.

    Attributes
    ----------
    name
        Its name.
    camera
        The camera.
    boards
        Its views of each board by the name of the board.
    states
        Board poses and board warp of each board, estimated from this camera alone.
    directions
        (P, F) free directions of its parameters; F = 0 for a known camera.
    warp
        Whether a board is warped significantly.
    calibration
        Its calibration alone; None for a known camera.
    """

    name: str
    camera: Camera | RayCamera
    boards: Boards
    states: Mapping[str, State]
    directions: Array
    warp: bool
    calibration: Calibration | None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of its images, px."""
        return next(observations.size for observations in self.boards.values())

    @property
    def images(self) -> list[str]:
        """Names of the images in which it sees a board."""
        return list(dict.fromkeys(name for observations in self.boards.values() for name in observations.names))

    @property
    def rms(self) -> float:
        """Root mean square residual length of the camera alone, px."""
        lengths = [self.states[board].lengths(observations) for board, observations in self.boards.items()]
        return float(np.sqrt((np.concatenate(lengths) ** 2).mean()))

    @property
    def is_held(self) -> bool:
        """Whether it is a known central camera that is not refined."""
        return self.calibration is None and not self.directions.size and isinstance(self.camera, Camera)

    @property
    def median_length(self) -> float:
        """Median residual length of the board with most corners, px, of the camera alone."""
        board, observations = self._largest
        return float(np.nanmedian(self.states[board].lengths(observations)))

    @property
    def refined_median_length(self) -> float:
        """The same with the parameters of the camera refined."""
        board, observations = self._largest
        return float(np.nanmedian(refine(self.states[board], observations).state.lengths(observations)))

    @property
    def _largest(self) -> tuple[str, Observations]:
        return max(self.boards.items(), key=lambda item: len(item[1].pixels))


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
        boards = _load_boards(source, options, report)
        if file is not None:
            return _known_camera(name, boards, file, options, report)
        if len(boards) > 1:
            return _camera_of_several_boards(name, boards, options, report)
        (board, observations), *_ = boards.items()
        calibration = calibrate(observations, options.single(), progress=report)
    except FileNotFoundError:
        raise
    except ValueError as error:
        reason = error.reason if isinstance(error, ForceRequired) else error
        raise ValueError(f"{name}: {reason}") from error
    state = replace(calibration.state, bends=None)
    return _calibrated_camera(name, calibration, {board: calibration.observations}, {board: state})


def _load_boards(source: Any, options: CalibrateRigOptions, progress: Progress) -> Boards:
    """Return the views of each board; those of several boards may be given by the name of the board."""
    if isinstance(source, Mapping):
        return _without_dropped(
            {str(board): load_observations(views, options.single()) for board, views in source.items()}, options
        )
    found: dict[str, Observations] = {}
    for board, target in options.targets.items():

        def report(stage: str, done: int, total: int, board: str = board) -> None:
            progress(stage if len(options.targets) == 1 else f"{stage}, {board}", done, total)

        found[board] = load_observations(source, options.single(target), progress=report)
    return _without_dropped(found, options)


def _camera_of_several_boards(name: str, boards: Boards, options: CalibrateRigOptions, progress: Progress) -> RigCamera:
    """Calibrate a camera from several boards.

    The corners are measured again as in `calibrate`, with an initial camera from all boards.
    """
    initial = estimate_initial_camera(Observations.joined(boards)).central_model
    boards = {
        board: redetect(views, resect(initial, views), apply_exif=options.apply_exif, progress=progress)[0]
        for board, views in boards.items()
        if len(views)
    }
    calibration = calibrate(Observations.joined(boards), options.single(), progress=progress)
    boards = {board: views for board, views in boards.items() if len(views)}
    states = {
        board: evaluate_camera(calibration.camera, views, flat=options.flat).state for board, views in boards.items()
    }
    return _calibrated_camera(name, calibration, boards, states)


def _calibrated_camera(name: str, calibration: Calibration, boards: Boards, states: Mapping[str, State]) -> RigCamera:
    free = calibration.best.free_parameters
    return RigCamera(name, calibration.camera, boards, states, free.directions, free.warp, calibration)


def _known_camera(name: str, boards: Boards, file: Path, options: CalibrateRigOptions, progress: Progress) -> RigCamera:
    camera = load_sensor(file, name)
    used, states = dict[str, Observations](), dict[str, State]()
    for board, observations in boards.items():
        if not len(observations):
            continue
        size = observations.size
        if all(camera.size) and all(size) and camera.size != size:
            raise ValueError(
                f"{file}: for images of {camera.width}x{camera.height} px, but these are {size[0]}x{size[1]} px: are"
                " the folders of two cameras swapped? Otherwise specify images as the camera recorded them"
            )
        evaluation = evaluate_camera(camera, observations, flat=options.flat)
        if isinstance(camera, Camera):
            observations, _ = redetect(observations, evaluation.state, apply_exif=options.apply_exif, progress=progress)
            evaluation = evaluate_camera(camera, observations, flat=options.flat)
        used[board], states[board] = observations, evaluation.state
    if not used:
        detections = next(observations.detections for observations in boards.values())
        raise ValueError(
            "there are no views of a board: specify images or corner files that show one"
            if detections is None
            else explain_no_detection(detections)
        )
    model = camera.model
    directions = np.zeros((len(model.params), 0))
    if options.refine_cameras:
        directions = FreeParameters.of(model, fixed=options.fix, free=options.free).directions
    warp = any(bool(state.warp.any()) for state in states.values())
    return RigCamera(name, camera, used, states, directions, warp, None)


def _without_dropped(boards: Boards, options: CalibrateRigOptions) -> Boards:
    """Return the boards without the images to drop, and without a board all of whose images these are.

    Raises
    ------
    ValueError
        If no board remains.
    """
    remaining = dict[str, Observations]()
    for board, observations in boards.items():
        known = observations.image_names or observations.names
        dropped = set(options.drop).intersection(known)
        if not dropped or len(dropped) < len(set(known)):
            remaining[board] = drop_images(observations, list(dropped))
    if not remaining:
        raise ValueError("--drop leaves no image of this camera; keep three or more")
    return remaining


def check_different_images(cameras: Sequence[RigCamera]) -> None:
    """Raise ValueError if the images of two cameras have the same corners: they are the same images."""
    for k, own in enumerate(cameras):
        for other in cameras[:k]:
            if all(
                board in other.boards and np.array_equal(views.pixels, other.boards[board].pixels)
                for board, views in own.boards.items()
            ):
                raise ValueError(
                    f"the images of {other.name} and {own.name} are identical: specify the images of each camera"
                )


def check_not_mirrored(cameras: Sequence[RigCamera]) -> None:
    """Check that the markers in most images of each camera are not mirrored: the rig would be mirrored.

    Raises
    ------
    ValueError
        If those of a camera are; the message has its name.
    """
    mirrored = [camera.name for camera in cameras if any(map(_is_mirrored, camera.boards.values()))]
    if mirrored:
        raise ValueError(
            f"the images of {' and '.join(mirrored)} are mirror images: the markers of the board match only when"
            " mirrored, and the poses of the cameras would be mirrored too. Turn off the mirror mode of the camera, or"
            " flip its images left to right"
        )


def _is_mirrored(observations: Observations) -> bool:
    """Return whether the markers are mirrored in most views."""
    detections = observations.detections
    if detections is None or not isinstance(detections.board, Board):
        return False
    mirrored = [is_mirrored(view, detections.board) for image in detections.images for view in image.boards]
    return 2 * sum(mirrored) > len(mirrored)


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
            if other is own or other.size != own.size:
                continue
            lengths = np.concatenate([evaluate_camera(other.camera, views).lengths for views in own.boards.values()])
            rms = float(np.sqrt(np.nanmean(lengths**2)))
            if rms < EXCHANGED_RATIO * own.rms:
                raise ValueError(
                    f"the images of {own.name} fit the camera file of {other.name} better than that of {own.name}"
                    f" ({rms:.2f} and {own.rms:.2f} px): are the folders exchanged?"
                )
