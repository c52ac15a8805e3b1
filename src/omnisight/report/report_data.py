"""What every part of a report is made from."""

import os
import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.central import Calibration
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.quality.central_limit import far_camera
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.quality.pupil_shift import PupilShift
from omnisight.ray_camera import RayCamera
from omnisight.report.html import Markup, element
from omnisight.report.number_format import with_sigma
from omnisight.targets import Detections, ImageDetection

Array = NDArray[np.float64]

# How far (radians) a direction is moved to see which way the image's radius runs there.
STEP = 1e-4
# The least, px, that scales of residuals are made for.
LEAST = 1e-6


@dataclass(frozen=True)
class Figure:
    """One part of a report.

    Attributes
    ----------
    name
        What links call it.
    title
        What it is about.
    body
        The drawing or the table.
    how
        How to read it: what it shows, what is good, what to do.
    short
        The title as a link.
    wide
        Whether the body takes all the width, with `how` above it.
    """

    name: str
    title: str
    body: Markup
    how: tuple[str, str, str]
    short: str
    wide: bool = False


@dataclass(frozen=True)
class Picture:
    """One image of a calibration.

    Attributes
    ----------
    number
        From 1 on, in the order given.
    name
        As the command calls it.
    detection
        The file, and what was found in it.
    views
        Its boards among those of the calibration.
    rows
        Its corners among those of the calibration.
    rms, worst
        Length of its residuals, px; NaN without a board.
    """

    number: int
    name: str
    detection: ImageDetection
    views: range
    rows: slice
    rms: float
    worst: float

    @property
    def corners(self) -> int:
        """How many corners it has."""
        return self.rows.stop - self.rows.start


@dataclass(frozen=True)
class Material:
    """A calibration with all that a report asks of it.

    Attributes
    ----------
    calibration
        The calibration, of a central camera or of one whose rays need not meet in a point.
    search
        The images behind it.
    camera
        Its camera, as it was written.
    names
        One for each image given, as `--drop` knows them.
    command
        The command that made it, word by word.
    apply_exif
        As the images were read.
    asked
        Whether the viewpoint moves, if that was asked.
    """

    calibration: Calibration | RaysCalibration
    search: Detections
    camera: Camera | RayCamera
    names: Sequence[str]
    command: Sequence[str]
    apply_exif: bool = False
    asked: NonCentralityTest | None = None

    @cached_property
    def far(self) -> Camera:
        """The camera as a far scene has it: where a ray goes, and not where it begins."""
        return far_camera(self.camera) if isinstance(self.camera, RayCamera) else self.camera

    @property
    def where_best(self) -> str:
        """What to add to the advice to take more images."""
        return "; omnisight next says where best" if isinstance(self.camera, Camera) else ""

    @property
    def unit(self) -> str:
        """That of the boards."""
        return "squares" if self.search.board is None else self.search.board.unit

    @cached_property
    def travel(self) -> PupilShift | None:
        """How the viewpoint moves from the first to the last angle where corners were seen, if that is what it does."""
        camera = self.camera
        if not isinstance(camera.model, Axial) or camera.covariance is None:
            return None
        return PupilShift.between(camera.model, camera.covariance, (camera.theta_min, self.reach))

    @property
    def drawn_length(self) -> tuple[float, str]:
        """What lengths in the unit of the boards are multiplied by where they are small, and their unit then."""
        return (1e3, "mm") if self.unit == "m" else (1.0, self.unit)

    def length(self, value: float, sigma: float = 0.0) -> str:
        """Write a small length, with its standard deviation if it has one."""
        scale, unit = self.drawn_length
        if not sigma:
            return f"{scale * value:.3g} {unit}"
        return f"{' ± '.join(with_sigma(scale * value, scale * sigma))} {unit}"

    @cached_property
    def pictures(self) -> tuple[Picture, ...]:
        """Every image given."""
        lengths = self.calibration.residual_lengths
        found, view, row = list[Picture](), 0, 0
        given = zip(self.names, self.search.images, strict=True)
        for number, (name, detection) in enumerate(given, 1):
            views = range(view, view + len(detection.boards))
            rows = slice(row, row + sum(map(len, detection.boards)))
            own = lengths[rows]
            rms = float(np.sqrt((own**2).mean())) if len(own) else np.nan
            found.append(Picture(number, name, detection, views, rows, rms, float(own.max()) if len(own) else np.nan))
            view, row = views.stop, rows.stop
        return tuple(found)

    @cached_property
    def residuals(self) -> Array:
        """(N, 2) projected minus seen pixels; NaN outside the model's domain."""
        return self.calibration.state.residuals(self.calibration.views)

    @cached_property
    def theta(self) -> Array:
        """(N,) the angle from the axis of the ray that passes each corner, radians; NaN outside the model's domain."""
        return angle_from_axis(self._bearings)

    @cached_property
    def phi(self) -> Array:
        """(N,) its azimuth, radians: 0 to the right, pi/2 down."""
        return np.arctan2(self._bearings[:, 1], self._bearings[:, 0])

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """(N,) which corners are neither doubtful nor outside the model's domain."""
        return ~self.calibration.outliers & np.isfinite(self.theta)

    @cached_property
    def along_and_across(self) -> tuple[Array, Array]:
        """(N,) residuals along the radius of the image, outwards, and across it, clockwise as seen."""
        outwards = outwards_at(self.far, self.theta, self.phi)
        across = np.stack([-outwards[:, 1], outwards[:, 0]], -1)
        return (self.residuals * outwards).sum(1), (self.residuals * across).sum(1)

    @cached_property
    def reach(self) -> float:
        """The angle from the axis (radians) up to which corners were seen."""
        return self.far.theta_max or float(np.nanmax(self.theta))

    @property
    def sigma(self) -> float:
        """Standard deviation of a coordinate of the usable residuals, px; never quite nought."""
        usable = self.residuals[self.usable]
        return max(float(np.sqrt((usable**2).mean())), LEAST) if len(usable) else 1.0

    def quoted(self, words: Sequence[str]) -> str:
        """Write words as a shell takes them."""
        return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)

    def dropping(self, picture: Picture) -> str:
        """Give the option that leaves an image out."""
        name = picture.name
        return self.quoted([f"--drop={name}"] if name.startswith("-") else ["--drop", name])

    @cached_property
    def _bearings(self) -> Array:
        """(N, 3) the bearings of the pixels where the camera puts the corners."""
        return self.far.model.unproject_numpy(self.residuals + self.calibration.views.pixels)[0]


def outwards_at(camera: Camera, theta: Array, phi: Array) -> Array:
    """Give the unit vectors (N, 2) in the image along which the angle grows, at directions (radians)."""
    near, _ = camera.model.project_numpy(polar(theta - STEP, phi))
    far, _ = camera.model.project_numpy(polar(theta + STEP, phi))
    step = far - near
    return step / np.linalg.norm(step, axis=1, keepdims=True)


def name_of(text: str) -> Markup:
    """Show a name from outside: a direction of writing of its own does not spill over."""
    return element("bdi", text)
