"""Compiled unit shapes: intersection with rays, normals and texture coordinates of their faces.

Texture coordinates (u, v) are 0 to 1, u to the right and v down as seen from outside. y points down.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

import numpy as np

from omnisight.compiled import njit_helper

RECTANGLE, BOX, ELLIPSOID, CYLINDER, ROOF = range(5)

# Half-spaces n p <= c whose intersection is the shape, in the order of the faces.
PLANES = np.array(
    [
        # box: left, right, top, bottom, near, far
        *((-1, 0, 0, 0), (1, 0, 0, 1), (0, -1, 0, 0), (0, 1, 0, 1), (0, 0, -1, 0), (0, 0, 1, 1)),
        # roof, its ridge along x: near slope, far slope, left and right gable, bottom
        *((0, -1, -2, -1), (0, -1, 2, 1), (-1, 0, 0, 0), (1, 0, 0, 1), (0, 1, 0, 1)),
    ],
    np.float64,
)


@njit_helper
def meet(kind, ox, oy, oz, dx, dy, dz, least):
    """Return the first ray parameter > least at which a ray meets a shape, and the face."""
    if kind == RECTANGLE:
        t = -oz / dz
        x, y = ox + t * dx, oy + t * dy
        return (t, 0) if t > least and 0 <= x <= 1 and 0 <= y <= 1 else (np.inf, 0)
    if kind == BOX:
        return _box(ox, oy, oz, dx, dy, dz, least)
    if kind == ROOF:
        return _convex(6, 5, ox, oy, oz, dx, dy, dz, least)
    if kind == ELLIPSOID:
        a, b, c = dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1
        near, far = _roots(a, b, c)
        return (near if near > least else far if far > least else np.inf), 0
    return _cylinder(ox, oy, oz, dx, dy, dz, least)


@njit_helper
def _roots(a, b, c):
    """Return both solutions of a t^2 + 2 b t + c = 0 in ascending order; inf if there is none."""
    under = b * b - a * c
    if under < 0:
        return np.inf, np.inf
    # The form of each solution without cancellation.
    q = -b - math.sqrt(under) if b > 0 else -b + math.sqrt(under)
    first, second = q / a, c / q
    return min(first, second), max(first, second)


@njit_helper
def _first(enter, enter_face, leave, leave_face, least):
    """Return the first intersection with a convex solid beyond `least`, entering or leaving, and the face."""
    if enter > leave:
        return np.inf, 0
    if enter > least:
        return enter, enter_face
    return (leave, leave_face) if leave > least else (np.inf, 0)


@njit_helper
def _slab(o, d, face):
    """Return where a ray enters and leaves the slab 0 to 1 of one axis, each with the face; faces are low and high."""
    low, high = -o / d, (1 - o) / d
    if d > 0:
        return low, face, high, face + 1
    if d < 0:
        return high, face + 1, low, face
    return (-np.inf, face, np.inf, face) if 0 <= o <= 1 else (np.inf, face, -np.inf, face)


@njit_helper
def _box(ox, oy, oz, dx, dy, dz, least):
    enter, enter_face, leave, leave_face = _slab(ox, dx, 0)
    near, near_face, far, far_face = _slab(oy, dy, 2)
    if near > enter:
        enter, enter_face = near, near_face
    if far < leave:
        leave, leave_face = far, far_face
    near, near_face, far, far_face = _slab(oz, dz, 4)
    if near > enter:
        enter, enter_face = near, near_face
    if far < leave:
        leave, leave_face = far, far_face
    return _first(enter, enter_face, leave, leave_face, least)


@njit_helper
def _convex(first, count, ox, oy, oz, dx, dy, dz, least):
    enter, leave, enter_face, leave_face = -np.inf, np.inf, 0, 0
    for face in range(count):
        nx, ny, nz, c = (
            PLANES[first + face, 0],
            PLANES[first + face, 1],
            PLANES[first + face, 2],
            PLANES[first + face, 3],
        )
        rate, gap = nx * dx + ny * dy + nz * dz, c - (nx * ox + ny * oy + nz * oz)
        if rate < 0:
            t = gap / rate
            if t > enter:
                enter, enter_face = t, face
        elif rate > 0:
            t = gap / rate
            if t < leave:
                leave, leave_face = t, face
        elif gap < 0:
            return np.inf, 0
    return _first(enter, enter_face, leave, leave_face, least)


@njit_helper
def _cylinder(ox, oy, oz, dx, dy, dz, least):
    """Intersect a closed cylinder around y, from 0 to 1; faces are side, top, bottom."""
    enter, leave, enter_face, leave_face = -np.inf, np.inf, 0, 0
    across = dx * dx + dz * dz
    if across > 0:
        enter, leave = _roots(across, ox * dx + oz * dz, ox * ox + oz * oz - 1)
        if enter == np.inf:
            return np.inf, 0
    elif ox * ox + oz * oz > 1:
        return np.inf, 0
    if dy != 0:
        top, bottom = -oy / dy, (1 - oy) / dy
        low, low_face, high, high_face = (top, 1, bottom, 2) if top < bottom else (bottom, 2, top, 1)
        if low > enter:
            enter, enter_face = low, low_face
        if high < leave:
            leave, leave_face = high, high_face
    elif oy < 0 or oy > 1:
        return np.inf, 0
    return _first(enter, enter_face, leave, leave_face, least)


@njit_helper
def normal(kind, face, x, y, z):
    """Return the outward normal, not normalized, at a point of a face."""
    if kind == RECTANGLE:
        return 0.0, 0.0, -1.0
    if kind == BOX:
        return PLANES[face, 0], PLANES[face, 1], PLANES[face, 2]
    if kind == ROOF:
        return PLANES[6 + face, 0], PLANES[6 + face, 1], PLANES[6 + face, 2]
    if kind == ELLIPSOID:
        return x, y, z
    if face == 0:
        return x, 0.0, z
    return 0.0, (-1.0 if face == 1 else 1.0), 0.0


@njit_helper
def chart(kind, face, x, y, z):
    """Return the texture coordinates (u, v) of a point on or near a face."""
    if kind == RECTANGLE:
        return x, y
    if kind == BOX:
        if face < 2:
            return (1 - z if face == 0 else z), y
        if face < 4:
            return x, (1 - z if face == 2 else z)
        return (x if face == 4 else 1 - x), y
    if kind == ROOF:
        if face < 2:
            return (x if face == 0 else 1 - x), y
        if face < 4:
            return (1 - z if face == 2 else z), y
        return x, z
    if kind == ELLIPSOID:
        return math.atan2(x, z) / (2 * math.pi) + 0.5, math.atan2(math.hypot(x, z), -y) / math.pi
    if face == 0:
        return math.atan2(x, z) / (2 * math.pi) + 0.5, y
    return (x + 1) / 2, (z + 1) / 2


@njit_helper
def place(kind, face, u, v):
    """Return the point of a face with texture coordinates (u, v): the inverse of `chart`."""
    if kind == RECTANGLE:
        return u, v, 0.0
    if kind == BOX:
        if face < 2:
            return float(face), v, (1 - u if face == 0 else u)
        if face < 4:
            return u, float(face - 2), (1 - v if face == 2 else v)
        return (u if face == 4 else 1 - u), v, float(face - 4)
    if kind == ROOF:
        if face < 2:
            return (u if face == 0 else 1 - u), v, ((1 - v) / 2 if face == 0 else (1 + v) / 2)
        if face < 4:
            return float(face - 2), v, (1 - u if face == 2 else u)
        return u, 1.0, v
    turn = (u - 0.5) * 2 * math.pi
    if kind == ELLIPSOID:
        ring = math.sin(v * math.pi)
        return ring * math.sin(turn), -math.cos(v * math.pi), ring * math.cos(turn)
    if face == 0:
        return math.sin(turn), v, math.cos(turn)
    return 2 * u - 1, float(face - 1), 2 * v - 1
