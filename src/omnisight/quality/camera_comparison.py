"""Difference of two cameras over their common calibrated field of view, beside the uncertainty of each.

The difference after the best rotation is that of mrcal-show-projection-diff at infinity (Kogan, mrcal, 2020-2024); here
the mean square difference is also tested against what the covariances of both cameras predict.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.model_selection import CLAIM_SIGNIFICANCE
from omnisight.calibration.rotation_alignment import best_rotation
from omnisight.camera import Camera
from omnisight.display import Displayed, rounded
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.quality.difference_test import DifferenceTest, has_uncertainty
from omnisight.quality.uncertainty import Uncertainty

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
ComparisonVerdict = Literal["equal", "same", "different", "unknown"]

# Fewest directions that both cameras see: a rotation and some redundancy.
MIN_COMMON = 12
# Differences below this are those of rounding and of conversions between formats, px.
MAX_EQUAL_PX = 0.01
# Exchanges left and right.
MIRROR = np.diag([-1.0, 1.0, 1.0])
SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


@dataclass(frozen=True, eq=False)
class DifferenceMap(Displayed):
    """Difference of two cameras on a grid of pixels of the first one.

    Attributes
    ----------
    pixels
        (R, C) distance of the pixels of a direction in both cameras, px of the first one.
    angles
        (R, C) angle between the bearings of a pixel in both cameras, radians.
    """

    pixels: Array
    angles: Array

    def rms(self, common: Bools) -> float:
        """Return the root mean square distance (px) over some of the pixels."""
        return float(np.sqrt(np.mean(self.pixels[common] ** 2)))


@dataclass(frozen=True, eq=False)
class CameraComparison(Displayed):
    """The difference of two cameras, and whether their uncertainties explain it.

    Attributes
    ----------
    a, b
        The cameras; b is scaled to the image size of a.
    names
        Their names.
    u, v
        (C,) and (R,) columns and rows of the grid of pixels of a.
    rotation
        (3, 3) best rotation b_from_a between the frames, of a mirrored if `is_mirrored`.
    is_mirrored
        Whether one camera is compared with the other one after left and right are exchanged. A board whose corners can
        be read from the other side does not determine whether a camera looks into a mirror.
    aligned, fixed
        The difference after the best rotation, and with equal frames.
    common
        (R, C) whether the pixel is in the calibrated field of view of both cameras.
    uncertainties
        For a and b, the (R, C) projection uncertainty (px of a, 1 sigma) after the best rotation; None if unknown.
    test
        The test of the difference `aligned` against the uncertainties.
    """

    a: Camera
    b: Camera
    names: tuple[str, str]
    u: Array
    v: Array
    rotation: Array
    is_mirrored: bool
    aligned: DifferenceMap
    fixed: DifferenceMap
    common: Bools
    uncertainties: tuple[Array | None, Array | None]
    test: DifferenceTest

    def __repr__(self) -> str:
        """Return the verdict in one sentence."""
        return f"CameraComparison({', '.join(self.names)}: {self.sentence})"

    @classmethod
    def of(
        cls,
        a: Camera,
        b: Camera,
        names: tuple[str, str] = ("a", "b"),
        *,
        columns: int = 64,
        max_theta: float = np.pi,
    ) -> Self:
        """Compare two cameras of images of one size.

        Parameters
        ----------
        a, b, names
            The cameras and their names.
        columns
            Number of columns of the grid.
        max_theta
            Largest angle from the axis of a to compare, radians.

        Raises
        ------
        ValueError
            If they have hardly any direction in common.
        """
        u = np.linspace(0, a.width - 1, columns)
        v = np.linspace(0, a.height - 1, max(2, round(columns * a.height / a.width)))
        pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
        bearings, valid = a.unproject(pixels)
        calibrated = valid & a.calibrated(bearings)
        seen = calibrated & (angle_from_axis(bearings) <= max_theta)
        if seen.sum() < MIN_COMMON <= calibrated.sum():
            raise ValueError(
                f"--max-theta {np.degrees(max_theta):g}: {seen.sum()} of the pixels of the grid of {names[0]} are"
                f" within this angle of the axis, and {MIN_COMMON} are needed: specify a larger angle, or more"
                " --columns"
            )
        is_mirrored = _are_mirrored(b, bearings[seen], pixels[seen])
        bearings = bearings @ MIRROR if is_mirrored else bearings
        rotation = _common_rotation(b, bearings[seen], pixels[seen], names)
        shape = len(v), len(u)
        aligned, fixed = (_difference(b, bearings @ turn.T, pixels) for turn in (rotation, np.eye(3)))
        common = seen & _sees(b, bearings @ rotation.T) & np.isfinite(aligned).all(0)
        if common.sum() < MIN_COMMON:
            raise ValueError(_nothing_common(names))
        of_a = bearings @ MIRROR if is_mirrored else bearings
        test = DifferenceTest.of(a, b, of_a[common], bearings[common] @ rotation.T)
        scale = _uncertainty(a, of_a, common), _uncertainty(b, bearings @ rotation.T, common)
        return cls(
            a,
            b,
            names,
            u,
            v,
            rotation,
            is_mirrored,
            DifferenceMap(aligned[0].reshape(shape), aligned[1].reshape(shape)),
            DifferenceMap(fixed[0].reshape(shape), fixed[1].reshape(shape)),
            common.reshape(shape),
            (
                None if scale[0] is None else scale[0].reshape(shape),
                None if scale[1] is None else scale[1].reshape(shape),
            ),
            test,
        )

    @property
    def rms(self) -> float:
        """Root mean square difference after the best rotation over the common calibrated field of view, px."""
        return self.aligned.rms(self.common)

    @cached_property
    def worst(self) -> tuple[int, int]:
        """Row and column of the grid where the difference after the best rotation is largest."""
        values = np.where(self.common, self.aligned.pixels, -np.inf)
        row, column = np.unravel_index(np.argmax(values), values.shape)
        return int(row), int(column)

    @property
    def verdict(self) -> ComparisonVerdict:
        """Whether the cameras are equal, the same within their uncertainties, different, or it is unknown."""
        if self.aligned.pixels[self.worst] < MAX_EQUAL_PX:
            return "equal"
        if not np.isfinite(self.test.p_value):
            return "unknown"
        return "same" if self.test.p_value >= CLAIM_SIGNIFICANCE else "different"

    @property
    def sentence(self) -> str:
        """The verdict in one sentence, with its figures."""
        known = [name for name, map in zip(self.names, self.uncertainties, strict=True) if map is not None]
        of = "their uncertainties" if len(known) == 2 else f"the uncertainty of {known[0]}" if known else ""
        test, difference, cameras = self.test, f"{rounded(self.rms)} px rms", "the cameras"
        if self.is_mirrored:
            cameras += ", after left and right are exchanged,"
        if test.expected_rms > 0:
            difference += f", {rounded(test.expected_rms)} px expected"
        probability = f"p = {test.p_value:.2g}" if test.p_value >= 1e-6 else "p < 1e-6"
        match self.verdict:
            case "equal":
                return f"{cameras} are equal to within {MAX_EQUAL_PX:g} px"
            case "same":
                return f"{cameras} are the same within {of}: {difference}, {probability}"
            case "different" if test.is_of_component:
                part = f"{rounded(test.component_rms)} px rms of one component of the uncertainty"
                return (
                    f"{cameras} differ by more than {of}: {part}, {rounded(test.component_expected_rms)} px expected,"
                    f" {probability} (in all {difference})"
                )
            case "different":
                return f"{cameras} differ by more than {of}: {difference}, {probability}"
            case _:
                return f"{cameras} differ by {difference}; their files have no uncertainty to compare it with"

    @property
    def worst_place(self) -> str:
        """Where the largest difference is, in words."""
        row, column = self.worst
        pixel = np.array([self.u[column], self.v[row]])
        theta = np.degrees(self.a.angle_of(pixel))
        offset = pixel - self.a.project([0.0, 0.0, 1.0])[0]
        side = SIDES[round(float(np.arctan2(offset[1], offset[0])) / (np.pi / 4)) % 8]
        return f"{theta:.0f}° off-axis at the {side}, pixel ({pixel[0]:.0f}, {pixel[1]:.0f})"

    @property
    def common_theta_max(self) -> float:
        """Angle from the axis of a (radians) up to which the common calibrated field of view extends."""
        pixels = np.stack(np.meshgrid(self.u, self.v), -1)[self.common]
        return float(np.nanmax(self.a.angle_of(pixels)))


def _sees(camera: Camera, bearings: Array) -> Bools:
    """Return which bearings (N, 3) are in the image and in the calibrated field of view."""
    pixels, valid = camera.project(bearings)
    return valid & camera.in_image(pixels) & camera.calibrated(bearings)


def _are_mirrored(b: Camera, bearings: Array, pixels: Array) -> bool:
    """Return whether the bearings of equal pixels differ by a reflection, and not by a rotation."""
    others, valid = b.unproject(pixels)
    return bool(np.linalg.det(others[valid].T @ bearings[valid]) < 0)


def _common_rotation(b: Camera, bearings: Array, pixels: Array, names: tuple[str, str]) -> Array:
    """Return the best rotation b_from_a for bearings (N, 3) and pixels (N, 2) of a, over what both cameras see."""
    others, valid = b.unproject(pixels)
    if valid.sum() < MIN_COMMON:
        raise ValueError(_nothing_common(names))
    # Equal pixels have nearly equal bearings up to the rotation (Kabsch 1976), whatever its angle.
    rotation = so3.nearest(others[valid].T @ bearings[valid])
    for _ in range(2):  # the common field of view depends on the rotation
        use = _sees(b, bearings @ rotation.T)
        if use.sum() < MIN_COMMON:
            raise ValueError(_nothing_common(names))
        rotation = best_rotation(b.model, bearings[use], pixels[use], rotation)
    return rotation


def _nothing_common(names: tuple[str, str]) -> str:
    return f"{names[0]} and {names[1]} have no calibrated field of view in common: are they of the same camera?"


def _difference(b: Camera, bearings: Array, pixels: Array) -> Array:
    """Return the distance (px) of the pixels of bearings, and the angle (radians) of the bearings of pixels, (2, N)."""
    projected, _ = b.project(bearings)
    others, _ = b.unproject(pixels)
    across = np.linalg.norm(np.cross(bearings, others), axis=1)
    return np.stack([np.linalg.norm(projected - pixels, axis=1), np.arctan2(across, (bearings * others).sum(1))])


def _uncertainty(camera: Camera, bearings: Array, where: Bools) -> Array | None:
    """Return the projection uncertainty (N,) of bearings (N, 3), px, NaN outside `where`; None if it is unknown."""
    if not has_uncertainty(camera):
        return None
    result = np.full(len(bearings), np.nan)
    covariance = Uncertainty.of(camera).projection(bearings[where])
    result[where] = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    return result
