"""Whether the images of a map agree with the focal length of their cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.features import Keypoints
from omnisight.sfm.map import Map
from omnisight.sfm.pixel_rays import FreeCameras

Array = NDArray[np.float64]

# Change of the focal length that is significant, in standard deviations, and relative change beyond which a calibration
# is suspicious: those of boards are better by far. Of images in a map that was made with the same focal length, 2 % too
# long, localization estimates a change of 0.2 %.
MIN_CHANGE_SIGMA, MIN_CHANGE = 5.0, 0.01
# Pixels from which the parameters that scale an image are computed, and the largest error of such a scaling.
MAX_SAMPLES, MAX_SCALING_ERROR = 500, 0.05


@dataclass(frozen=True)
class FocalLengthChange(Displayed):
    """Relative difference of the focal length that images agree with best from that of the calibration.

    Attributes
    ----------
    relative, sigma
        Value, and its standard deviation.
    """

    relative: float
    sigma: float

    @property
    def is_significant(self) -> bool:
        """Whether the change is too large for errors of the images."""
        return abs(self.relative) > MIN_CHANGE_SIGMA * self.sigma

    @property
    def is_suspicious(self) -> bool:
        """Whether the change is too large for a calibration: it is probably that of other images."""
        return self.is_significant and abs(self.relative) > MIN_CHANGE

    @property
    def description(self) -> str:
        """The focal length of the images relative to that of the calibration, for messages."""
        direction = "longer" if self.relative > 0 else "shorter"
        return f"a focal length {abs(self.relative):.2%} ± {self.sigma:.2%} {direction} than that of the calibration"


def focal_length_changes(
    found: Map, cameras: Sequence[Camera], keypoints: Sequence[Keypoints]
) -> list[FocalLengthChange | None]:
    """Estimate the change of the focal length of each camera by one Gauss-Newton step of the bundle adjustment.

    None for cameras that cannot be scaled, such as 360 images, or if the images do not determine it.
    """
    bases = [scaling_basis(camera) for camera in cameras]
    columns = [np.zeros((len(c.model.params), 0)) if b is None else b for c, b in zip(cameras, bases, strict=True)]
    free = FreeCameras.of_bases(cameras, columns, [np.ones(basis.shape[1]) for basis in columns])
    if not free.count or not len(found.points):
        return [None] * len(cameras)
    images = found.images.with_free_cameras(free, keypoints)
    bundle = replace(found, images=images, values=np.zeros(free.count)).bundle
    linearized = bundle.linearize(bundle.start)
    matrix, right, _ = linearized.reduced()
    try:
        units = np.eye(len(right), free.count, free.count - len(right))
        solution = linearized.factor(matrix).solve(np.column_stack([-right, units]))
    except LinAlgError:
        return [None] * len(cameras)
    sigmas = np.sqrt(np.diag(solution[-free.count :, 1:]))
    changes = iter(zip(solution[-free.count :, 0].tolist(), sigmas.tolist(), strict=True))
    return [None if basis is None else FocalLengthChange(*next(changes)) for basis in bases]


def scaling_basis(camera: Camera) -> Array | None:
    """Return the change (P, 1) of the parameters that scales the image about its principal point; None without one."""
    model = camera.model
    if getattr(model, "period", None) is not None:
        return None
    _, pixels = camera.samples()
    pixels = pixels[:: max(len(pixels) // MAX_SAMPLES, 1)]
    _, valid, by_pixel, by_params = model.unproject_with_jacobians(pixels)
    center = getattr(model, "cx", (camera.width - 1) / 2), getattr(model, "cy", (camera.height - 1) / 2)
    # Pixels (1 + q) p of a scaled camera have the bearings of p.
    wanted = -np.einsum("nij,nj->ni", by_pixel, pixels - center)[valid].ravel()
    derivatives = by_params[valid].reshape(len(wanted), -1)
    basis = np.linalg.lstsq(derivatives, wanted, rcond=None)[0]
    error = np.linalg.norm(derivatives @ basis - wanted) / max(float(np.linalg.norm(wanted)), 1e-300)
    return basis[:, None] if error < MAX_SCALING_ERROR else None
