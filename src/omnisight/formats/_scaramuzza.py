"""Scaramuzza's model in the terms of other programs: a stretch on other axes, an inverse polynomial, few terms."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._export import MAX_REFIT_ERROR_PX, check_supported, dropped_fields, known_size, max_difference_px
from omnisight.formats._values import build, check_term_count
from omnisight.models.ocam import Ocam

Array = NDArray[np.float64]

MAX_A1 = 1e-6  # moves a bearing by less than a thousandth of an arc second
MAX_INVERSE_ERROR_PX = 0.01  # below the noise of any corner detector
MIN_INVERSE_DEGREE, MAX_INVERSE_DEGREE = 3, 30
FIXED_TERMS = 5  # of f(r) from r^0 up, in programs that hold a fixed number
MIN_STRETCH, MAX_STRETCH = 0.1, 10.0


@dataclass(frozen=True)
class OcamExport:
    """A camera in terms of a program whose stretch [c d; e 1] acts on x, y.

    Attributes
    ----------
    camera
        The camera, refitted if the program holds fewer terms.
    size
        (width, height), px.
    direct
        f(r) with z forward, from r^0 up, a1 included.
    plane
        c, d, e, cx and cy.
    inverse
        The radius (px) as a polynomial in an angle, from the constant up.
    notes
        What was changed, one sentence each.
    """

    camera: Camera
    size: tuple[int, int]
    direct: list[float]
    plane: dict[str, float]
    inverse: list[float]
    notes: tuple[str, ...]

    def result(self, text: str, kept: Sequence[str] = ()) -> tuple[str, tuple[str, ...]]:
        """Return the text of a file with all notes; `kept` names the extra values that the file holds."""
        return text, self.notes + dropped_fields(self.camera, kept)


def export_xy(
    camera: Camera, *, fixed_terms: bool = True, incidence: bool = False, max_terms: int = MAX_INVERSE_DEGREE + 1
) -> OcamExport:
    """Return an ocam camera in terms of a program whose stretch acts on x, y.

    Parameters
    ----------
    camera
        The camera.
    fixed_terms
        Whether the program holds a0, a2, a3, a4 only.
    incidence
        Whether the inverse polynomial is in the angle from the axis instead of OCamCalib's angle.
    max_terms
        The largest number of coefficients of the inverse polynomial; 0 if the program has none.
    """
    check_supported(camera, ("ocam",))
    size = known_size(camera)
    camera, notes = refit_degree_four(camera) if fixed_terms else (camera, ())
    model = cast(Ocam, camera.model)
    direct = [float(value) * model.c ** (1 - i) for i, value in enumerate(model.polynomial)]
    plane = {"c": 1 / model.c, "d": model.e / model.c, "e": model.d / model.c, "cx": model.cx, "cy": model.cy}
    model_of_xy(direct, **plane)
    if not max_terms:
        return OcamExport(camera, size, direct, plane, [], notes)
    inverse, inverse_notes = inverse_polynomial(model, size, scale=model.c, incidence=incidence, max_terms=max_terms)
    return OcamExport(camera, size, direct, plane, inverse, notes + inverse_notes)


def model_of_xy(direct: list[float], *, cx: float, cy: float, c: float, d: float, e: float) -> Ocam:
    """Return the model of f(r) with z forward and a stretch [c d; e 1] on x, y instead of row, column.

    [c d; e 1] = c [1 d/c; e/c 1/c], so the plane is larger by c, and f with it: a_i c^(1 - i).
    """
    check_term_count(len(direct))
    if not MIN_STRETCH < c < MAX_STRETCH:
        raise ValueError(f"the stretch c must be near 1, got {c:g}")
    scaled = [value * c ** (1 - i) for i, value in enumerate(direct)]
    return model_of(scaled, cx=cx, cy=cy, c=1 / c, d=e / c, e=d / c)


def model_of(direct: list[float], *, cx: float, cy: float, c: float, d: float, e: float) -> Ocam:
    """Return the model of the coefficients of f(r) with z forward, a1 included."""
    if not c - d * e > 0:
        raise ValueError(f"the stretch matrix [c d; e 1] must have a positive determinant, got {c:g}, {d:g}, {e:g}")
    if len(direct) > 1 and abs(direct[1]) > MAX_A1:
        raise ValueError(f"a1 must be 0 in OCamCalib's model, got {direct[1]:g}")
    a = [*direct[:1], *direct[2:]]
    names = Ocam.coefficient_names(len(a))
    return cast(Ocam, build("ocam", {"cx": cx, "cy": cy, "c": c, "d": d, "e": e, **dict(zip(names, a, strict=True))}))


def refit_degree_four(camera: Camera) -> tuple[Camera, tuple[str, ...]]:
    """Return the camera with a polynomial of a0, a2, a3, a4, and a note if that changed it.

    Raises
    ------
    ValueError
        If the camera differs too much without its higher terms.
    """
    model = cast(Ocam, camera.model)
    a = [*model.a, *(0.0 for _ in range(FIXED_TERMS - 1 - len(model.a)))]
    if not any(a[FIXED_TERMS - 1 :]):
        return dataclasses.replace(camera, model=dataclasses.replace(model, a=tuple(a[: FIXED_TERMS - 1]))), ()
    bearings, pixels = camera.samples()
    short = dataclasses.replace(model, a=_fit_fixed_terms(model, _radii(model, pixels)))
    error = max_difference_px(short, bearings, pixels)
    reason = f"the format has a0, a2, a3, a4 of ocam and this camera {len(model.a)} coefficients"
    if not error <= MAX_REFIT_ERROR_PX:
        raise ValueError(
            f"{reason}: {error:.2g} px off with four. OCamCalib files (--to ocamcalib) have any number of them"
        )
    return dataclasses.replace(camera, model=short), (f"{reason}: refitted with four, at most {error:.2g} px off",)


def _fit_fixed_terms(model: Ocam, r: Array) -> tuple[float, ...]:
    """Fit f(r) by a0, a2, a3, a4 such that the pixels (r, px) differ least: dr = r df/(f - r f')."""
    f = Polynomial(model.polynomial)
    weight, scale = r / (f(r) - r * f.deriv()(r)), float(r.max())
    powers = np.array((0, *range(2, FIXED_TERMS)))
    design = (r[:, None] / scale) ** powers
    solution = np.linalg.lstsq(design * weight[:, None], f(r) * weight, rcond=None)[0]
    return tuple(map(float, solution / scale**powers))


def inverse_polynomial(
    model: Ocam,
    size: tuple[int, int],
    *,
    scale: float = 1.0,
    incidence: bool = False,
    max_terms: int = MAX_INVERSE_DEGREE + 1,
) -> tuple[list[float], tuple[str, ...]]:
    """Fit the radius (px) times `scale` as a polynomial in an angle, over the image.

    OCamCalib's angle is atan(z/r) with z backwards: -90 degrees on the axis. With `incidence` it is the angle from the
    axis. The degree grows until the error is below a hundredth of a pixel.

    Returns
    -------
    coefficients
        From the constant up.
    notes
        A note if the error is larger.
    """
    r, theta = radii_and_angles(model, size)
    r, theta = r * scale, theta + (np.pi / 2 if incidence else 0.0)
    fits: list[tuple[float, list[float]]] = []
    for degree in range(MIN_INVERSE_DEGREE, max_terms):
        powers = Chebyshev.fit(theta, r, degree).convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1])
        fits.append((float(np.abs(powers(theta) - r).max()), [float(p) for p in powers.coef]))
        if fits[-1][0] < MAX_INVERSE_ERROR_PX:
            break
    error, coefficients = min(fits, key=lambda fit: fit[0])
    if error <= MAX_INVERSE_ERROR_PX:
        return coefficients, ()
    note = f"the inverse polynomial is at most {error:.2g} px off; so are programs that project with it"
    return coefficients, (note,)


def radii_and_angles(model: Ocam, size: tuple[int, int]) -> tuple[Array, Array]:
    """Return radii (px, before the stretch) over the image and OCamCalib's angles (radians) there."""
    corners = np.array([[x, y] for x in (-0.5, size[0] - 0.5) for y in (-0.5, size[1] - 0.5)])
    radius = min(float(_radii(model, corners).max()), model.radius_max())
    r = radius * np.sin(np.linspace(0, np.pi / 2, 500))  # denser towards the edge, where r(theta) is steepest
    return r, np.arctan2(-np.polynomial.polynomial.polyval(r, model.polynomial), r)


def _radii(model: Ocam, pixels: Array) -> Array:
    """Return the radii (px, before the stretch) of pixels (N, 2)."""
    return np.hypot(*np.linalg.solve([[1.0, model.e], [model.d, model.c]], (pixels - (model.cx, model.cy)).T))
