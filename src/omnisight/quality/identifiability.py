"""Identifiability: which parameters of a camera the images do not determine."""

import numpy as np

from omnisight.camera import Camera
from omnisight.display import rounded

# Shift of the image edge, relative to the focal length, that makes a parameter unidentifiable.
MAX_RELATIVE_SHIFT = 0.01
# Angle (radians) over which the paraxial focal length is differentiated numerically.
PARAXIAL_RAD = 1e-4


def focal_relative_sigma(camera: Camera) -> float | None:
    """Return the relative standard deviation of the paraxial focal length; None if it is unknown.

    The paraxial focal length is the derivative of the pixel by the angle on the axis, defined for every model.
    """
    if camera.covariance is None:
        return None
    points = np.array([[PARAXIAL_RAD / 2, 0.0, 1.0], [-PARAXIAL_RAD / 2, 0.0, 1.0]])
    pixels, valid, _, d_params = camera.model.project_with_jacobians(points)
    focal, slope = np.ptp(pixels[:, 0]), d_params[0, 0] - d_params[1, 0]
    if not (valid.all() and focal > 0):
        return None
    sigma = float(np.sqrt(max(slope @ camera.covariance @ slope, 0.0)) / focal)
    return sigma if np.isfinite(sigma) else None


def unidentifiable_parameters(camera: Camera) -> list[str]:
    """Return the names of the parameters that the images do not determine, with their standard deviations.

    A change by one standard deviation, the other parameters constant, moves the edge of the image by more than
    `MAX_RELATIVE_SHIFT` of the focal length.
    """
    if camera.covariance is None:
        return []
    theta = min(camera.image_theta_max(), 0.99 * camera.model.theta_max)
    phi = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    rim = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.full(8, np.cos(theta))], 1)
    pixels, _, _, d_params = camera.model.project_with_jacobians(rim)
    focal = float(np.linalg.norm(pixels - pixels.mean(0), axis=1).mean()) / theta
    sigmas = np.sqrt(np.clip(np.diag(camera.covariance), 0, None))
    moved = np.linalg.norm(d_params, axis=1).max(0) * sigmas
    return [
        f"{parameter.name} (±{rounded(sigma)}{' px' if parameter.unit == 'px' else ''})"
        for parameter, sigma, by in zip(camera.model.parameters, sigmas, moved, strict=True)
        if not by <= MAX_RELATIVE_SHIFT * focal
    ]
