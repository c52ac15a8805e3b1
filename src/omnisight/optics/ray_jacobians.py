"""The rays of a camera and their derivatives with respect to the pixel."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.models._arrays import as_rows
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.telecentric import Telecentric

Array = NDArray[np.float64]

# Sixth-order central difference: weights at 1, 2 and 3 steps. Rays vary over hundreds of pixels, so at this step the
# truncation error is below the rounding error of the rays.
WEIGHTS = (3 / 4, -3 / 20, 1 / 60)
STEP_PX = 0.5


class HasRays(Protocol):
    """Any object with rays: a `RayModel`, a `Camera`."""

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (..., 2)."""
        ...


class RayJacobians(NamedTuple):
    """Rays and their derivatives with respect to the pixel.

    Attributes
    ----------
    rays
        Origins and bearings (..., 3).
    d_origins, d_bearings
        (..., 3, 2), d origin/d pixel and d bearing/d pixel; NaN where not valid.
    """

    rays: Rays
    d_origins: Array
    d_bearings: Array


def ray_jacobians(camera: HasRays, pixels: ArrayLike) -> RayJacobians:
    """Return the rays of pixels (..., 2) and their derivatives.

    Derivatives of catadioptric cameras are exact (differential of reflection). Other cameras use finite differences,
    accurate to about 12 digits; they are NaN if a ray within 1.5 px is not valid.
    """
    flat, lead = as_rows(pixels, 2, "pixels")
    rays = camera.rays(flat)
    if isinstance(camera, Catadioptric):
        derivatives = _reflected_derivatives(camera, flat)
    else:
        derivatives = _finite_differences(camera, flat)
    d_origins, d_bearings = (np.where(rays.valid[:, None, None], d, np.nan).reshape(*lead, 3, 2) for d in derivatives)
    shaped = Rays(rays.origins.reshape(*lead, 3), rays.bearings.reshape(*lead, 3), rays.valid.reshape(lead))
    return RayJacobians(shaped, d_origins, d_bearings)


def _finite_differences(camera: HasRays, pixels: Array) -> tuple[Array, Array]:
    """Return d origin/d pixel and d bearing/d pixel (N, 3, 2) by central differences."""
    d_origins, d_bearings = np.zeros((2, len(pixels), 3, 2))
    for axis in range(2):
        for k, weight in enumerate(WEIGHTS, 1):
            step = k * STEP_PX * np.eye(2)[axis]
            after, before = camera.rays(pixels + step), camera.rays(pixels - step)
            d_origins[..., axis] += weight / STEP_PX * (after.origins - before.origins)
            d_bearings[..., axis] += weight / STEP_PX * (after.bearings - before.bearings)
    return d_origins, d_bearings


def _reflected_derivatives(camera: Catadioptric, pixels: Array) -> tuple[Array, Array]:
    """Return d origin/d pixel and d bearing/d pixel (N, 3, 2) after the last mirror."""
    lens = camera.lens
    if isinstance(lens, Telecentric):
        origins, bearings, _ = lens.rays(pixels)
        plane = np.array([[1 / lens.fx, -lens.skew / (lens.fx * lens.fy)], [0.0, 1 / lens.fy], [0.0, 0.0]])
        d_origins, d_bearings = np.broadcast_to(plane, (len(pixels), 3, 2)), np.zeros((len(pixels), 3, 2))
    else:
        bearings, _, d_bearings, _ = lens.unproject_with_jacobians(pixels)
        origins, d_origins = np.zeros_like(bearings), np.zeros_like(d_bearings)
    with np.errstate(all="ignore"):
        for placed in camera.mirrors:
            origins, bearings, d_origins, d_bearings = _reflect(placed, origins, bearings, d_origins, d_bearings)
    return d_origins, d_bearings


def _reflect(
    placed: PlacedMirror, origins: Array, bearings: Array, d_origins: Array, d_bearings: Array
) -> tuple[Array, Array, Array, Array]:
    """Reflect rays (N, 3) and their derivatives (N, 3, 2) at a mirror.

    The mirror has sag s(w), w = x^2 + y^2, and normal direction g = (2 x s', 2 y s', -1). The intersection o + t b
    stays on the surface if

        dt = -g . (do + t db)/(g . b),   dg = 2 (s' dx + x s'' dw, s' dy + y s'' dw, 0).

    The reflected bearing r = b - 2 (b . n) n, n = g/|g|, has dr = db - 2 n (n . db + b . dn) - 2 (b . n) dn.
    """
    turn = placed.lens_from_mirror.rotation
    o, b = (origins - placed.lens_from_mirror.translation) @ turn, bearings @ turn
    do, db = turn.T @ d_origins, turn.T @ d_bearings
    t, _ = placed.mirror.intersect(o, b)
    at = o + t[:, None] * b
    x, y = at[:, :2].T
    _, ds, dds = placed.mirror.profile(x * x + y * y)
    g = np.stack([2 * x * ds, 2 * y * ds, np.full_like(x, -1.0)], -1)
    moved = do + t[:, None, None] * db
    dt = -_dot(g, moved) / (g * b).sum(-1)[:, None]
    d_at = moved + b[:, :, None] * dt[:, None, :]
    dg = np.zeros_like(d_at)
    d_ds = dds[:, None] * 2 * _dot(at[:, :2], d_at[:, :2])
    dg[:, :2] = 2 * (ds[:, None, None] * d_at[:, :2] + at[:, :2, None] * d_ds[:, None, :])
    length = np.sqrt((g * g).sum(-1))
    n = g / length[:, None]
    dn = (dg - n[:, :, None] * _dot(n, dg)[:, None, :]) / length[:, None, None]
    along = (b * n).sum(-1)
    r = b - 2 * along[:, None] * n
    d_along = _dot(n, db) + _dot(b, dn)
    dr = db - 2 * n[:, :, None] * d_along[:, None, :] - 2 * along[:, None, None] * dn
    return placed.lens_from_mirror @ at, r @ turn.T, turn @ d_at, turn @ dr


def _dot(vectors: Array, derivatives: Array) -> Array:
    """Return v . d (N, 2) of vectors (N, 3) and derivatives (N, 3, 2)."""
    return np.einsum("ni,nik->nk", vectors, derivatives)
