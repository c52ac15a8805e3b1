"""What a model's formulas are written with: they run on arrays as they stand, and compiled on scalars.

`where`, `span_of`, `atan2` and `sine_cosine` are elementwise, the last two compiled as in `_branchless`. The others are
the hooks of a model: each calls the function of that name of the model that the parameters `m` belong to (`m.model`);
`_kernels` resolves them at compile time.

What is solved by iteration takes a few steps, and up to `effort` more. A result of inf says that they were not enough:
the compiled loop runs all points with `ONCE` (no more steps, so that it vectorises), and the few that are left with
`FULL`.
"""

from typing import Any

import numpy as np

ONCE, FULL = None, 60


def where(condition: Any, a: Any, b: Any) -> Any:
    """Choose `a` where `condition` holds, else `b`."""
    return np.where(condition, a, b)


def settled(step: Any, least: Any) -> Any:
    """Say whether an iteration's steps are all at most `least`; never, where it is compiled and the count is fixed."""
    return np.all(np.abs(step) <= least)


def span_of(place: Any, count: Any) -> Any:
    """Give the index of the span of width 1 that a place lies in, 0 to `count` - 1: the outer two have no end."""
    return np.where(place > 0.0, np.where(place < count - 1.0, place, count - 1.0), 0.0).astype(np.intp)


def atan2(y: Any, x: Any) -> Any:
    """Angle of (x, y) for y >= 0, in [0, pi] (radians)."""
    return np.arctan2(y, x)


def sine_cosine(angle: Any) -> Any:
    """Give (sin, cos) of an angle in [0, pi]."""
    return np.sin(angle), np.cos(angle)


def project_point(m: Any, x: Any, y: Any, z: Any, effort: Any) -> Any:
    """Give (u, v, valid) of a point in the camera frame."""
    return m.model.project_point(m, x, y, z, effort)


def unproject_pixel(m: Any, u: Any, v: Any, effort: Any) -> Any:
    """Give (x, y, z, valid), the unit bearing of a pixel."""
    return m.model.unproject_pixel(m, u, v, effort)


def gain(m: Any, s: Any, c: Any, effort: Any) -> Any:
    """Give r(theta) / sin(theta) from s = sin(theta), c = cos(theta)."""
    return m.model.gain(m, s, c, effort)


def ungain(m: Any, r: Any, r2: Any, effort: Any) -> Any:
    """Give (sin(theta) / r, cos(theta)) from the radius r and its square."""
    return m.model.ungain(m, r, r2, effort)


def distort(m: Any, x: Any, y: Any) -> Any:
    """Bend a point of the normalised plane."""
    return m.model.distort(m, x, y)


def undistort(m: Any, x: Any, y: Any, effort: Any) -> Any:
    """Give (x, y, converged), the inverse of `distort`."""
    return m.model.undistort(m, x, y, effort)


def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
    """Give (dx/dx, dx/dy, dy/dx, dy/dy) of `distort`."""
    return m.model.distort_jacobian(m, x, y)


def first_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
    """Give (p, q) after the steps of `inverse_step` that every point takes, and the squared distance missed before."""
    return m.model.first_steps(m, p, q, x, y)


def inverse_step(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
    """Give a better inverse (p, q) of `distort` at (x, y), and the squared distance missed before."""
    return m.model.inverse_step(m, p, q, x, y)


def angle_step(m: Any, theta: Any, r: Any) -> Any:
    """Give a better angle of the radius r, and the step made."""
    return m.model.angle_step(m, theta, r)


def bracketed_angle(m: Any, theta: Any, low: Any, high: Any, r: Any) -> Any:
    """Give a better angle of the radius r, its bracket, and the step made."""
    return m.model.bracketed_angle(m, theta, low, high, r)


def radius_step(m: Any, r: Any, low: Any, high: Any, s: Any, c: Any) -> Any:
    """Give a better radius of the angle, its bracket, and the step made."""
    return m.model.radius_step(m, r, low, high, s, c)


def height(m: Any, y: Any, q: Any) -> Any:
    """Give the height on an unrolled cylinder of y / q, with q = hypot(x, z)."""
    return m.model.height(m, y, q)


def unheight(m: Any, h: Any) -> Any:
    """Give t = y / hypot(x, z) and its validity from the height."""
    return m.model.unheight(m, h)


HOOKS = {
    hook.__name__: hook
    for hook in (
        *(project_point, unproject_pixel, gain, ungain, height, unheight),
        *(distort, undistort, distort_jacobian, first_steps, inverse_step),
        *(angle_step, bracketed_angle, radius_step),
    )
}
