"""The result of the calibration of a rig."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.estimation import RigEstimate
from omnisight.display import Displayed
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.rig_calibration.rig_cameras import RigCamera
from omnisight.quality.rig_checks import PairEvidence, RigEvidence, rig_verdict
from omnisight.quality.verdict import Verdict
from omnisight.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigCalibration(Displayed):
    """A calibrated rig, and what it is based on.

    Attributes
    ----------
    rig
        The rig with its covariance, figures and provenance.
    cameras
        The cameras alone, as before the joint refinement; the reference is the first.
    estimate
        Observations, residuals and covariance of the joint refinement; its first camera is the reference.
    held_out
        For each part of the observations the residual length of every inlier when its images are held out, px.
    rule
        What simultaneous images have in common: "name", "number", "order", "time" or "timestamp".
    pairs
        The pairs of cameras that share views.
    model_error
        (C, 6) change of `sensor_from_rig`, in steps, with spline cameras in place of the selected models, in the order
        of `cameras`; None if there is no sign of an error of the models, or splines do not explain it.
    seconds
        Time spent on the cameras alone, on the rig, and in total.
    """

    rig: Rig
    cameras: tuple[RigCamera, ...]
    estimate: RigEstimate
    held_out: list[Array]
    rule: str
    pairs: tuple[PairEvidence, ...]
    model_error: Array | None = None
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def __repr__(self) -> str:
        """Summarize the calibration in one line."""
        return f"RigCalibration({', '.join(self.rig.names)}; rms {self.rms:.3f} px, {self.verdict})"

    @property
    def calibrations(self) -> dict[str, Calibration | None]:
        """The calibration of each camera alone, by name; None for a known camera."""
        return {camera.name: camera.calibration for camera in self.cameras}

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the calibration can be used: "good", "usable" or "do not use"."""
        return rig_verdict(rig_evidence(self))

    @property
    def reasons(self) -> tuple[str, ...]:
        """One sentence per failed check, with what to do; the worst first."""
        return self.verdict.reasons

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the images: other sizes, copies, mirrored markers, and the few that contradict a good rig."""
        of_images = [
            f"{camera.name}: {note}"
            for camera in self.cameras
            for views in camera.boards.values()
            if views.detections is not None
            for note in views.detections.notes
        ]
        return (*of_images, *self.verdict.remarks)

    @cached_property
    def lengths(self) -> list[Array]:
        """For each part of the observations (N,) the residual length of each corner, px."""
        return self.estimate.state.lengths(self.estimate.observations)

    @property
    def rms(self) -> float:
        """Root mean square residual length over all corners of all cameras, px."""
        return root_mean_square(np.concatenate(self.lengths))

    def camera_rms(self, name: str) -> float:
        """Return the root mean square residual length of one camera, px."""
        return root_mean_square(np.concatenate([self.lengths[k] for k in self.parts_of(name)]))

    def camera_held_out_rms(self, name: str) -> float | None:
        """Return the root mean square held-out residual length of the inliers of one camera, px."""
        lengths = np.concatenate([self.held_out[k] for k in self.parts_of(name)])
        lengths = lengths[np.isfinite(lengths)]
        return root_mean_square(lengths) if len(lengths) else None

    def parts_of(self, name: str) -> list[int]:
        """Return the indices of the parts of the observations of one camera."""
        return self.estimate.observations.parts_of(self.estimate.observations.names.index(name))

    def images_of(self, name: str) -> int:
        """Return the number of images in which one camera sees a board."""
        parts = self.estimate.together.parts
        frames = [self.estimate.together.frame[parts[k].group] for k in self.parts_of(name)]
        return len(np.unique(np.concatenate(frames)))

    @property
    def board_sets(self) -> list[list[str]]:
        """Names of the boards of each rigid set, in the order of the boards."""
        names, sets = self.estimate.observations.boards, self.estimate.rigid.sets
        return [[name for name, own in zip(names, sets, strict=True) if own == first] for first in sorted(set(sets))]

    def images_of_board(self, board: int) -> int:
        """Return the number of images of all cameras that show a board."""
        return sum(len(part) for part in self.estimate.together.parts if part.board == board)

    def board_sigmas(self, board: int) -> tuple[float, float]:
        """Return the standard deviations of the pose of a board in its rigid set: angle (radians) and length."""
        columns = self.estimate.problem.free_parameters.columns("board", board, 6)
        variances = np.diagonal(self.estimate.covariance.shared)[columns]
        return float(np.sqrt(variances[:3].sum())), float(np.sqrt(variances[3:].sum()))

    def sigmas(self, name: str) -> tuple[float, float]:
        """Return the standard deviations of the pose of a camera, see `Rig.sigmas`."""
        sigmas = self.rig.sigmas(name)
        assert sigmas is not None
        return sigmas

    def figures(self) -> dict[str, Any]:
        """Return what a rig file stores of the calibration."""
        return {
            "rms": self.rms,
            "cameras": {
                name: {"rms": self.camera_rms(name), "held_out_rms": self.camera_held_out_rms(name)}
                for name in self.rig.names
            },
            "simultaneous": self.rule,
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
        }


def root_mean_square(lengths: Array) -> float:
    """Return the root mean square of lengths (N,)."""
    return float(np.sqrt((lengths**2).mean())) if len(lengths) else float("nan")


def pair_evidence(estimate: RigEstimate) -> tuple[PairEvidence, ...]:
    """Return the images that each pair of cameras shares, and their residuals."""
    observations, lengths = estimate.observations, estimate.state.lengths(estimate.observations)
    names, used, found = observations.names, observations.seen(), list[PairEvidence]()
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            shared, agreeing = estimate.together.common_frames(a, b), observations.common_frames(a, b)
            residuals = [
                length[part.observations.rows(np.flatnonzero((used[a] & used[b])[part.group]))]
                for part, length in zip(observations.parts, lengths, strict=True)
                if part.camera in (a, b)
            ]
            if len(shared):
                rms = root_mean_square(np.concatenate(residuals))
                is_link = (a, b) in estimate.tree
                found.append(PairEvidence(names[a], names[b], len(shared), len(agreeing), rms, is_link))
    return tuple(found)


def rig_evidence(calibration: RigCalibration) -> RigEvidence:
    """Return what the checks of the rig examine."""
    estimate, rig = calibration.estimate, calibration.rig
    contradicting = {name: list[str]() for name in rig.names}
    for part, kept in zip(estimate.observations.parts, estimate.consistent, strict=True):
        images = contradicting[estimate.observations.names[part.camera]]
        images += [name for v in np.flatnonzero(~kept) if (name := part.observations.names[v]) not in images]
    sensor = dict(zip(rig.names, rig.cameras, strict=True))
    scale = {name: camera.px_unit for name, camera in sensor.items()}
    move = estimate.move
    held = [camera for camera in calibration.cameras if camera.is_held]
    return RigEvidence(
        {camera.name: camera.calibration and camera.calibration.verdict for camera in calibration.cameras},
        calibration.pairs,
        contradicting,
        None if move is None else (estimate.name_of(move), move),
        estimate.problem.motion,
        _largest_model_error(calibration),
        {name: _pixels_per_radian(sensor[name]) * calibration.sigmas(name)[0] / scale[name] for name in rig.names},
        {name: calibration.camera_rms(name) for name in rig.names},
        {camera.name: camera.rms for camera in calibration.cameras},
        {camera.name: camera.median_length for camera in held},
        {camera.name: camera.refined_median_length for camera in held},
        scale,
        rig.unit == "m",
        estimate.observations.seconds is not None,
    )


def _largest_model_error(calibration: RigCalibration) -> tuple[str, float, float] | None:
    """Return the camera whose position changes most with spline cameras, the angle (radians) and the distance."""
    if calibration.model_error is None:
        return None
    angles, distances = (np.linalg.norm(part, axis=1) for part in np.hsplit(calibration.model_error, 2))
    k = int(np.argmax(distances))
    return calibration.estimate.observations.names[k], float(angles[k]), float(distances[k])


def _pixels_per_radian(camera: Any) -> float:
    """Return the mean resolution of a camera, px per radian, from its image circle or the calibrated cone."""
    reach = camera.theta_max or np.pi / 2
    return max(camera.size) / 2 / reach
