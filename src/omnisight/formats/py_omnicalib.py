"""py-omnicalib's calibration.yml: the radius as a polynomial of the angle from the axis.

rho(theta) = k1 theta + k2 theta^2 + ... (px, theta in radians) are the numbers of `poly_incident_angle_to_radius` from
theta^0 up, which the program calibrates. `poly_radius_to_z` is z(rho) of the bearing (x, y, z), from rho^0 up, which it
fits to them afterwards; it is not read. `principal_point` is x, y. `extrinsics` are the poses camera_from_board of the
images, which the file does not name. The format has no image size: `image_size` is our addition, which py-omnicalib
ignores. Source: omnicalib/main.py and projection.py of tasptz/py-omnicalib.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, unknown_fields, with_mean_focal
from omnisight.formats._readers import Reader
from omnisight.formats._values import build, image_size, numbers
from omnisight.formats._yaml import flow, read_map

TITLE = "py-omnicalib yml"
SUFFIX = ".yml"
MODELS = ("radial_polynomial",)
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; coefficients in px, from theta^0 up"
RADIUS, DEPTH = "poly_incident_angle_to_radius", "poly_radius_to_z"
KNOWN = {RADIUS, DEPTH, "principal_point", "image_size"}
MAX_DEGREE = 4  # of the radius in the angle, py-omnicalib's default; the camera model has no more
DEPTH_DEGREES = range(4, 13)
MAX_DEPTH_ERROR_PX = 0.01  # below the noise of any corner detector
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether a line begins with `poly_incident_angle_to_radius:`."""
    return has_lines(text, RADIUS)


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    coefficients = numbers(data.get(RADIUS), RADIUS)
    if not 2 <= len(coefficients) <= MAX_DEGREE + 1:
        raise ValueError(
            f"{RADIUS} must hold 2 to {MAX_DEGREE + 1} coefficients, got {len(coefficients)}; calibrate with degree"
            f" {MAX_DEGREE}"
        )
    if coefficients[0]:
        raise ValueError(f"{RADIUS}[0], the radius on the axis, must be 0, got {coefficients[0]:g}")
    cx, cy = numbers(data.get("principal_point"), "principal_point", 2)
    focal, *higher = coefficients[1:]
    higher += [0.0] * (MAX_DEGREE - 1 - len(higher))
    k = {f"k{i}": value / focal if focal else 0.0 for i, value in enumerate(higher, 2)}
    model = build("radial_polynomial", {"fx": focal, "fy": focal, "cx": cx, "cy": cy, **k})
    size = image_size(*numbers(data["image_size"], "image_size", 2)) if "image_size" in data else (0, 0)
    return {"camera": Camera(model, size, extra=unknown_fields(data, KNOWN))}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with a new polynomial of z."""
    exported = export(camera, MODELS)
    camera, notes = with_mean_focal(exported.camera)
    values = camera.model.to_dict()
    coefficients = [values["fx"] * values.get(f"k{i}", 1.0) for i in range(1, MAX_DEGREE + 1)]
    depth, error = _depth_polynomial(coefficients, camera)
    if error > MAX_DEPTH_ERROR_PX:
        notes += (f"{DEPTH} is at most {error:.2g} px off; so are programs that unproject with it",)
    fields: dict[str, Any] = {
        "extrinsics": camera.extra.get("extrinsics", []),
        RADIUS: [0.0, *coefficients],
        DEPTH: depth,
        "principal_point": [values["cx"], values["cy"]],
        "image_size": list(exported.size),
    }
    text, changes = exported.result("".join(f"{key}: {flow(value)}\n" for key, value in fields.items()), fields)
    return text, notes + changes


def _depth_polynomial(coefficients: list[float], camera: Camera) -> tuple[list[float], float]:
    """Fit z(rho) over the image, of the lowest degree that is exact enough, and return its largest error (px).

    z is that of the bearing (x, y, z) with x^2 + y^2 = rho^2. An error dz turns the bearing by sin(theta)^2 dz / rho.
    """
    bearings, _ = camera.samples()
    theta = np.linspace(0, float(np.arccos(bearings[:, 2].min())), 500)[1:-1]
    radius = np.polynomial.polynomial.polyval(theta, [0.0, *coefficients])
    slope = np.polynomial.polynomial.polyval(theta, [i * value for i, value in enumerate(coefficients, 1)])
    z, weight = radius / np.tan(theta), slope * np.sin(theta) ** 2 / radius
    fits: list[tuple[float, NDArray[np.float64]]] = []
    for degree in DEPTH_DEGREES:
        powers = np.array((0, *range(2, degree + 1)))
        design = (radius[:, None] / radius[-1]) ** powers
        solution = np.linalg.lstsq(design * weight[:, None], z * weight, rcond=None)[0]
        error = float(np.abs((design @ solution - z) * weight).max())
        polynomial = np.zeros(degree + 1)
        polynomial[powers] = solution / radius[-1] ** powers
        fits.append((error, polynomial))
        if error < MAX_DEPTH_ERROR_PX:
            break
    error, polynomial = min(fits, key=lambda fit: fit[0])
    return polynomial.tolist(), error
