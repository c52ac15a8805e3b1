"""Proposal of the next calibration image: the counterpart of `omnisight next`."""

from dataclasses import dataclass, fields, replace
from os import PathLike

from omnisight.camera import Camera
from omnisight.pipeline.calibration.calibrate_options import NextViewOptions
from omnisight.pipeline.detection.detect import Source, load_observations
from omnisight.pipeline.detection.detection_advice import explain_no_detection
from omnisight.pipeline.inputs.central_camera import central_camera
from omnisight.progress import Progress, no_progress
from omnisight.targets import Board, PointTarget
from omnisight.targets.boards import board_class
from omnisight.targets.observations import Observations
from omnisight.view_planning.board_choice import choose_board
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.proposal import Proposal, propose_views


def next_view(
    source: Source,
    camera: Camera | str | PathLike[str],
    options: NextViewOptions = NextViewOptions(),
    *,
    progress: Progress = no_progress,
) -> Proposal:
    """Propose where to hold the board for the next calibration image.

    The camera is refined on the observations. Of about two thousand board placements, the one that minimizes the worst
    projection uncertainty over the visible image is chosen; further images assume that the earlier ones were taken.

    Parameters
    ----------
    source
        The images or corners that the camera was calibrated from; see `load_observations`.
    camera
        The calibrated camera, or a calibration file of any format.
    options
        Options of the command.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If an input cannot be read, no board is detected, the image sizes differ, the camera does not fit the
        observations, or the board to hold is unknown.
    """
    label = "" if isinstance(camera, Camera) else f"{camera}: "
    if not isinstance(camera, Camera):
        camera = central_camera(str(camera), name=options.name, accepts_distance=False)
    default_board = calibration_board(camera, label)
    observations = load_observations(source, _with_default_board(options, default_board), progress=progress)
    if not len(observations) and observations.detections is not None:
        raise ValueError(explain_no_detection(observations.detections))
    camera = with_image_size(camera, observations, label)
    observations, board = choose_board(observations, options.board, default_board)
    progress("propose", 0, 1)
    prior = InformationPrior.estimate(camera, observations)
    proposal = propose_views(prior, board, observations.field, options.count)
    progress("propose", 1, 1)
    return proposal


@dataclass(frozen=True, kw_only=True)
class _DefaultBoardOptions(NextViewOptions):
    """Options with a board to detect if none is specified."""

    default_board: Board | None = None

    @property
    def board(self) -> Board | None:
        return super().board or (self.default_board if self.square is None else None)


def _with_default_board(options: NextViewOptions, board: Board | None) -> NextViewOptions:
    """Return options that detect a board if they specify none."""
    values = {field.name: getattr(options, field.name) for field in fields(options)}
    return _DefaultBoardOptions(**values, default_board=board)


def calibration_board(camera: Camera, label: str = "") -> Board | None:
    """Return the board that a camera was calibrated with, or None if its provenance does not contain one.

    Raises
    ------
    ValueError
        If the provenance contains an invalid board; the message starts with `label`.
    """
    values = camera.provenance.get("target")
    if not isinstance(values, dict) or values.get("target") == PointTarget.kind:
        return None
    try:
        return board_class(str(values.get("target"))[:40]).from_dict(values)
    except ValueError as error:
        raise ValueError(f"{label}provenance, target: {error}; specify --pattern or --target") from None


def with_image_size(camera: Camera, observations: Observations, label: str = "") -> Camera:
    """Return the camera with the size of the images.

    Raises
    ------
    ValueError
        If the camera has another size; the message starts with `label`.
    """
    size = observations.size
    if min(camera.size) < 1:
        camera = replace(camera, size=size)
    if camera.size != size:
        raise ValueError(
            f"{label}the images are {size[0]}x{size[1]}, the camera is {camera.width}x{camera.height}: use the images"
            " that it was calibrated from, or calibrate these"
        )
    return camera
