"""Pose of a camera, or of one in a calibration file, from known points."""

from numpy.typing import ArrayLike

from omnisight.pipeline.inputs.central_camera import AnyCameraSource, load_camera
from omnisight.twoview import absolute_pose
from omnisight.twoview.absolute_pose import AbsolutePose


def resect(
    points: ArrayLike,
    observed: ArrayLike,
    covariance: ArrayLike | None = None,
    sigma_deg: ArrayLike | None = None,
    seed: int = 0,
    *,
    camera: AnyCameraSource | None = None,
) -> AbsolutePose:
    """Estimate the pose of a camera from known points, such as those of an object, and where it sees them.

    LO-RANSAC with a P3P solver finds the inliers; the pose is then the maximum-likelihood estimate under a mixture of
    Gaussian noise and outliers. Points may have any direction, also behind the camera. For a non-central camera, the
    estimate is repeated with the bearings of the points from the camera origin until the pose does not change.

    Parameters
    ----------
    points
        (N, 3) points in the world frame, or in that of the object; for a non-central camera in its unit.
    observed
        (N, 2) their pixels, with `camera`; without, (N, 3) their directions in the camera frame. Pixels outside the
        domain of the camera model are outliers.
    covariance
        Of the pixels (N, 2, 2) or (2, 2), px^2; or of the bearings (N, 3, 3), square radians.
    sigma_deg
        Standard deviation of the bearings, degrees, one or (N,), in place of covariances. Without both, the noise is
        assumed to be isotropic and equal, of pixels or of bearings, and is estimated.
    seed
        Seed of the search: the same input and seed give the same result.
    camera
        The camera of the pixels, or its calibration file.

    Raises
    ------
    ValueError
        If arrays have the wrong shape or do not hold pixels, directions, finite points and covariances, or the
        calibration file cannot be read.
    """
    camera = None if camera is None else load_camera(camera, option=None)
    return absolute_pose.resect(points, observed, covariance, sigma_deg, seed, camera=camera)
