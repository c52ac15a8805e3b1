"""Checks of a calibrated rig, and its verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.model_selection import MAX_RMS_RATIO
from omnisight.calibration.rigs.board_motion import BoardMotion
from omnisight.calibration.rigs.consistency import Move
from omnisight.display import Displayed, rounded
from omnisight.quality.checks.held_out_error import NEGLIGIBLE_PX
from omnisight.quality.evidence import Check, Level
from omnisight.quality.verdict import Verdict

Array = NDArray[np.float64]

# Simultaneous views that connect two cameras: one board pose has four weakly determined directions and cannot be
# checked; with six, one wrong one is recognized.
MIN_SHARED_VIEWS, MIN_GOOD_SHARED_VIEWS = 3, 6
# Share of the simultaneous views that contradict the extrinsics, of a good and of a usable rig.
MAX_CONTRADICTING_SHARE = (0.1, 0.34)
# Projection error (px) due to the rotation of a camera relative to the others, of a good and of a usable rig: those
# of the held-out error of one camera.
MAX_ROTATION_SIGMA_PX = (0.7, 2.0)
# Names that a sentence lists.
MAX_NAMES = 5


@dataclass(frozen=True)
class PairEvidence(Displayed):
    """The views that two cameras share.

    Attributes
    ----------
    a, b
        Names of the cameras.
    shared, agreeing
        Simultaneous views of a board, and those that agree with the extrinsics.
    rms
        Root mean square residual length over the agreeing views in both cameras, px; NaN without any.
    is_link
        Whether the pair connects parts of the rig that nothing else connects as well.
    """

    a: str
    b: str
    shared: int
    agreeing: int
    rms: float
    is_link: bool


@dataclass(frozen=True)
class RigEvidence:
    """Everything that a check of a rig may examine.

    Attributes
    ----------
    verdicts
        Verdict of each camera alone; None for one that was not calibrated.
    pairs
        The pairs of cameras that share views.
    contradicting
        Names of the images that contradict the extrinsics, by camera.
    move
        A camera or board that moved between two images, and its name.
    motion
        Standard deviations of the motion of the board between the exposures; None if it was at rest.
    model_error
        If the camera models are not exact, the camera whose pose changes most with splines in their place, the angle
        (radians) and the distance. They then explain the motion, too.
    rotation_sigma_px
        For each camera the projection error due to the uncertainty of its rotation, px at an image width of 1000.
    rms, alone_rms
        Root mean square residual of each camera in the rig, and calibrated alone.
    held_median, refined_median
        Median residual length, px, of each camera that was held, and of the same camera refined alone on its images.
    px_scale
        For each camera the size of a pixel at an image width of 1000.
    is_metric
        Whether the size of the board is known.
    has_times
        Whether the times of the images are known.
    """

    verdicts: Mapping[str, Verdict | None]
    pairs: Sequence[PairEvidence]
    contradicting: Mapping[str, Sequence[str]]
    move: tuple[str, Move] | None
    motion: BoardMotion | None
    model_error: tuple[str, float, float] | None
    rotation_sigma_px: Mapping[str, float]
    rms: Mapping[str, float]
    alone_rms: Mapping[str, float]
    held_median: Mapping[str, float]
    refined_median: Mapping[str, float]
    px_scale: Mapping[str, float]
    is_metric: bool
    has_times: bool


def rig_verdict(evidence: RigEvidence) -> Verdict:
    """Run all checks of a rig."""
    checks = [
        *_cameras(evidence),
        *_held_cameras(evidence),
        _connection(evidence),
        _moved(evidence),
        _contradictions(evidence),
        _board_motion(evidence),
        _rotation(evidence),
        _rigidity(evidence),
        _scale(evidence),
    ]
    return Verdict(max(check.level for check in checks), tuple(checks))


def _cameras(evidence: RigEvidence) -> list[Check]:
    """Return the failed checks of each camera alone."""
    return [
        Check(f"{name}: {check.name}", check.level, f"{name}: {check.sentence}")
        for name, verdict in evidence.verdicts.items()
        if verdict is not None
        for check in verdict.checks
        if check.level > Level.GOOD
    ]


def _held_cameras(evidence: RigEvidence) -> list[Check]:
    """Return the held cameras that do not fit their images: those of another camera make the poses wrong."""
    checks: list[Check] = []
    for name, held in evidence.held_median.items():
        refined, least = evidence.refined_median[name], NEGLIGIBLE_PX * evidence.px_scale[name]
        if held > least and held > MAX_RMS_RATIO * refined:
            sentence = (
                f"The given camera of {name} does not fit its images: residuals of {held:.2f} px (median),"
                f" {refined:.2f} px with the camera refined. Is it the file of another camera or of another focus?"
                f" Leave out --camera {name}, or refine it (--refine-cameras)."
            )
            checks.append(Check(f"{name}: given camera", Level.DO_NOT_USE, sentence))
    return checks


def _connection(evidence: RigEvidence) -> Check:
    """Check the weakest of the pairs that connect the cameras."""
    links = [pair for pair in evidence.pairs if pair.is_link]
    if not links:
        return Check("connection")
    weakest = min(links, key=lambda pair: pair.agreeing)
    if weakest.agreeing >= MIN_GOOD_SHARED_VIEWS:
        return Check("connection")
    level = Level.DO_NOT_USE if weakest.agreeing < MIN_SHARED_VIEWS else Level.USABLE
    count = "1 image connects" if weakest.agreeing == 1 else f"{weakest.agreeing} images connect"
    return Check(
        "connection",
        level,
        f"Only {count} {weakest.a} and {weakest.b}: take about 10 more with the board where both cameras see"
        " it, at different angles.",
    )


def _moved(evidence: RigEvidence) -> Check:
    """Check that no camera or board moved relative to the others."""
    if evidence.move is None:
        return Check("camera moved")
    name, move = evidence.move
    unit = "mm" if evidence.is_metric else "squares"
    distance = f"{rounded(move.distance * (1e3 if evidence.is_metric else 1), 3)} {unit}"
    if move.kind == "board":
        return Check(
            "board moved",
            Level.DO_NOT_USE,
            f"The board {name} moved by {distance} and {rounded(np.degrees(move.angle))}° relative to the other boards"
            f" between {move.before} and {move.after}: fix the boards firmly, and calibrate with the images before or"
            " after the change only.",
        )
    others = [other for other in evidence.verdicts if other != name]
    relative = f" (or {others[0]})" if len(others) == 1 else ""
    return Check(
        "camera moved",
        Level.DO_NOT_USE,
        f"{name}{relative} moved by {distance} and {rounded(np.degrees(move.angle))}° between {move.before} and"
        f" {move.after}: fix the cameras firmly, and calibrate with the images before or after the change only.",
    )


def _contradictions(evidence: RigEvidence) -> Check:
    """Check the share of views that contradict the extrinsics."""
    names = [f"{camera}/{image}" for camera, images in evidence.contradicting.items() for image in images]
    shared = sum(pair.shared for pair in evidence.pairs)
    if not names or evidence.move is not None:  # the move explains them
        return Check("simultaneous images")
    share = 1 - sum(pair.agreeing for pair in evidence.pairs) / max(shared, 1)
    level = Level(sum(int(share > limit) for limit in MAX_CONTRADICTING_SHARE))
    some = ", ".join(names[:MAX_NAMES]) + (f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else "")
    return Check(
        "simultaneous images",
        level,
        f"{some} contradict{'s' * (len(names) == 1)} the extrinsics and {'was' if len(names) == 1 else 'were'} not used"
        " for them: the board or a camera moved between the exposures, or the images are not of the same moment."
        " Hold the board still, or drop them (--drop).",
    )


def _board_motion(evidence: RigEvidence) -> Check:
    """Check that the board was at rest, and that the camera models are not the cause if it seems to have moved."""
    motion = evidence.motion
    if motion is None:
        return Check("board motion")
    unit, scale = ("mm", 1e3) if evidence.is_metric else ("squares", 1.0)
    if evidence.model_error is not None:
        name, angle, distance = evidence.model_error
        return Check(
            "camera models",
            Level.USABLE,
            f"The camera models are not exact near the image circle: with spline cameras the pose of {name} changes by"
            f" {rounded(scale * distance)} {unit} and {rounded(np.degrees(angle))}°, and the poses of the board agree"
            " between the cameras. The stated uncertainty includes this change: use another --model, such as spline.",
        )
    times = "" if evidence.has_times else " specify --times,"
    return Check(
        "board motion",
        Level.USABLE,
        f"The board moved by about {rounded(scale * motion.translation)} {unit} and"
        f" {rounded(np.degrees(motion.rotation))}° between the exposures of the cameras, or their models are not exact."
        " This limits the accuracy of the extrinsics, and their stated uncertainty includes it: put the board on a"
        f" stand, synchronize the cameras,{times} or select another --model.",
    )


def _rotation(evidence: RigEvidence) -> Check:
    """Check the uncertainty of the rotation of each camera."""
    name = max(evidence.rotation_sigma_px, key=lambda camera: evidence.rotation_sigma_px[camera])
    worst = evidence.rotation_sigma_px[name]
    level = Level(sum(int(not worst <= limit) for limit in MAX_ROTATION_SIGMA_PX))
    if not level:
        return Check("extrinsic uncertainty")
    action = f"take more images with the board where {name} and another camera see it"
    if evidence.model_error is not None:
        action = "select a --model that fits the lenses"
    return Check(
        "extrinsic uncertainty",
        level,
        f"The rotation of {name} is uncertain by {rounded(worst)} px (1σ, at an image width of 1000 px): {action}.",
    )


def _rigidity(evidence: RigEvidence) -> Check:
    """Check that the rig fits as well as each camera alone."""
    ratios = {
        name: evidence.rms[name] / alone
        for name, alone in evidence.alone_rms.items()
        if evidence.rms[name] > NEGLIGIBLE_PX * evidence.px_scale[name] and alone > 0
    }
    name = max(ratios, key=lambda camera: ratios[camera], default="")
    if not name or ratios[name] <= MAX_RMS_RATIO:
        return Check("rigidity")
    return Check(
        "rigidity",
        Level.USABLE,
        f"The residuals of {name} in the rig are {ratios[name]:.1f} times those of the camera alone"
        f" ({evidence.rms[name]:.2f} and {evidence.alone_rms[name]:.2f} px): the cameras are not rigidly connected, or"
        " the board moved between their exposures. Hold the board still, or synchronize the cameras.",
    )


def _scale(evidence: RigEvidence) -> Check:
    """Check that the size of the board is known."""
    if evidence.is_metric:
        return Check("scale")
    sentence = "Distances between the cameras are in squares of the board: specify their size, such as --square 30mm."
    return Check("scale", Level.USABLE, sentence)
