"""The least-squares problem of a head of two lenses: overlap, motions between frames, and priors.

The lenses are apart. In units of the median distance of the scene, which is assumed for all matches, a point in the
direction a of the first lens has the direction R a + t of the second one.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.images.ellipse import Ellipse
from omnisight.images.image_field import ImageField
from omnisight.sfm.head_matches import INDEPENDENT_MATCHES, OverlapMatches

Array = NDArray[np.float64]

# Prior of the profile: between equisolid (k1 = -0.042) and equidistant; standard deviations of k1 and k2.
K1_MEAN, K1_SIGMA, K2_SIGMA = -0.02, 0.03, 0.006
# Prior of the logarithm of the focal length: weak.
FOCAL_SIGMA = 1.0
# Both lenses are of one design: standard deviations of the differences of logarithm of focal length, k1 and k2.
SAME_FOCAL, SAME_K1, SAME_K2 = 0.003, 0.003, 0.0006
# Standard deviation of the principal point about the centre of the image circle, as a share of its radius: 0.003 of
# five calibrated fisheyes, 0.008 of a head; and about the centre of the image: 0.018 of the five.
CENTER_SIGMA, IMAGE_CENTER_SIGMA = 0.006, 0.018
# Standard deviation of each coordinate of the vector between the lenses, in units of the distance of the scene: 3 cm at
# 3 m.
PARALLAX_SIGMA = 0.01
# Parameters of a lens: logarithm of the focal length, k1, k2, cx, cy.
LENS_PARAMETERS = 5
# Parameters that the overlap determines: both lenses, a rotation vector, and the vector between the lenses.
ROTATION = slice(2 * LENS_PARAMETERS, 2 * LENS_PARAMETERS + 3)
TRANSLATION = slice(ROTATION.stop, ROTATION.stop + 3)
OVERLAP_PARAMETERS = TRANSLATION.stop
# Parameters of a motion: a rotation vector, and a step of the direction in its tangent plane.
MOTION_PARAMETERS = 5
# Scale of the Cauchy loss, in standard deviations: its efficiency with normal errors is above 0.95.
CAUCHY_SIGMA = 3.0
# Least sine of the angle between a bearing and the direction of a motion: below, its epipolar plane is uncertain.
MIN_SINE = 0.05


class HeadMotion(NamedTuple):
    """The motion of a head between two frames, in the frame of its first lens.

    Attributes
    ----------
    rotation, direction
        Rotation (3, 3), and unit vector (3,) of the translation.
    distance
        Median distance of the scene, in units of the length of the translation.
    matches
        Pixels (N, 2) before and after, for each lens.
    """

    rotation: Array
    direction: Array
    distance: float
    matches: list[tuple[Array, Array]]


@dataclass(frozen=True)
class LensField:
    """The image field of a lens of a head, with an image circle.

    Attributes
    ----------
    field
        The field.
    is_own
        Whether the circle was detected in the images of this lens. If not, it has the shape of that of the other lens,
        and is in the centre of the image.
    """

    field: ImageField
    is_own: bool = True

    @property
    def circle(self) -> Ellipse:
        """The image circle."""
        if self.field.outer is None:
            raise ValueError("the field has no image circle")
        return self.field.outer

    @property
    def center_sigma(self) -> float:
        """Standard deviation of the principal point about the centre of the circle, px."""
        return (CENTER_SIGMA if self.is_own else IMAGE_CENTER_SIGMA) * self.circle.radius


@dataclass(frozen=True, eq=False)
class HeadProblem:
    """Least squares over both lenses, the rotation, and the motions between frames.

    The parameters x are steps from the start: both lenses, the rotation, the vector between the lenses, each motion.

    Attributes
    ----------
    start
        The lenses at x = 0.
    center_sigma
        Standard deviations of both principal points about the centres of the image circles, px.
    rotation
        Rotation (3, 3) from the first lens to the second at x = 0.
    overlap
        Simultaneous matches between the lenses.
    motions
        Motions between frames.
    sigma, motion_sigma
        Standard deviations of the residuals of the overlap and of the motions, radians.
    """

    start: tuple[Camera, Camera]
    center_sigma: tuple[float, float]
    rotation: Array
    overlap: OverlapMatches
    motions: list[HeadMotion]
    sigma: float
    motion_sigma: float

    @property
    def size(self) -> int:
        """Number of parameters."""
        return OVERLAP_PARAMETERS + MOTION_PARAMETERS * len(self.motions)

    def cameras(self, x: Array) -> tuple[Camera, Camera]:
        """Return the lenses at x."""
        first, second = x[:LENS_PARAMETERS], x[LENS_PARAMETERS : 2 * LENS_PARAMETERS]
        return moved_lens(self.start[0], first), moved_lens(self.start[1], second)

    def rotation_at(self, x: Array) -> Array:
        """Return the rotation (3, 3) from the first lens to the second at x."""
        return so3.exp(x[ROTATION]) @ self.rotation

    def residuals(self, x: Array) -> Array:
        """Return all residuals in standard deviations: overlap (2 N,), motions, priors."""
        parts = [self._differences(x).ravel() / self.sigma, *self.epipolar_residuals(x)]
        robust = np.arctan(np.concatenate(parts) / CAUCHY_SIGMA) * CAUCHY_SIGMA
        robust[: 3 * len(self.overlap)] /= np.sqrt(self.overlap.correlation)
        return np.concatenate([robust, self._priors(x)])

    def distances(self, x: Array) -> Array:
        """Return the angles (N,) between the matches of the overlap after the rotation, infinite outside the domain."""
        return np.linalg.norm(self._differences(x), axis=1)

    def _differences(self, x: Array) -> Array:
        """Return the differences (N, 3) of the bearings of the overlap after the rotation."""
        cameras, rotation = self.cameras(x), self.rotation_at(x)
        a, b = lens_bearings(cameras[0], self.overlap.first), lens_bearings(cameras[1], self.overlap.other)
        seen = a @ rotation.T + x[TRANSLATION]
        seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 0.5)  # bearings outside the domain are 0
        return np.where(_both_seen(a, b)[:, None], seen - b, np.inf)

    def correlations(self) -> Array:
        """Return the factor of the error of each residual over that of an independent one.

        Motions have their full weight in the estimate: with less, the prior pulls the profile from where the epipolar
        constraint holds best. The overlap has the weight of its independent matches already.
        """
        matches = [sum(len(before) for before, _ in motion.matches) for motion in self.motions]
        of_motions = [np.full(n, np.sqrt(max(1.0, n / INDEPENDENT_MATCHES))) for n in matches]
        priors = len(self._priors(np.zeros(self.size)))
        return np.concatenate([np.ones(3 * len(self.overlap)), *of_motions, np.ones(priors)])

    def epipolar_residuals(self, x: Array) -> list[Array]:
        """Return the angles between bearings and epipolar planes of each motion, in standard deviations.

        A lens with centre c in the frame of the first lens moves by t + (R - I) c.
        """
        cameras, rotations = self.cameras(x), (np.eye(3), self.rotation_at(x))
        centres = np.zeros(3), -x[TRANSLATION] @ rotations[1]
        residuals: list[Array] = []
        for motion, step in zip(self.motions, x[OVERLAP_PARAMETERS:].reshape(-1, MOTION_PARAMETERS), strict=True):
            turn, direction = so3.exp(step[:3]) @ motion.rotation, moved_direction(motion.direction, step[3:])
            angles: list[Array] = []
            lenses = zip(cameras, motion.matches, rotations, centres, strict=True)
            for camera, (before, after), rotation, centre in lenses:
                a, b = lens_bearings(camera, before) @ rotation, lens_bearings(camera, after) @ rotation
                moved = direction + motion.distance * (turn @ centre - centre)
                normals = np.cross(moved / np.linalg.norm(moved), a @ turn.T)
                length = np.maximum(np.linalg.norm(normals, axis=1), MIN_SINE)
                angle = (normals * b).sum(1) / length / self.motion_sigma
                angles.append(np.where(_both_seen(a, b), angle, np.inf))
            residuals.append(np.concatenate(angles))
        return residuals

    def _priors(self, x: Array) -> Array:
        """Return the residuals of the priors of both lenses, in standard deviations."""
        parts = [*x[TRANSLATION] / PARALLAX_SIGMA]
        for lens, sigma in enumerate(self.center_sigma):
            log_f, k1, k2, cx, cy = x[LENS_PARAMETERS * lens :][:LENS_PARAMETERS]
            model: Any = self.start[lens].model
            parts += [(model.k1 + k1 - K1_MEAN) / K1_SIGMA, (model.k2 + k2) / K2_SIGMA, cx / sigma, cy / sigma]
            parts.append(log_f / FOCAL_SIGMA)
        first, second = (camera.model for camera in self.cameras(x))
        parts.append(np.log(first.fx / second.fx) / SAME_FOCAL)  # pyright: ignore
        parts.append((first.k1 - second.k1) / SAME_K1)  # pyright: ignore
        parts.append((first.k2 - second.k2) / SAME_K2)  # pyright: ignore
        return np.array(parts)


def moved_lens(camera: Camera, x: Array) -> Camera:
    """Return a lens moved by a step (5,) of its parameters."""
    model: Any = camera.model
    focal = model.fx * float(np.exp(x[0]))
    moved = dataclasses.replace(
        model, fx=focal, fy=focal, k1=model.k1 + x[1], k2=model.k2 + x[2], cx=model.cx + x[3], cy=model.cy + x[4]
    )
    return Camera(moved, camera.size)


def lens_bearings(camera: Camera, pixels: Array) -> Array:
    """Return bearings (N, 3), zero outside the domain of the model."""
    bearings, valid = camera.model.unproject_numpy(pixels)
    return np.where(valid[:, None], bearings, 0.0)


def _both_seen(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return which bearings (N, 3) of both images are in the domain of the model: others are not zero residuals."""
    return np.asarray(a.any(axis=1) & b.any(axis=1))


def moved_direction(direction: Array, step: Array) -> Array:
    """Return a direction (3,) moved by a step (2,) in its tangent plane."""
    basis = np.linalg.svd(direction[None])[2][1:]
    moved = direction + step @ basis
    return moved / np.linalg.norm(moved)
