"""The result of the calibration of a head."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.sfm.head_problem import ROTATION

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrameAgreement(Displayed):
    """Estimate from the overlap of one frame, against that from all.

    Attributes
    ----------
    matches
        Number of matches in the overlap.
    rotation_deg, rotation_sigma_deg
        Angle between the rotations, and its expected value from both uncertainties.
    rim_deg, rim_sigma_deg
        Difference of the sum of both lenses' angles at the rim, and its standard deviation.
    """

    matches: int
    rotation_deg: float
    rotation_sigma_deg: float
    rim_deg: float
    rim_sigma_deg: float


@dataclass(frozen=True, eq=False)
class HeadCalibration(Displayed):
    """Lenses and rotation of a head; false if they cannot be estimated.

    Attributes
    ----------
    cameras
        Both lenses.
    rotation
        (3, 3) bearings of the first to the second.
    translation
        (3,) vector from the second lens to the first in the frame of the second, in units of the median distance of the
        scene; zero if it was not estimated.
    covariance
        (16, 16) of logarithm of the focal length, k1, k2, cx, cy of both lenses, the rotation vector and the
        translation.
    matches
        Number of matches in the overlap that agree.
    sigma_deg
        Standard deviation of their residuals.
    frames
        Estimates from single frames; empty for one frame.
    reason
        Why the head cannot be calibrated.
    """

    cameras: tuple[Camera, Camera]
    rotation: Array
    translation: Array
    covariance: Array
    matches: int
    sigma_deg: float
    frames: tuple[FrameAgreement, ...] = ()
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason

    @property
    def rotation_sigma_deg(self) -> float:
        """Standard deviation of the rotation about its most uncertain axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariance[ROTATION, ROTATION])[-1])))
