"""The rig in the frame of the ground: from markings on the ground, from its height, or as it is."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.ground_calibration import GroundCalibration, GroundMarks, calibrate_ground
from omnisight.calibration.ground_layout import GroundLayout, detect_layout
from omnisight.extensions import file_error
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.images.gray import to_gray8
from omnisight.pipeline.birdseye.birdseye_options import BirdseyeOptions
from omnisight.pipeline.birdseye.ground_board import rig_on_board
from omnisight.pipeline.detection.detect_options import DetectOptions
from omnisight.rig import Rig
from omnisight.targets.length import parse_length

# Rounds of detection, each predicted by the poses of the last; on cloths of real cars the marks repeat after three.
MAX_ROUNDS = 6
# Smallest height of a camera above the ground: less is a rounding error of a rig frame in a camera.
MIN_HEIGHT_M = 1e-3


class GroundFile(NamedTuple):
    """Markings on the ground.

    Attributes
    ----------
    marks
        Pixels with their positions, by camera name.
    layout
        Checkerboard squares to detect; None if there are none.
    """

    marks: dict[str, GroundMarks]
    layout: GroundLayout | None


def ground_rig(rig: Rig, images: Sequence[NDArray[Any]], options: BirdseyeOptions) -> GroundCalibration:
    """Return the rig in the frame of the ground: y = 0 is the ground, x right, y down, z forward; metres.

    Raises
    ------
    ValueError
        If the ground is not determined, or a camera is not above it.
    """
    if options.ground is not None:
        calibration = calibrate_to_marks(rig, images, read_ground_file(options.ground))
        if not calibration:
            raise ValueError(f"{options.ground}: {calibration.reason}")
        return calibration
    if rig.unit != "m":
        raise ValueError(f"the lengths of the rig are in {rig.unit}: a bird's-eye view needs metres, or --ground marks")
    if options.ground_board is not None:
        board = DetectOptions(
            pattern=options.pattern, square=options.square, target=options.target, apply_exif=options.apply_exif
        )
        return _checked(rig_on_board(rig, options.ground_board, board), options)
    if options.height is not None:
        if rig.provenance.get("frame") == "ground":
            raise ValueError(
                "the frame of the rig is on the ground already (--save-rig): leave out the height (--height)"
            )
        rig = _at_height(rig, parse_length(options.height, "--height"), options.pitch, options.roll)
    return _checked(GroundCalibration(rig, {}, {}), options)


def calibrate_to_marks(rig: Rig, images: Sequence[NDArray[Any]], ground: GroundFile) -> GroundCalibration:
    """Calibrate the poses of a rig to the given marks, and then to the corners of the layout that they predict."""
    calibration = calibrate_ground(rig, ground.marks) if ground.marks else GroundCalibration(rig, {}, {})
    if not calibration or ground.layout is None:
        return calibration
    grays, counts = [to_gray8(image) for image in images], list[int]()
    for _ in range(MAX_ROUNDS):
        marks = detect_layout(ground.layout, grays, calibration.rig)
        calibration = calibrate_ground(calibration.rig, marks)
        if not calibration or [len(seen) for seen in marks.values()] == counts:
            break
        counts = [len(seen) for seen in marks.values()]
    return calibration


def read_ground_file(path: Path) -> GroundFile:
    """Read markings on the ground from JSON.

    `{"marks": {"front": [{"pixel": [u, v], "ground": [right, forward]}, ...], ...}, "layout": {"square": "40cm",
    "squares": ["#.#.", ".#.#"]}}`: positions in metres; marks or layout may be missing. Without marks, the poses of
    the rig predict the corners of the layout.

    Raises
    ------
    ValueError
        If the file cannot be read or does not hold marks.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: {file_error(path, error)}") from error
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: is not JSON ({error})") from error
    if not isinstance(data, dict) or not (data.get("marks") or data.get("layout")):
        raise ValueError(f'{path}: holds neither "marks" nor a "layout" of squares')
    try:
        marks = {str(name): _marks(entries) for name, entries in dict(data.get("marks") or {}).items()}
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(
            f'{path}: marks must be {{"camera": [{{"pixel": [u, v], "ground": [right, forward]}}, ...]}} ({error})'
        ) from error
    if not data.get("layout"):
        return GroundFile(marks, None)
    try:
        layout = GroundLayout(parse_length(data["layout"]["square"]), tuple(map(str, data["layout"]["squares"])))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f'{path}: layout must be {{"square": "40cm", "squares": ["#.#", ".#."]}} ({error})') from error
    return GroundFile(marks, layout)


def _marks(entries: Sequence[Mapping[str, Any]]) -> GroundMarks:
    pixels = np.array([[float(x) for x in entry["pixel"]] for entry in entries]).reshape(-1, 2)
    ground = np.array([[float(x) for x in entry["ground"]] for entry in entries]).reshape(-1, 2)
    if not (np.isfinite(pixels).all() and np.isfinite(ground).all()):
        raise ValueError("not all numbers are finite")
    return GroundMarks(pixels, ground)


def _checked(calibration: GroundCalibration, options: BirdseyeOptions) -> GroundCalibration:
    """Raise `ValueError` if a camera is not above the ground."""
    rig = calibration.rig
    heights = [0.0 - float(pose.inverse().translation[1]) for pose in rig.sensor_from_rig]
    lowest = int(np.argmin(heights))
    if heights[lowest] < MIN_HEIGHT_M:
        remedy = (
            "the height of the rig is unknown: specify the height of its origin (--height 1.2m), markings (--ground) or"
            " a board (--ground-board)"
            if options.height is None and options.ground_board is None
            else "the rig is upside down or too low: its y axis must point down; see --height, --pitch and --roll"
        )
        raise ValueError(f"{rig.names[lowest]} is {heights[lowest] + 0.0:.3g} m above the ground: {remedy}")
    return calibration


def _at_height(rig: Rig, height: float, pitch: float, roll: float) -> Rig:
    """Return the rig with its origin at a height (metres) above the ground; pitch and roll in degrees."""
    # `look` returns the rotation from the ground's axes to those of the rig.
    rig_from_ground = Pose(look(0.0, pitch, roll)) @ Pose(translation=np.array([0.0, height, 0.0]))
    return rig.in_frame(pose @ rig_from_ground for pose in rig.sensor_from_rig)
