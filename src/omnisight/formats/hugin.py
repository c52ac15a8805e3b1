"""Hugin's and PanoTools' project, .pto: its `i` lines, one per image.

`f` is the projection, `v` the angle of view across the image's width (DEGREES), which gives the focal length: half
the width is f tan(v/2), f v/2, f sin(v/2), 2 f tan(v/4) or 2 f sin(v/4) px. The centre is the image's middle moved by
d and e (px), integer pixel = pixel centre. a, b, c bend the ideal radius: r' = a r^4 + b r^3 + c r^2 + (1 - a - b - c)
r, with 1 = half the SHORTER side ("the largest circle that completely fits into an image", Hugin's manual on its lens
correction model). A number `=2` is that of image 2. So PanoTools' documentation, as Panotools::Script repeats it.

With a, b, c a fisheye (equidistant) is our radial_polynomial; a rectilinear lens with b alone our radial_tangential.
The pose (y, p, r) is kept as it is. Crops by `S` are masks, and kept too.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import (
    build,
    left_out,
    number,
    picture_size,
    refuse,
    with_one_focal,
    with_size,
    without,
)
from omnisight.formats._protocol import note_unknown

TITLE = "Hugin project"
SUFFIX = ".pto"
CONVENTION = "angle of view across in degrees; centre from the image's middle; a, b, c over half the shorter side"
# Its projection: our model, and the half width over the focal length from half the angle of view, and back.
PROJECTIONS: dict[int, tuple[str, Callable[[float], float], Callable[[float], float]]] = {
    0: ("pinhole", math.tan, math.atan),
    3: ("equidistant", float, float),
    2: ("equidistant", float, float),
    4: ("equirectangular", float, float),
    8: ("orthographic", math.sin, math.asin),
    10: ("stereographic", lambda v: 2 * math.tan(v / 2), lambda x: 2 * math.atan(x / 2)),
    21: ("equisolid", lambda v: 2 * math.sin(v / 2), lambda x: 2 * math.asin(x / 2)),
}
WIDEST = {0: 179.0, 8: 180.0}  # degrees, of the angle of view
BENT = {"radial_polynomial": 3, "radial_tangential": 0}
MODELS = tuple(
    dict.fromkeys(
        ("equidistant", "radial_polynomial", *(model for model, _, _ in PROJECTIONS.values()), "radial_tangential")
    )
)
LINE = re.compile(r"^i[ \t]+(?=[^\n]*[ \t]f[-+.\d=])(?=[^\n]*[ \t]v[-+.\d=])", re.MULTILINE)
WORD = re.compile(r'([A-Za-z]+)(=?)("[^"\n]*"|[^\s"]*)')
NUMBERS = ("a", "b", "c", "d", "e", "g", "t")
MOST = 10_000  # images


def matches(text: str) -> bool:
    """Say whether a line begins with `i` and holds an `f` and a `v`."""
    return LINE.search(text[:1_000_000]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera of every image; images by one camera are one, named by the first."""
    lines = [line for line in text.splitlines() if re.match(r"i[ \t]", line)]
    if len(lines) > MOST:
        raise ValueError(f"{len(lines)} images; at most {MOST} are read")
    given = [{name: (linked, word) for name, linked, word in WORD.findall(line[1:])} for line in lines]
    cameras: dict[str, Camera] = {}
    seen: set[Any] = set()
    for i, fields in enumerate(given):
        try:
            camera = _camera(fields, given)
        except ValueError as error:
            raise ValueError(f"image {i}: {error}") from error
        said = (camera.model, camera.size)
        if said in seen:
            continue
        seen.add(said)
        name = fields.get("n", ("", ""))[1].strip('"') or f"image{i}"
        cameras[name if name not in cameras else f"{name} ({i})"] = camera
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give a project of one image, with the pose that the camera's file held or none."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    lacking = ("skew", "k2", "p1", "p2", "k3") if camera.model.name == "radial_tangential" else ("skew",)
    camera, notes = without(camera, [n for n in camera.model.param_names if n not in lacking])
    camera, one_focal = with_one_focal(camera)
    values = camera.model.to_dict()
    build(camera.model.name, values)
    kind = BENT.get(camera.model.name)
    if kind is None:
        kind = next(kind for kind, (model, _, _) in PROJECTIONS.items() if model == camera.model.name)
    shape = _bend(camera.model.name, values, min(width, height) / 2)
    ideal = values["fx"] / (1 - sum(shape.values()))
    half = width / 2 / ideal
    try:
        view = 2 * math.degrees(PROJECTIONS[kind][2](half))
    except ValueError as error:
        raise ValueError(f"f{kind} with a focal length of {ideal:.4g} px does not reach the image's side") from error
    offset = {"d": values["cx"] - (width - 1) / 2, "e": values["cy"] - (height - 1) / 2}
    pose = {name: camera.extra.get(name, 0.0) for name in ("y", "p", "r")}
    own = "".join(f" {name}{value!r}" for name, value in {**pose, **shape, **offset}.items())
    line = f'i w{width} h{height} f{kind} v{view!r}{own} g0 t0 n"image.jpg"'
    text = f'# a project of one image\np f2 w3000 h1500 v360 n"TIFF_m"\n{line}\n'
    return text, notes + one_focal + left_out(camera, ("y", "p", "r", "n"))


def _bend(model: str, values: Mapping[str, float], radius: float) -> dict[str, float]:
    """Give a, b, c. With d = 1 - a - b - c and q = theta f/d/radius: r' = f/d radius (d q + c q^2 + b q^3 + a q^4)."""
    if model not in BENT:
        return {"a": 0.0, "b": 0.0, "c": 0.0}
    # With x = f/radius the coefficients are k2 = c x/d^2, k3 = b x^2/d^3, k4 = a x^3/d^4; Newton's method for d.
    x = values["fx"] / radius
    powers = {"b": (values["k1"], 3)} if "k1" in values else {"c": (values["k2"], 2), "b": (values["k3"], 3)}
    powers |= {"a": (values["k4"], 4)} if "k4" in values else {}
    terms = {name: (k / x ** (n - 1), n) for name, (k, n) in powers.items()}
    d = 1.0
    for _ in range(100):
        missed = 1 - d - sum(k * d**n for k, n in terms.values())
        d += missed / (1 + sum(n * k * d ** (n - 1) for k, n in terms.values()))
        if abs(missed) < 1e-14:
            break
    else:
        raise ValueError("no a, b and c make this lens")
    return dict.fromkeys("abc", 0.0) | {name: k * d**n for name, (k, n) in terms.items()}


def _camera(fields: Mapping[str, tuple[str, str]], pictures: list[dict[str, tuple[str, str]]]) -> Camera:
    def value(name: str, otherwise: float | None = None) -> float:
        linked, word = fields.get(name, ("", ""))
        if linked:
            if not word.isdigit() or len(word) > 6 or int(word) >= len(pictures):
                raise ValueError(f"{name}={word[:20]} refers to no image")
            linked, word = pictures[int(word)].get(name, ("", ""))
            if linked:
                raise ValueError(f"{name} refers to an image that refers to another one")
        if not word and otherwise is not None:
            return otherwise
        try:
            return number(float(word), name)
        except ValueError as error:
            raise ValueError(f"{name} must be a number, got {word[:30]!r}") from error

    if not fields.get("n", ("", ""))[1].endswith('"'):  # it is the last: a lens must not lose its a, b, c in silence
        raise ValueError('no n"image" at the end: the line may be cut off')
    size = picture_size(value("w"), value("h"))
    kind = value("f")
    if kind not in PROJECTIONS:
        raise ValueError(f"no projection f{kind:g} of ours; there are {', '.join(f'f{k}' for k in PROJECTIONS)}")
    model, reach, _ = PROJECTIONS[int(kind)]
    view = value("v")
    widest = WIDEST.get(int(kind), 360.0)
    if not 0 < view <= widest * (1 + 1e-12):
        raise ValueError(f"v (degrees) must lie between 0 and {widest:g}, got {view:g}")
    v = {name: value(name, 0.0) for name in NUMBERS}
    if v["g"] or v["t"]:
        raise ValueError(f"a shear (g = {v['g']:g}, t = {v['t']:g}) is not supported")
    if "C" in fields:
        raise ValueError("a crop by C changes what v means; crop the image itself, or use S")
    half = reach(math.radians(view) / 2)
    if not half > 0:
        raise ValueError(f"v of {view:g} degrees is too wide for f{kind:g}")
    focal = size[0] / 2 / half
    plane = {"cx": (size[0] - 1) / 2 + v["d"], "cy": (size[1] - 1) / 2 + v["e"]}
    known = {"w", "h", "f", "v", "n", *NUMBERS}
    extra = {name: word for name, (_, word) in note_unknown(fields, known).items()}
    extra |= {name: value(name, 0.0) for name in ("y", "p", "r") if name in fields}
    a, b, c = v["a"], v["b"], v["c"]
    if not (a or b or c):
        skew = {"skew": 0.0} if model == "pinhole" else {}
        return Camera(build(model, {"fx": focal, "fy": focal, **plane, **skew}), size, extra=extra)
    d = 1 - a - b - c
    f = focal / (min(size) / 2)
    bent = {"fx": focal * d, "fy": focal * d, **plane}
    if not d > 0:
        raise ValueError(f"1 - a - b - c must be positive, got {d:g}")
    if model == "equidistant":
        own = {"k2": c * f / d, "k3": b * f**2 / d, "k4": a * f**3 / d}
        return Camera(build("radial_polynomial", bent | own), size, extra=extra)
    if model == "pinhole" and not a and not c:
        own = {"k1": b * f**2 / d, **dict.fromkeys(("k2", "p1", "p2", "k3"), 0.0)}
        return Camera(build("radial_tangential", bent | own), size, extra=extra)
    raise ValueError(f"f{kind:g} with a = {a:g}, b = {b:g}, c = {c:g} is none of our models")
