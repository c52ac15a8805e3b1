"""Which of a camera's parameters the images leave open."""

import numpy as np

from omnisight.camera import Camera

# A parameter counts as open if its standard deviation moves the rim by so much, over the focal length.
OPEN = 0.01
# Distance from the axis (radians) at which the focal length is taken.
PARAXIAL = 1e-4


def focal_relative_sigma(camera: Camera) -> float | None:
    """Give the standard deviation of the focal length on the axis, over it; None if it is not known.

    The focal length is the derivative of the pixel by the angle, there: every model has one, whatever its parameters.
    """
    if camera.covariance is None:
        return None
    points = np.array([[PARAXIAL / 2, 0.0, 1.0], [-PARAXIAL / 2, 0.0, 1.0]])
    pixels, valid, _, d_params = camera.model.project_with_jacobians(points)
    focal, slope = np.ptp(pixels[:, 0]), d_params[0, 0] - d_params[1, 0]
    spread = (
        float(np.sqrt(max(slope @ camera.covariance @ slope, 0.0)) / focal) if valid.all() and focal > 0 else np.nan
    )
    return spread if np.isfinite(spread) else None


def unidentifiable_parameters(camera: Camera) -> list[str]:
    """Name the parameters that the images leave open, each with its standard deviation.

    Those of which a standard deviation, all others standing still, moves the rim of the image by more than a
    hundredth of the focal length.
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
        f"{parameter.name} (+-{sigma:.2g}{' px' if parameter.unit == 'px' else ''})"
        for parameter, sigma, by in zip(camera.model.parameters, sigmas, moved, strict=True)
        if not by <= OPEN * focal
    ]
