"""Prediction error of a camera in every direction that its image shows."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.images import ImageField
from omnisight.quality.uncertainty import MAX_OFF_AXIS_RAD
from omnisight.view_planning.information_prior import InformationPrior

Array = NDArray[np.float64]

# Grid of image positions; the last ring stays inside the border, where visibility is a matter of rounding.
RINGS, SECTORS, LAST_RING = 18, 24, 0.995
# Rings of directions that the best rotation is summed over, and the fewest that determine it.
ROTATION_RINGS, MIN_ROTATION_RINGS = 24, 3
# Relative tolerance of comparisons of angles.
ANGLE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class VisibleDirections(Displayed):
    """Directions across the image with the Jacobians of their pixels.

    As in `quality.uncertainty.Uncertainty`, errors are those left after the best rotation of the camera frame over the
    calibrated field of view. Another image can widen that field, so the rotation is precomputed for several fields.

    Attributes
    ----------
    bearings, pixels
        (N, 3) and (N, 2).
    weight
        (N,) share of the visible image that each direction represents; the sum is 1.
    jacobian, rotation_jacobian
        (N, 2, F) and (N, 2, 3), px: derivatives by the coordinates of the prior and by a rotation of the frame.
    thetas, rotations
        (R,) angles off-axis (radians) of the fields, and (R, 3, F) the best rotation per coordinate of the prior.
    """

    bearings: Array
    pixels: Array
    weight: Array
    jacobian: Array
    rotation_jacobian: Array
    thetas: Array
    rotations: Array

    @classmethod
    def sample(cls, prior: InformationPrior, field: ImageField | None) -> Self:
        """Sample the directions inside the image field, within the domain of the model."""
        shares = LAST_RING * (np.arange(RINGS) + 1) / RINGS
        bearings, weight = sample_image(prior, field, shares, SECTORS)
        # Include the edge of the calibrated field, where a calibration is often worst; the grid may miss it.
        edge = polar(np.full(SECTORS, prior.theta_max), _azimuths(SECTORS))
        bearings, weight = np.concatenate([bearings, edge]), np.append(weight, np.zeros(SECTORS))
        pixels, jacobian, rotation_jacobian = projection_jacobians(prior, bearings)
        kept = is_visible(prior, field, pixels) & _is_finite(jacobian, rotation_jacobian)
        weight = weight[kept] / weight[kept].sum()
        rotations = _best_rotations(prior, visible_theta_max(prior, field))
        return cls(bearings[kept], pixels[kept], weight, jacobian[kept], rotation_jacobian[kept], *rotations)

    @property
    def theta(self) -> Array:
        """(N,) angle off-axis of each direction, radians."""
        return angle_from_axis(self.bearings)

    def errors(self, prior: InformationPrior, theta_max: float) -> Array:
        """Return the rms error (N,), px, of each direction for corners up to `theta_max` off-axis."""
        return np.sqrt((self.displacements(prior, theta_max) ** 2).sum((1, 2)))

    def displacements(self, prior: InformationPrior, theta_max: float) -> Array:
        """Return the displacements (N, 2, F), px, for one standard deviation along each principal coordinate."""
        return self._displacements(prior, self._field_index(theta_max))

    def errors_with_added(self, prior: InformationPrior, added: Array, theta_max: Array) -> Array:
        """Return the errors (K, N), px, after adding each of K images on its own.

        Parameters
        ----------
        prior
            Information of the other images, with covariance L L^T.
        added
            (K, F, F) information of each image.
        theta_max
            (K,) largest angle off-axis (radians) of a corner with that image.
        """
        root = prior.covariance_root
        # In coordinates whitened by the prior, the posterior covariance is (I + L^T A L)^-1.
        posterior = np.linalg.inv(np.eye(len(root)) + root.T @ added @ root)
        posterior = ((posterior + np.swapaxes(posterior, 1, 2)) / 2).reshape(len(added), -1)
        indices = self._field_index(theta_max)
        squares = np.empty((len(added), len(self.weight)))
        for index in np.unique(indices):
            rows = np.flatnonzero(indices == index)
            displacements = self._displacements(prior, int(index))
            # trace(M P M^T) for all directions M and posteriors P is one matrix product.
            gram = (np.swapaxes(displacements, 1, 2) @ displacements).reshape(len(displacements), -1)
            squares[rows] = posterior[rows] @ gram.T
        return np.sqrt(np.maximum(squares, 0.0))

    def errors_at(self, prior: InformationPrior, bearings: Array) -> Array:
        """Return the errors (M,), px, in other directions (M, 3); NaN where the camera has no pixel."""
        _, jacobian, rotation_jacobian = projection_jacobians(prior, bearings)
        aligned = jacobian + rotation_jacobian @ self.rotations[self._field_index(prior.theta_max)]
        return np.sqrt(((aligned @ prior.covariance_root) ** 2).sum((1, 2)))

    def _displacements(self, prior: InformationPrior, index: int) -> Array:
        return (self.jacobian + self.rotation_jacobian @ self.rotations[index]) @ prior.covariance_root

    def _field_index(self, theta_max: Array | float) -> Any:
        """Return the index of the largest precomputed field within `theta_max`."""
        count = np.searchsorted(self.thetas, np.asarray(theta_max) * (1 + ANGLE_TOLERANCE))
        return np.clip(count - 1, 0, len(self.thetas) - 1)


def sample_image(prior: InformationPrior, field: ImageField | None, radii: Array, sectors: int) -> tuple[Array, Array]:
    """Return bearings (N, 3) sampled across the visible image, and the share of the image (N,) of each.

    Rings and sectors are taken in the image, not in angle, because an extrapolating camera may compress or stretch
    angles outside the calibrated field of view.

    Parameters
    ----------
    prior, field
        The camera and its image field.
    radii
        (R,) radii of the rings, as shares of the largest.
    sectors
        Number of samples per ring.
    """
    model = prior.camera.model
    centre = model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
    max_radius = np.linalg.norm(_visible_outline(prior, field) - centre, axis=1).max()
    radius, phi = (part.ravel() for part in np.meshgrid(radii, _azimuths(sectors), indexing="ij"))
    pixels = centre + max_radius * radius[:, None] * np.stack([np.cos(phi), np.sin(phi)], -1)
    bearings, valid = model.unproject_numpy(pixels)
    kept = valid & is_visible(prior, field, pixels)
    return bearings[kept], radius[kept] / radius[kept].sum()


def is_visible(prior: InformationPrior, field: ImageField | None, pixels: Array) -> NDArray[np.bool_]:
    """Return which pixels (N, 2) lie in the image field."""
    return prior.camera.in_image(pixels) if field is None else field.contains(pixels)


def visible_theta_max(prior: InformationPrior, field: ImageField | None) -> float:
    """Return the largest visible angle off-axis (radians) within the domain of the model."""
    model = prior.camera.model
    angles = angle_from_axis(model.unproject_numpy(_visible_outline(prior, field))[0])
    is_inside = np.isfinite(angles)
    # If the model's domain ends before most of the outline, use the whole domain.
    last = float(angles[is_inside].max()) if is_inside.mean() > 0.5 else model.theta_max
    return min(max(last, prior.theta_max), model.theta_max, MAX_OFF_AXIS_RAD)


def projection_jacobians(prior: InformationPrior, bearings: Array) -> tuple[Array, Array, Array]:
    """Return pixels (N, 2) of bearings and their derivatives by the prior's coordinates and by a rotation."""
    pixels, _, d_point, d_params = prior.camera.model.project_with_jacobians(bearings)
    return pixels, d_params @ prior.camera_basis, -d_point @ so3.hat(bearings)


def _visible_outline(prior: InformationPrior, field: ImageField | None) -> Array:
    """Return pixels (N, 2) along the outline of the visible image."""
    border = prior.camera.border()
    if field is None or field.outer is None:
        return border
    outline = field.outer.outline(90)
    return np.concatenate([outline[prior.camera.in_image(outline)], border[field.contains(border)]])


def _azimuths(sectors: int) -> Array:
    return 2 * np.pi * np.arange(sectors) / sectors


def _is_finite(jacobian: Array, rotation_jacobian: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(jacobian).all((1, 2)) & np.isfinite(rotation_jacobian).all((1, 2)))


def _best_rotations(prior: InformationPrior, last: float) -> tuple[Array, Array]:
    """Return angles (R,) and the best rotation (R, 3, F) within each, from normal equations accumulated by ring."""
    bearings = cap(last, ROTATION_RINGS)
    _, jacobian, rotation_jacobian = projection_jacobians(prior, bearings)
    kept = _is_finite(jacobian, rotation_jacobian)[:, None, None]
    jacobian, rotation_jacobian = np.where(kept, jacobian, 0.0), np.where(kept, rotation_jacobian, 0.0)
    squares = np.einsum("nij,nik->njk", rotation_jacobian, rotation_jacobian)
    products = np.einsum("nij,nik->njk", rotation_jacobian, jacobian)
    thetas = last * np.arange(MIN_ROTATION_RINGS, ROTATION_RINGS + 1) / ROTATION_RINGS
    ends = np.searchsorted(angle_from_axis(bearings), thetas)  # `cap` orders its directions by ring
    rotations = -np.linalg.solve(squares.cumsum(0)[ends - 1], products.cumsum(0)[ends - 1])
    return thetas, rotations
