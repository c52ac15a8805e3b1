"""Scaramuzza's camera in the terms of other programs: its stretch on other axes, its inverse polynomial."""

import dataclasses
from typing import cast

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._checks import MAY_DIFFER_PX, build, difference, must_be_few
from omnisight.models.ocam import Ocam

Array = NDArray[np.float64]

A1_MAX = 1e-6  # an angle of less than a thousandth of an arc second
INVERSE_PX = 0.01
HIGHEST_DEGREE = 30
TERMS = 5  # of f(r) from r^0 up, in programs that hold a fixed number


def model_of_xy(direct: list[float], *, cx: float, cy: float, c: float, d: float, e: float) -> Ocam:
    """Make the model of a program whose stretch [c d; e 1] acts on x, y instead of row, column; f(r) with z forward.

    [c d; e 1] = c [1 d/c; e/c 1/c], so the plane is larger by c, and f with it: a_i c^(1 - i).
    """
    must_be_few(len(direct))
    if not 0.1 < c < 10:
        raise ValueError(f"the stretch c must be near 1, got {c:g}")
    scaled = [value * c ** (1 - i) for i, value in enumerate(direct)]
    return model_of(scaled, cx=cx, cy=cy, c=1 / c, d=e / c, e=d / c)


def xy_of_model(model: Ocam) -> tuple[list[float], float, float, float]:
    """Give f(r) with z forward, from r^0 up and a1 among them, and c, d, e of a stretch that acts on x, y."""
    scaled = [float(value) * model.c ** (1 - i) for i, value in enumerate(model.polynomial)]
    return scaled, 1 / model.c, model.e / model.c, model.d / model.c


def of_degree_four(camera: Camera) -> tuple[Camera, tuple[str, ...]]:
    """Give the camera with a polynomial of a0 a2 a3 a4, and a sentence if that changed it.

    Raises
    ------
    ValueError
        If the camera differs too much without its higher terms.
    """
    model = cast(Ocam, camera.model)
    a = [*model.a, *(0.0 for _ in range(TERMS - 1 - len(model.a)))]
    if not any(a[TERMS - 1 :]):
        return dataclasses.replace(camera, model=dataclasses.replace(model, a=tuple(a[: TERMS - 1]))), ()
    bearings, pixels = camera.samples()
    short = dataclasses.replace(model, a=_four_terms(model, _radii(model, pixels)))
    error = difference(short, bearings, pixels)
    said = f"the format has a0, a2, a3, a4 of ocam and this camera {len(model.a)} coefficients"
    if not error <= MAY_DIFFER_PX:
        raise ValueError(f"{said}: {error:.2g} px off with four; convert it to another --model")
    return dataclasses.replace(camera, model=short), (f"{said}: fitted with four, {error:.2g} px off at most",)


def _four_terms(model: Ocam, r: Array) -> tuple[float, ...]:
    """Fit f(r) by a0 a2 a3 a4, so that the pixels (r, px) differ least: dr = r df/(f - r f')."""
    f = Polynomial(model.polynomial)
    weight, scale = r / (f(r) - r * f.deriv()(r)), float(r.max())
    powers = np.array((0, *range(2, TERMS)))
    design = (r[:, None] / scale) ** powers
    found = np.linalg.lstsq(design * weight[:, None], f(r) * weight, rcond=None)[0]
    return tuple(map(float, found / scale**powers))


def _radii(model: Ocam, pixels: Array) -> Array:
    """Give the radii (px, before the stretch) of pixels (N, 2)."""
    return np.hypot(*np.linalg.solve([[1.0, model.e], [model.d, model.c]], (pixels - (model.cx, model.cy)).T))


def inverse_polynomial(
    model: Ocam, radius: float, *, scale: float = 1.0, most: int = HIGHEST_DEGREE + 1
) -> tuple[list[float], float]:
    """Fit the radius (px) as a polynomial in OCamCalib's angle, up to a radius; times `scale`, of another stretch.

    The angle is atan(z/r), from the plane of the image up, with z backwards: -90 degrees on the axis. The degree grows
    until the error is below a hundredth of a pixel, or there are `most` coefficients.

    Returns
    -------
    coefficients
        From the constant up.
    error
        The largest error (px).
    """
    r, theta = radii_and_angles(model, radius)
    return _fitted(theta, r * scale, most)


def incidence_polynomial(model: Ocam, radius: float, *, scale: float = 1.0) -> tuple[list[float], float]:
    """Give what `inverse_polynomial` gives, in the angle from the axis."""
    r, theta = radii_and_angles(model, radius)
    return _fitted(theta + np.pi / 2, r * scale, HIGHEST_DEGREE + 1)


def _fitted(theta: Array, r: Array, most: int) -> tuple[list[float], float]:
    found: list[tuple[float, list[float]]] = []
    for degree in range(3, most):
        inner = Chebyshev.fit(theta, r, degree)
        powers = inner.convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1])
        found.append((float(np.abs(powers(theta) - r).max()), [float(p) for p in powers.coef]))
        if found[-1][0] < INVERSE_PX:
            break
    error, coefficients = min(found, key=lambda fit: fit[0])
    return coefficients, error


def radii_and_angles(model: Ocam, radius: float) -> tuple[Array, Array]:
    r = radius * np.sin(np.linspace(0, np.pi / 2, 500))  # denser towards the rim, where r(theta) is steepest
    return r, np.arctan2(-np.polynomial.polynomial.polyval(r, model.polynomial), r)


def picture_radius(model: Ocam, size: tuple[int, int]) -> float:
    """Give the radius (px, before the stretch) of the image's farthest corner that the model reaches."""
    corners = np.array([[x, y] for x in (-0.5, size[0] - 0.5) for y in (-0.5, size[1] - 0.5)])
    return min(float(_radii(model, corners).max()), model.radius_max())


def model_of(direct: list[float], *, cx: float, cy: float, c: float, d: float, e: float) -> Ocam:
    """Make the model from the coefficients of f(r) with z forward, a1 among them."""
    if not c - d * e > 0:
        raise ValueError(f"the stretch matrix [c d; e 1] must have a positive determinant, got {c:g}, {d:g}, {e:g}")
    if len(direct) > 1 and abs(direct[1]) > A1_MAX:
        raise ValueError(f"a1 must be 0 in OCamCalib's model, got {direct[1]:g}")
    a = [*direct[:1], *direct[2:]]
    names = Ocam.coefficient_names(len(a))
    made = build("ocam", {"cx": cx, "cy": cy, "c": c, "d": d, "e": e, **dict(zip(names, a, strict=True))})
    return cast(Ocam, made)
