"""Hugin's and PanoTools' project, .pto: its `i` lines, one per image.

`f` is the projection, `v` the angle of view across the width of the image (DEGREES), which determines the focal length:
half the width is f tan(v/2), f v/2, f sin(v/2), 2 f tan(v/4) or 2 f sin(v/4) px. The principal point is the image
centre plus d and e (px), integer pixel = pixel centre. a, b, c distort the ideal radius: r' = a r^4 + b r^3 + c r^2 +
(1 - a - b - c) r, with 1 = half the SHORTER side ("the largest circle that completely fits into an image", Hugin's
manual on its lens correction model). A value `=2` is that of image 2 (documentation of PanoTools and
Panotools::Script).

With a, b, c a fisheye (equidistant) is our radial_polynomial; a rectilinear lens with b alone our radial_tangential.
The pose (y, p, r) and crops by `S`, which are masks, are kept unchanged.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._export import check_supported, dropped_fields, export, unknown_fields, with_mean_focal
from omnisight.formats._limits import MAX_CAMERAS, SEARCHED_CHARS
from omnisight.formats._readers import Reader
from omnisight.formats._values import build, build_with_zeros, image_size, number

TITLE = "Hugin project"
SUFFIX = ".pto"
CONVENTION = (
    "angle of view across in degrees; principal point from the image centre; a, b, c over half the shorter side"
)
# The projection: our model, the half width over the focal length from half the angle of view, and the inverse.
PROJECTIONS: dict[int, tuple[str, Callable[[float], float], Callable[[float], float]]] = {
    0: ("pinhole", math.tan, math.atan),
    3: ("equidistant", float, float),
    2: ("equidistant", float, float),
    4: ("equirectangular", float, float),
    8: ("orthographic", math.sin, math.asin),
    10: ("stereographic", lambda v: 2 * math.tan(v / 2), lambda x: 2 * math.atan(x / 2)),
    21: ("equisolid", lambda v: 2 * math.sin(v / 2), lambda x: 2 * math.asin(x / 2)),
}
MAX_VIEW_DEG = {0: 179.0, 8: 180.0}  # 360 for the other projections
DISTORTED = {"radial_polynomial": 3, "radial_tangential": 0}
MODELS = tuple(
    dict.fromkeys(
        ("equidistant", "radial_polynomial", *(model for model, _, _ in PROJECTIONS.values()), "radial_tangential")
    )
)
LINE = re.compile(r"^i[ \t]+(?=[^\n]*[ \t]f[-+.\d=])(?=[^\n]*[ \t]v[-+.\d=])", re.MULTILINE)
WORD = re.compile(r'([A-Za-z]+)(=?)("[^"\n]*"|[^\s"]*)')
NUMBERS = ("a", "b", "c", "d", "e", "g", "t")
NEWTON_ITERATIONS, NEWTON_TOLERANCE = 100, 1e-14
COMMENT = "# {}"
FLAT = Reader("pano_trafo (Hugin 2022.0)", 90, "returns no pixel")
WIDE = Reader("pano_trafo (Hugin 2022.0)")
READERS = dict.fromkeys(MODELS, WIDE) | dict.fromkeys(("pinhole", "radial_tangential", "orthographic"), FLAT)


def matches(text: str) -> bool:
    """Return whether a line begins with `i` and holds an `f` and a `v`."""
    return LINE.search(text[:SEARCHED_CHARS]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the distinct cameras of all images, each named by its first image."""
    lines = [line for line in text.splitlines() if re.match(r"i[ \t]", line)]
    if len(lines) > MAX_CAMERAS:
        raise ValueError(f"{len(lines)} images; at most {MAX_CAMERAS} are read")
    given = [{name: (linked, word) for name, linked, word in WORD.findall(line[1:])} for line in lines]
    cameras: dict[str, Camera] = {}
    seen: set[Any] = set()
    for i, fields in enumerate(given):
        try:
            # A damaged number reads as the end of the name: `e12.5` with nan in place of 12.5 is a field `enan`.
            if empty := [name for name, (_, word) in fields.items() if not word]:
                raise ValueError(f"field {empty[0]} has no number")
            camera = _camera(fields, given)
        except ValueError as error:
            raise ValueError(f"image {i}: {error}") from error
        if (camera.model, camera.size) in seen:
            continue
        seen.add((camera.model, camera.size))
        name = fields.get("n", ("", ""))[1].strip('"') or f"image{i}"
        cameras[name if name not in cameras else f"{name} ({i})"] = camera
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return a project of one image with the pose that the camera's file held."""
    check_supported(camera, MODELS)
    lacking = ("skew", "k2", "p1", "p2", "k3") if camera.model.name == "radial_tangential" else ("skew",)
    exported = export(camera, MODELS, [n for n in camera.model.param_names if n not in lacking])
    width, height = exported.size
    camera, focal_notes = with_mean_focal(exported.camera)
    values = camera.model.to_dict()
    kind = DISTORTED.get(camera.model.name)
    if kind is None:
        kind = next(kind for kind, (model, _, _) in PROJECTIONS.items() if model == camera.model.name)
    shape = _distortion(camera.model.name, values, min(width, height) / 2)
    ideal = values["fx"] / (1 - sum(shape.values()))
    half = width / 2 / ideal
    try:
        view = 2 * math.degrees(PROJECTIONS[kind][2](half))
    except ValueError as error:
        raise ValueError(
            f"f{kind} with a focal length of {ideal:.4g} px does not reach the side of the image"
        ) from error
    offset = {"d": values["cx"] - (width - 1) / 2, "e": values["cy"] - (height - 1) / 2}
    pose = {name: camera.extra.get(name, 0.0) for name in ("y", "p", "r")}
    own = "".join(f" {name}{value!r}" for name, value in {**pose, **shape, **offset}.items())
    line = f'i w{width} h{height} f{kind} v{view!r}{own} g0 t0 n"image.jpg"'
    text = f'# a project of one image\np f2 w3000 h1500 v360 n"TIFF_m"\n{line}\n'
    return text, exported.notes + focal_notes + dropped_fields(camera, ("y", "p", "r", "n"))


def _distortion(model: str, values: Mapping[str, float], radius: float) -> dict[str, float]:
    """Return a, b, c of r' = f/d radius (d q + c q^2 + b q^3 + a q^4), d = 1 - a - b - c, q = theta f/d/radius."""
    if model not in DISTORTED:
        return {"a": 0.0, "b": 0.0, "c": 0.0}
    # With x = f/radius the coefficients are k2 = c x/d^2, k3 = b x^2/d^3, k4 = a x^3/d^4; Newton's method for d.
    x = values["fx"] / radius
    powers = {"b": (values["k1"], 3)} if "k1" in values else {"c": (values["k2"], 2), "b": (values["k3"], 3)}
    powers |= {"a": (values["k4"], 4)} if "k4" in values else {}
    terms = {name: (k / x ** (n - 1), n) for name, (k, n) in powers.items()}
    d = 1.0
    for _ in range(NEWTON_ITERATIONS):
        residual = 1 - d - sum(k * d**n for k, n in terms.values())
        d += residual / (1 + sum(n * k * d ** (n - 1) for k, n in terms.values()))
        if abs(residual) < NEWTON_TOLERANCE:
            break
    else:
        raise ValueError("no a, b and c represent this lens")
    return dict.fromkeys("abc", 0.0) | {name: k * d**n for name, (k, n) in terms.items()}


def _camera(fields: Mapping[str, tuple[str, str]], images: list[dict[str, tuple[str, str]]]) -> Camera:
    """Return the camera of the fields of a line; a linked field refers to another image."""

    def value(name: str, default: float | None = None) -> float:
        linked, word = fields.get(name, ("", ""))
        if linked:
            if not word.isdigit() or len(word) > 6 or int(word) >= len(images):
                raise ValueError(f"{name}={word[:20]} refers to an image that does not exist")
            linked, word = images[int(word)].get(name, ("", ""))
            if linked:
                raise ValueError(f"{name} refers to an image that refers to another one")
        if not word and default is not None:
            return default
        try:
            return number(float(word), name)
        except ValueError as error:
            raise ValueError(f"{name} must be a number, got {word[:30]!r}") from error

    # The name is the last field; a truncated line must not silently lose its a, b, c.
    if not fields.get("n", ("", ""))[1].endswith('"'):
        raise ValueError('no n"image" at the end: the line may be cut off')
    size = image_size(value("w"), value("h"))
    kind = value("f")
    if kind not in PROJECTIONS:
        raise ValueError(f"projection f{kind:g} is not supported; known are {', '.join(f'f{k}' for k in PROJECTIONS)}")
    model, half_width, _ = PROJECTIONS[int(kind)]
    view = value("v")
    max_view = MAX_VIEW_DEG.get(int(kind), 360.0)
    if not 0 < view <= max_view * (1 + 1e-12):
        raise ValueError(f"v (degrees) must lie between 0 and {max_view:g}, got {view:g}")
    v = {name: value(name, 0.0) for name in NUMBERS}
    if v["g"] or v["t"]:
        raise ValueError(f"a shear (g = {v['g']:g}, t = {v['t']:g}) is not supported")
    if "C" in fields:
        raise ValueError("a crop by C changes the meaning of v; crop the image itself, or use S")
    half = half_width(math.radians(view) / 2)
    if not half > 0:
        raise ValueError(f"v of {view:g} degrees is too wide for f{kind:g}")
    focal = size[0] / 2 / half
    plane = {"cx": (size[0] - 1) / 2 + v["d"], "cy": (size[1] - 1) / 2 + v["e"]}
    known = {"w", "h", "f", "v", "n", *NUMBERS}
    extra = {name: word for name, (_, word) in unknown_fields(fields, known).items()}
    extra |= {name: value(name, 0.0) for name in ("y", "p", "r") if name in fields}
    a, b, c = v["a"], v["b"], v["c"]
    if not (a or b or c):
        return Camera(build_with_zeros(model, {"fx": focal, "fy": focal, **plane}), size, extra=extra)
    d = 1 - a - b - c
    f = focal / (min(size) / 2)
    distorted = {"fx": focal * d, "fy": focal * d, **plane}
    if not d > 0:
        raise ValueError(f"1 - a - b - c must be positive, got {d:g}")
    if model == "equidistant":
        own = {"k2": c * f / d, "k3": b * f**2 / d, "k4": a * f**3 / d}
        return Camera(build("radial_polynomial", distorted | own), size, extra=extra)
    if model == "pinhole" and not a and not c:
        return Camera(build_with_zeros("radial_tangential", distorted | {"k1": b * f**2 / d}), size, extra=extra)
    raise ValueError(f"f{kind:g} with a = {a:g}, b = {b:g}, c = {c:g} is not supported")
