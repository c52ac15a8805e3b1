"""The least-squares problem of a head of two lenses: overlap, motions between frames, and priors."""

import dataclasses
from dataclasses import dataclass
from typing import Any

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
# Both lenses are of one design: standard deviations of the differences of logarithm of focal length, k1 and k2.
SAME_FOCAL, SAME_K1, SAME_K2 = 0.003, 0.003, 0.0006
# Standard deviation of the principal point about the centre of the image circle, as a share of its radius: 0.003 of
# five calibrated fisheyes, 0.008 of a head; and about the centre of the image: 0.018 of the five.
CENTER_SIGMA, IMAGE_CENTER_SIGMA = 0.006, 0.018
# Parameters of a lens: logarithm of the focal length, k1, k2, cx, cy.
LENS_PARAMETERS = 5


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
    """Least squares over both lenses, the rotation, and the motions between frames."""

    start: tuple[Camera, Camera]
    center_sigma: tuple[float, float]
    rotation: Array
    overlap: OverlapMatches
    motions: list[tuple[Array, Array, list[tuple[Array, Array]]]]
    sigma: float
    motion_sigma: float

    @property
    def size(self) -> int:
        return 2 * LENS_PARAMETERS + 3 + 5 * len(self.motions)

    def cameras(self, x: Array) -> tuple[Camera, Camera]:
        return moved_lens(self.start[0], x[:5]), moved_lens(self.start[1], x[5:10])

    def turned(self, x: Array) -> Array:
        return so3.exp(x[10:13]) @ self.rotation

    def residuals(self, x: Array) -> Array:
        """Return all residuals in standard deviations: overlap (2 N,), motions, priors."""
        cameras, rotation = self.cameras(x), self.turned(x)
        a, b = lens_bearings(cameras[0], self.overlap.first), lens_bearings(cameras[1], self.overlap.other)
        parts = [np.where(_both_seen(a, b)[:, None], (a @ rotation.T - b) / self.sigma, np.inf).ravel()]
        for k, (turn, shift, lenses) in enumerate(self.motions):
            step = x[13 + 5 * k : 18 + 5 * k]
            parts.append(self.epipolar(so3.exp(step[:3]) @ turn, shifted(shift, step[3:]), lenses, cameras, rotation))
        robust = np.arctan(np.concatenate(parts) / 3) * 3
        robust[: 3 * len(a)] /= np.sqrt(self.overlap.correlation)
        return np.concatenate([robust, self._priors(x)])

    def distances(self, x: Array) -> Array:
        """Return the angles (N,) between the matches of the overlap after the rotation, infinite outside the domain."""
        cameras, rotation = self.cameras(x), self.turned(x)
        a, b = lens_bearings(cameras[0], self.overlap.first), lens_bearings(cameras[1], self.overlap.other)
        return np.where(_both_seen(a, b), np.linalg.norm(a @ rotation.T - b, axis=1), np.inf)

    def correlations(self) -> Array:
        """Return by how much the error of each residual weighs more than that of an independent one.

        Motions have their full weight in the estimate: with less, the prior pulls the profile from where the epipolar
        constraint holds best. The overlap has the weight of its independent matches already.
        """
        matches = [sum(len(before) for before, _ in lenses) for _, _, lenses in self.motions]
        of_motions = [np.full(n, np.sqrt(max(1.0, n / INDEPENDENT_MATCHES))) for n in matches]
        priors = len(self._priors(np.zeros(self.size)))
        return np.concatenate([np.ones(3 * len(self.overlap)), *of_motions, np.ones(priors)])

    def epipolar(
        self,
        turn: Array,
        shift: Array,
        lenses: list[tuple[Array, Array]],
        cameras: tuple[Camera, Camera],
        rotation: Array,
    ) -> Array:
        """Return the angles between bearings and epipolar planes of the whole sphere."""
        angles: list[Array] = []
        for camera, (before, after), to_first in zip(cameras, lenses, (np.eye(3), rotation), strict=True):
            a, b = lens_bearings(camera, before) @ to_first, lens_bearings(camera, after) @ to_first
            normals = np.cross(shift, a @ turn.T)
            length = np.maximum(np.linalg.norm(normals, axis=1), 0.05)
            angle = (normals * b).sum(1) / length / self.motion_sigma
            angles.append(np.where(_both_seen(a, b), angle, np.inf))
        return np.concatenate(angles)

    def _priors(self, x: Array) -> Array:
        parts: list[float] = []
        for lens, sigma in enumerate(self.center_sigma):
            log_f, k1, k2, cx, cy = x[5 * lens : 5 * lens + 5]
            model: Any = self.start[lens].model
            parts += [(model.k1 + k1 - K1_MEAN) / K1_SIGMA, (model.k2 + k2) / K2_SIGMA, cx / sigma, cy / sigma]
            parts.append(log_f / 1.0)
        first, second = (camera.model for camera in self.cameras(x))
        parts.append(np.log(first.fx / second.fx) / SAME_FOCAL)  # pyright: ignore
        parts.append((first.k1 - second.k1) / SAME_K1)  # pyright: ignore
        parts.append((first.k2 - second.k2) / SAME_K2)  # pyright: ignore
        return np.array(parts)


def moved_lens(camera: Camera, x: Array) -> Camera:
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


def shifted(shift: Array, step: Array) -> Array:
    """Return a direction moved in its tangent plane."""
    basis = np.linalg.svd(shift[None])[2][1:]
    moved = shift + step @ basis
    return moved / np.linalg.norm(moved)
