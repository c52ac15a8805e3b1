"""The data of the report of a rig: what its sections draw of a `RigCalibration`."""

import os
import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.geometry.pose import Pose
from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration, root_mean_square
from omnisight.report.report_data import ReportOptions
from omnisight.report.rigs.direction_map import visible_directions
from omnisight.rig import Rig
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# One color per camera, distinct on light and dark pages and for all kinds of color vision; repeated for more cameras.
CAMERA_COLORS = ("#2f7de1", "#e07b1a", "#1d9e74", "#c2569b", "#a58a00", "#7a63d6", "#2aa7c9", "#d14b3d")


@dataclass(frozen=True)
class RigView:
    """One board in one image of one camera.

    Attributes
    ----------
    camera, image
        Names of the camera and of the image.
    number
        Number, from 1, of the simultaneous images that it belongs to.
    board
        Index of the board.
    corners, outliers
        Number of corners, and of those that are outliers.
    rms_px
        Root mean square residual length of the inliers, px; of all corners if there are none.
    agrees
        Whether it agrees with the extrinsics.
    rig_from_board
        Pose of the board.
    """

    camera: str
    image: str
    number: int
    board: int
    corners: int
    outliers: int
    rms_px: float
    agrees: bool
    rig_from_board: Pose


@dataclass(frozen=True)
class PartResiduals:
    """Residuals of one part of the observations.

    Attributes
    ----------
    pixels, residuals
        (N, 2) detected corners, and projected minus detected corners, px.
    outliers
        (N,) which corners are outliers, or outside the domain of the camera model.
    """

    pixels: Array
    residuals: Array
    outliers: Bools


@dataclass(frozen=True)
class RigReportData:
    """A calibrated rig with the derived quantities that its report draws.

    Attributes
    ----------
    calibration
        The calibration.
    options
        Options of the report.
    """

    calibration: RigCalibration
    options: ReportOptions = ReportOptions(("omnisight", "calibrate-rig"))

    @property
    def rig(self) -> Rig:
        """The calibrated rig."""
        return self.calibration.rig

    @property
    def reference(self) -> str:
        """Name of the camera whose frame is the rig frame."""
        return self.calibration.estimate.observations.names[0]

    @property
    def display_unit(self) -> tuple[float, str]:
        """Factor and unit in which lengths are displayed."""
        return (1e3, "mm") if self.rig.unit == "m" else (1.0, self.rig.unit)

    def color(self, camera: str) -> str:
        """Return the color of a camera."""
        return CAMERA_COLORS[self.rig.index(camera) % len(CAMERA_COLORS)]

    def centre(self, camera: str) -> Array:
        """Return the position (3,) of a camera in the rig frame."""
        return self.rig.sensor_from_rig[self.rig.index(camera)].inverse().translation

    def centre_covariance(self, camera: str) -> Array:
        """Return the covariance (3, 3) of the position of a camera in the rig frame."""
        k = self.rig.index(camera)
        pose, covariance = self.rig.sensor_from_rig[k], self.rig.covariance
        assert covariance is not None
        return pose.position_covariance(covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6])

    def rotation_sigmas(self, camera: str) -> Array:
        """Return the standard deviations (3,) of the rotation of a camera about its x, y and z axis, radians."""
        k, covariance = self.rig.index(camera), self.rig.covariance
        assert covariance is not None
        return np.sqrt(np.diagonal(covariance)[6 * k : 6 * k + 3])

    @cached_property
    def parts(self) -> tuple[PartResiduals, ...]:
        """Residuals of each part of the observations."""
        estimate = self.calibration.estimate
        problem = RigBundle.at(estimate.state, estimate.observations, estimate.problem.free_parameters)
        found = list[PartResiduals]()
        states = estimate.state.part_states(estimate.observations)
        for part, weights, state in zip(estimate.observations.parts, problem.weights, states, strict=True):
            residuals = state.residuals(part.observations)
            outliers = weights.outliers(state, part.observations) | ~np.isfinite(residuals).all(1)
            found.append(PartResiduals(part.observations.pixels, residuals, outliers))
        return tuple(found)

    def inliers_of(self, camera: str) -> tuple[Array, Array]:
        """Return pixels and residuals (N, 2) of the inliers of a camera."""
        parts = [self.parts[k] for k in self.calibration.parts_of(camera)]
        pixels = np.concatenate([part.pixels[~part.outliers] for part in parts])
        return pixels, np.concatenate([part.residuals[~part.outliers] for part in parts])

    def inlier_rms(self, camera: str) -> float:
        """Return the root mean square residual length of the inliers of a camera, px."""
        return root_mean_square(np.linalg.norm(self.inliers_of(camera)[1], axis=1))

    @cached_property
    def views(self) -> tuple[RigView, ...]:
        """All views of all cameras."""
        estimate = self.calibration.estimate
        frame = estimate.together.frame
        used = np.unique(frame[estimate.together.seen().any(0)])
        number = {int(index): n for n, index in enumerate(used, 1)}
        views = list[RigView]()
        for part, original, found, kept in zip(
            estimate.observations.parts, estimate.together.parts, self.parts, estimate.consistent, strict=True
        ):
            poses = estimate.state.rig_from_board(part)
            lengths = np.linalg.norm(found.residuals, axis=1)
            for k, rows in enumerate(part.observations.groups):
                inliers = lengths[rows][~found.outliers[rows]]
                views.append(
                    RigView(
                        estimate.observations.names[part.camera],
                        part.observations.names[k],
                        number[int(frame[original.group[k]])],
                        part.board,
                        rows.stop - rows.start,
                        int(found.outliers[rows].sum()),
                        root_mean_square(inliers if len(inliers) else lengths[rows]),
                        bool(kept[k]),
                        poses.one(k),
                    )
                )
        return tuple(views)

    def observations_of_board(self, board: int) -> Observations:
        """Return observations of a board, for its outline."""
        return next(p.observations for p in self.calibration.estimate.observations.parts if p.board == board)

    def boards_of(self, camera: str) -> set[int]:
        """Return the indices of the boards that a camera sees."""
        parts = self.calibration.estimate.observations.parts
        return {parts[k].board for k in self.calibration.parts_of(camera)}

    @cached_property
    def visible_directions(self) -> Bools:
        """Which cameras see each direction of the rig frame, see `visible_directions`."""
        return visible_directions(self.rig)

    @property
    def frames(self) -> int:
        """Number of moments at which any camera saw a board."""
        return max(view.number for view in self.views)

    @property
    def common_frames(self) -> tuple[int, int]:
        """Number of moments at which several cameras saw a board, and of those whose views all agree."""
        by_number: dict[int, list[RigView]] = {}
        for view in self.views:
            by_number.setdefault(view.number, []).append(view)
        common = [views for views in by_number.values() if len({view.camera for view in views}) > 1]
        return len(common), sum(all(view.agrees for view in views) for views in common)

    def quote(self, words: Sequence[str]) -> str:
        """Join words to a command line of the operating system's shell."""
        return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)
