"""Mirrors that are quadrics of revolution: intersection with rays in closed form."""

import numpy as np

from omnisight.optics.mirrors._mirror import Array, Mirror


class Quadric(Mirror):
    """One sheet of A (x^2 + y^2) + B z^2 + 2 C z = 0."""

    def quadric(self) -> tuple[float, float, float, float]:
        """Return A, B, C, and the sign of B z + C on the mirror's sheet."""
        raise NotImplementedError

    def first_intersection(self, origins: Array, bearings: Array) -> Array:
        a, b, c, sign = self.quadric()
        (ox, oy, oz), (dx, dy, dz) = origins.T, bearings.T
        # f(t) = p t^2 + 2 q t + r
        gz = b * oz + c
        p = a * (dx * dx + dy * dy) + b * dz * dz
        q = a * (ox * dx + oy * dy) + gz * dz
        r = a * (ox * ox + oy * oy) + (gz + c) * oz
        # The root form without cancellation.
        q_root = -(q + np.copysign(np.sqrt(q * q - p * r), q))
        near, far = r / q_root, q_root / p
        distance = np.full(len(origins), np.inf)
        for t in (near, far):
            # One Newton step, because the square root loses digits near a tangent.
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            f = a * (x * x + y * y) + (b * z + 2 * c) * z
            df = a * (x * dx + y * dy) + (b * z + c) * dz
            step = 0.5 * f / df
            t = t - np.where(np.abs(step) < 1e-3 * np.abs(t), step, 0.0)
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            hit = (t > 0) & (t < distance) & (sign * (b * z + c) >= 0) & self.is_within_rim(x * x + y * y)
            distance = np.where(hit, t, distance)
        return distance
