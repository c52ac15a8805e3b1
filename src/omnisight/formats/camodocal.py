"""CamOdoCal's yaml, which VINS-Mono and KITTI-360 use.

Integer pixel = pixel centre; lengths in px. KANNALA_BRANDT's k2 ... k5, mu, mv are OpenCV's k1 ... k4, fx, fy of a
fisheye; MEI's are OpenCV's omnidir. Of SCARAMUZZA the polynomial p0 ... p4 has OCamCalib's sign (p0 < 0, z back), the
inverse polynomial is in atan(z/r), radians, and the stretch [ac ad; ae 1] and the centre are in x, y, as
`OCAMCamera::spaceToPlane` has it; its `liftProjective` forgets to undo the stretch, which is not followed here. Files
whose numbers were copied from OCamCalib's text have row and column the other way round.
"""

import re
from collections.abc import Mapping
from typing import Any, cast

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._scaramuzza import (
    INVERSE_PX,
    TERMS,
    inverse_polynomial,
    model_of_xy,
    of_degree_four,
    picture_radius,
    xy_of_model,
)
from omnisight.formats._yaml import flow, read_map
from omnisight.models import CameraModel
from omnisight.models.ocam import Ocam

TITLE = "CamOdoCal yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; KANNALA_BRANDT's k2 ... k5 are OpenCV's k1 ... k4"
)

# Its model: ours, and for each of its groups its names and ours.
DISTORTION = ("distortion_parameters", {"k1": "k1", "k2": "k2", "p1": "p1", "p2": "p2"})
FISHEYE = {"k2": "k1", "k3": "k2", "k4": "k3", "k5": "k4"}
LENSES: dict[str, tuple[str, tuple[tuple[str, dict[str, str]], ...]]] = {
    "KANNALA_BRANDT": (
        "kannala_brandt",
        (("projection_parameters", {**FISHEYE, "mu": "fx", "mv": "fy", "u0": "cx", "v0": "cy"}),),
    ),
    "MEI": (
        "mei",
        (
            ("mirror_parameters", {"xi": "xi"}),
            DISTORTION,
            ("projection_parameters", {"gamma1": "fx", "gamma2": "fy", "u0": "cx", "v0": "cy"}),
        ),
    ),
    "PINHOLE": (
        "radial_tangential",
        (DISTORTION, ("projection_parameters", {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"})),
    ),
}
MODELS = (*(model for model, _ in LENSES.values()), "ocam")
POLY, INVERSE, AFFINE = "poly_parameters", "inv_poly_parameters", "affine_parameters"
STRETCH = {"c": "ac", "d": "ad", "e": "ae", "cx": "cx", "cy": "cy"}
HELD_INVERSE = 20  # coefficients; older builds 6
SWAPPED = 0.1  # of the width and height: farther off the middle, a centre is looked at
KNOWN = {"model_type", "image_width", "image_height"} | {group for _, groups in LENSES.values() for group, _ in groups}
TYPE = re.compile(r"^model_type[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether a line begins with `model_type:`."""
    return TYPE.search(text[:1_000_000]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    kind = str(data["model_type"]).upper()
    size = picture_size(data.get("image_width"), data.get("image_height"))
    name = str(data.get("camera_name") or "camera")
    if kind == "SCARAMUZZA":
        extra = note_unknown(data, KNOWN | {POLY, INVERSE, AFFINE})
        return {name: Camera(_scaramuzza(data, size), size, extra=extra)}
    if kind not in LENSES:
        raise ValueError(f"no model_type {kind[:30]!r}; there are {', '.join((*LENSES, 'SCARAMUZZA'))}")
    model, groups = LENSES[kind]
    values: dict[str, Any] = {"k3": 0.0} if model == "radial_tangential" else {}
    unknown: dict[str, Any] = {}
    for group, names in groups:
        given = data.get(group)
        if not isinstance(given, dict) or not set(names) <= set(given):
            raise ValueError(f"{group} must hold {', '.join(names)}")
        values |= {ours: given[theirs] for theirs, ours in names.items()}
        if beside := note_unknown(given, set(names)):
            unknown[group] = beside
    return {name: Camera(build(model, values), size, extra=note_unknown(data, KNOWN) | unknown)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text."""
    refuse(camera, MODELS)
    size = with_size(camera)
    if camera.model.name == "ocam":
        return _render_scaramuzza(camera, size)
    kind = next(kind for kind, (model, _) in LENSES.items() if model == camera.model.name)
    groups = LENSES[kind][1]
    camera, notes = without(camera, [ours for _, names in groups for ours in names.values()])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    lines = _head(camera, kind, size)
    for group, names in groups:
        lines += [f"{group}:", *(f"   {theirs}: {flow(values[ours])}" for theirs, ours in names.items())]
    return "\n".join(lines) + "\n", notes + left_out(camera, ("camera_name",))


def _head(camera: Camera, kind: str, size: tuple[int, int]) -> list[str]:
    name = flow(str(camera.extra.get("camera_name", "camera")))
    sides = [f"image_width: {size[0]}", f"image_height: {size[1]}"]
    return ["%YAML:1.0", "---", f"model_type: {kind}", f"camera_name: {name}", *sides]


def _scaramuzza(data: Mapping[str, Any], size: tuple[int, int]) -> CameraModel:
    poly, affine = data.get(POLY), data.get(AFFINE)
    if not isinstance(poly, dict) or not isinstance(affine, dict):
        raise ValueError(f"{POLY} and {AFFINE} must hold names and values")
    direct = [number(poly.get(f"p{i}"), f"{POLY} p{i}") for i in range(TERMS)]
    if not direct[0] < 0:
        raise ValueError(f"{POLY} p0 must be negative (z points back), got {direct[0]:g}")
    plane = {ours: number(affine.get(theirs), f"{AFFINE} {theirs}") for ours, theirs in STRETCH.items()}
    off, turned = (_off_middle(pair, size) for pair in ((plane["cx"], plane["cy"]), (plane["cy"], plane["cx"])))
    if off > SWAPPED > turned:
        raise ValueError(
            f"the centre ({plane['cx']:g}, {plane['cy']:g}) of a {size[0]} x {size[1]} image seems to be row, column,"
            " as copied from OCamCalib's text: use the calib_results.txt it came from, or swap cx with cy"
        )
    return model_of_xy([-value for value in direct], **plane)


def _off_middle(centre: tuple[float, float], size: tuple[int, int]) -> float:
    return max(abs(c - side / 2) / side for c, side in zip(centre, size, strict=True))


def _render_scaramuzza(camera: Camera, size: tuple[int, int]) -> tuple[str, tuple[str, ...]]:
    camera, notes = of_degree_four(camera)
    model = cast(Ocam, camera.model)
    direct, c, d, e = xy_of_model(model)
    plane = {"c": c, "d": d, "e": e, "cx": model.cx, "cy": model.cy}
    model_of_xy(direct, **plane)
    inverse, error = inverse_polynomial(model, picture_radius(model, size), scale=model.c, most=HELD_INVERSE)
    if error > INVERSE_PX:
        notes += (f"the inverse polynomial is {error:.2g} px off at most: programs that project with it are, too",)
    inverse += [0.0] * (HELD_INVERSE - len(inverse))
    groups = {
        POLY: {f"p{i}": 0.0 - value for i, value in enumerate(direct)},
        INVERSE: {f"p{i}": value for i, value in enumerate(inverse)},
        AFFINE: {theirs: float(plane[ours]) for ours, theirs in STRETCH.items()},
    }
    lines = _head(camera, "scaramuzza", size)
    for group, values in groups.items():
        lines += [f"{group}:", *(f"   {name}: {flow(value)}" for name, value in values.items())]
    return "\n".join(lines) + "\n", notes + left_out(camera, ("camera_name",))
