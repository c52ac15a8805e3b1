"""The data of a calibration report. All other files of the report read a calibration only through `ReportData`."""

import os
import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.choices import Options
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.models import CameraModel
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.quality.coverage import Coverage
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.quality.verdict import Verdict
from omnisight.ray_camera import RayCamera
from omnisight.report.number_format import format_with_sigma
from omnisight.targets import Detections
from omnisight.targets.observations import Observations, ObservedImage

Array = NDArray[np.float64]

# Step of numerical derivatives by the direction, radians.
DIRECTION_STEP_RAD = 1e-4
# Lower bound of scales of residuals: keeps ratios finite if synthetic corners are exact.
MIN_SCALE_PX = 1e-6


@dataclass(frozen=True)
class ReportOptions(Options):
    """Options of `write_report`.

    Attributes
    ----------
    command
        Words of the command that made the calibration; the page extends it by `--drop`.
    apply_exif
        Whether the images were rotated by their EXIF orientation.
    """

    command: Sequence[str] = ("omnisight", "calibrate")
    apply_exif: bool = False


@dataclass(frozen=True)
class ReportImage:
    """One image of a calibration.

    Attributes
    ----------
    number
        From 1, in the order given.
    name
        As the command names it.
    path
        The file, or None.
    size
        (width, height), px; None if the file could not be read.
    note
        Why the image was not used, or an empty string.
    views
        Indices of its boards among the views of the calibration.
    rows
        Its corners among those of the calibration.
    rms_px, max_px
        Of the lengths of its residuals; NaN without a board.
    """

    number: int
    name: str
    path: Path | None
    size: tuple[int, int] | None
    note: str
    views: range
    rows: slice
    rms_px: float
    max_px: float

    @property
    def corners(self) -> int:
        """Number of corners."""
        return self.rows.stop - self.rows.start


@dataclass(frozen=True)
class ReportData:
    """A calibration with the derived quantities that the report draws.

    Attributes
    ----------
    calibration
        The calibration.
    options
        Options of the report.
    """

    calibration: Calibration
    options: ReportOptions = ReportOptions()

    # What the report reads of the calibration.

    @property
    def camera(self) -> Camera | RayCamera:
        """The calibrated camera; that of omnisight if another method was requested, as the residuals are."""
        camera = self.calibration.camera
        if self.calibration.ocamcalib is None or not isinstance(camera, Camera):
            return camera
        assert isinstance(self.state.model, CameraModel)
        return replace(camera, model=self.state.model, calibration=self.calibration.figures())

    @property
    def observations(self) -> Observations:
        """The corners that the camera was calibrated on."""
        return self.calibration.observations

    @property
    def state(self) -> State:
        """Camera model, board poses and board warp."""
        return self.calibration.state

    @property
    def outliers(self) -> NDArray[np.bool_]:
        """(N,) corners that were down-weighted as outliers."""
        return self.calibration.outliers

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The fitted models, the selected one first."""
        return self.calibration.candidates

    @property
    def selected(self) -> Candidate:
        """The selected model."""
        return self.calibration.best

    @property
    def selection_reason(self) -> str:
        """Why the model was selected."""
        return self.calibration.selection.reason

    @property
    def best_central(self) -> Candidate | None:
        """The best central model beside a non-central camera; None for a central camera."""
        return self.calibration.central

    @property
    def verdict(self) -> Verdict:
        """Verdict and checks."""
        return self.calibration.verdict

    @property
    def coverage(self) -> Coverage:
        """Corners per cell of the field of view."""
        return self.calibration.quality.coverage

    @property
    def uncertainty(self) -> UncertaintyMap:
        """Projection uncertainty over the field of view."""
        return self.calibration.quality.uncertainty

    @property
    def spline_baseline(self) -> SplineBaseline | None:
        """Comparison with a spline model; None with too few images or for a non-central camera."""
        return self.calibration.quality.spline_baseline

    @property
    def noncentral_test(self) -> NonCentralityTest | None:
        """Result of the non-central test; None with too few images."""
        return self.calibration.quality.noncentrality

    @property
    def detections(self) -> Detections | None:
        """Detection results of all images; None if the calibration is from arrays."""
        return self.observations.detections

    # What follows from it.

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals."""
        return self.selected.rms

    @property
    def is_central(self) -> bool:
        """Whether all rays of the camera meet in one point."""
        return isinstance(self.camera, Camera)

    @cached_property
    def central_limit(self) -> Camera:
        """The camera for points at infinity: the directions of its rays without their origins."""
        return self.camera.central_limit if isinstance(self.camera, RayCamera) else self.camera

    @property
    def unit(self) -> str:
        """Unit of lengths: "m" or "squares"."""
        return self.observations.unit

    @property
    def display_unit(self) -> tuple[float, str]:
        """Factor and unit in which short lengths are displayed."""
        return (1e3, "mm") if self.unit == "m" else (1.0, self.unit)

    def format_length(self, value: float, sigma: float = 0.0) -> str:
        """Format a short length, with its standard deviation if it is not zero."""
        scale, unit = self.display_unit
        if not sigma:
            return f"{scale * value:.3g} {unit}"
        return f"{' ± '.join(format_with_sigma(scale * value, scale * sigma))} {unit}"

    @cached_property
    def pupil_shift(self) -> PupilShift | None:
        """Entrance pupil shift within the calibrated field of view; None unless the camera is axial."""
        camera = self.camera
        if not isinstance(camera.model, Axial) or camera.covariance is None:
            return None
        return PupilShift.between(camera.model, camera.covariance, (camera.theta_min, self.max_theta))

    @cached_property
    def images(self) -> tuple[ReportImage, ...]:
        """All images; without detection results one image per view."""
        return tuple(self._image(number, image) for number, image in enumerate(self.observations.images, 1))

    def _image(self, number: int, image: ObservedImage) -> ReportImage:
        lengths = self.residual_lengths[image.rows]
        rms, largest = (float(np.sqrt((lengths**2).mean())), float(lengths.max())) if len(lengths) else (np.nan, np.nan)
        found = image.detection
        file = (None, self.camera.size, "") if found is None else (found.path, found.size, found.note)
        return ReportImage(number, image.name, *file, image.views, image.rows, rms, largest)

    @cached_property
    def residuals(self) -> Array:
        """(N, 2) projected minus detected pixels; NaN outside the domain of the model."""
        return self.state.residuals(self.observations)

    @cached_property
    def residual_lengths(self) -> Array:
        """(N,) lengths of the residuals, px."""
        return self.state.lengths(self.observations)

    @cached_property
    def theta(self) -> Array:
        """(N,) angle from the axis of the ray of each corner, radians; NaN outside the domain of the model."""
        return angle_from_axis(self._bearings)

    @cached_property
    def phi(self) -> Array:
        """(N,) azimuth of that ray, radians: 0 is right, pi/2 is down."""
        return np.arctan2(self._bearings[:, 1], self._bearings[:, 0])

    @cached_property
    def inliers(self) -> NDArray[np.bool_]:
        """(N,) corners that are neither outliers nor outside the domain of the model."""
        return ~self.outliers & np.isfinite(self.theta)

    @cached_property
    def radial_and_tangential(self) -> tuple[Array, Array]:
        """(N,) radial residuals, positive outwards, and tangential residuals, positive clockwise."""
        outwards = radial_directions(self.central_limit, self.theta, self.phi)
        tangential = np.stack([-outwards[:, 1], outwards[:, 0]], -1)
        return (self.residuals * outwards).sum(1), (self.residuals * tangential).sum(1)

    @cached_property
    def max_theta(self) -> float:
        """Largest angle from the axis of the calibrated field of view, radians."""
        return self.central_limit.theta_max or float(np.nanmax(self.theta))

    @property
    def displayed_theta(self) -> float:
        """Largest angle from the axis that curves are drawn to, radians: the edge of the image."""
        return max(self.max_theta, float(self.coverage.edges[-1]))

    @property
    def sigma_px(self) -> float:
        """Standard deviation per coordinate of the inliers' residuals, at least `MIN_SCALE_PX`."""
        residuals = self.residuals[self.inliers]
        return max(float(np.sqrt((residuals**2).mean())), MIN_SCALE_PX) if len(residuals) else 1.0

    @property
    def next_view_hint(self) -> str:
        """Reference to `omnisight next`, which supports central cameras only."""
        return "; omnisight next proposes the best poses" if self.is_central else ""

    def quote(self, words: Sequence[str]) -> str:
        """Join words to a command line of the operating system's shell."""
        return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)

    def drop_option(self, image: ReportImage) -> str:
        """Return the command-line option that leaves an image out."""
        return self.quote([f"--drop={image.name}"] if image.name.startswith("-") else ["--drop", image.name])

    @cached_property
    def _bearings(self) -> Array:
        """(N, 3) bearings of the projected corners."""
        return self.central_limit.model.unproject_numpy(self.residuals + self.observations.pixels)[0]


def radial_directions(camera: Camera, theta: Array, phi: Array) -> Array:
    """Return the unit vectors (N, 2) in the image along which the angle from the axis grows, at angles in radians."""
    inner, _ = camera.model.project_numpy(polar(theta - DIRECTION_STEP_RAD, phi))
    outer, _ = camera.model.project_numpy(polar(theta + DIRECTION_STEP_RAD, phi))
    step = outer - inner
    return step / np.linalg.norm(step, axis=1, keepdims=True)
