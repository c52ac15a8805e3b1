"""CamOdoCal's yaml, which VINS-Mono and KITTI-360 use.

Integer pixel = pixel centre; lengths in px. KANNALA_BRANDT's k2 ... k5, mu, mv are OpenCV's k1 ... k4, fx, fy of a
fisheye; MEI is OpenCV's omnidir model. The polynomial p0 ... p4 of SCARAMUZZA has OCamCalib's sign (p0 < 0, z back),
the inverse polynomial is in atan(z/r), radians, and the stretch [ac ad; ae 1] and the centre are in x, y, as in
`OCAMCamera::spaceToPlane`; its `liftProjective` omits the inverse of the stretch, which is not followed here. Files
whose numbers were copied from OCamCalib's text have row and column exchanged.
"""

from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import FIXED_TERMS, export_xy, model_of_xy
from omnisight.formats._values import build_with_zeros, image_size, mapping, number
from omnisight.formats._yaml import flow, read_map
from omnisight.models import CameraModel

TITLE = "CamOdoCal yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; KANNALA_BRANDT's k2 ... k5 are OpenCV's k1 ... k4"
)

Groups = dict[str, dict[str, str]]
# Each group of a model: CamOdoCal's name and ours of each parameter.
DISTORTION = {"k1": "k1", "k2": "k2", "p1": "p1", "p2": "p2"}
FISHEYE = {"k2": "k1", "k3": "k2", "k4": "k3", "k5": "k4", "mu": "fx", "mv": "fy", "u0": "cx", "v0": "cy"}
LENSES: dict[str, tuple[str, Groups]] = {
    "KANNALA_BRANDT": ("kannala_brandt", {"projection_parameters": FISHEYE}),
    "MEI": (
        "mei",
        {
            "mirror_parameters": {"xi": "xi"},
            "distortion_parameters": DISTORTION,
            "projection_parameters": {"gamma1": "fx", "gamma2": "fy", "u0": "cx", "v0": "cy"},
        },
    ),
    "PINHOLE": (
        "radial_tangential",
        {
            "distortion_parameters": DISTORTION,
            "projection_parameters": {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"},
        },
    ),
}
MODELS = (*(model for model, _ in LENSES.values()), "ocam")
POLY, INVERSE, AFFINE = "poly_parameters", "inv_poly_parameters", "affine_parameters"
STRETCH = {"c": "ac", "d": "ad", "e": "ae", "cx": "cx", "cy": "cy"}
INVERSE_TERMS = 20  # that CamOdoCal reads; older builds read 6
MAX_CENTRE_OFFSET = 0.1  # of the image side; a centre farther off may be row, column
KNOWN = {"model_type", "image_width", "image_height"} | {group for _, groups in LENSES.values() for group in groups}
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether a line begins with `model_type:`."""
    return has_lines(text, "model_type")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    kind = str(data["model_type"]).upper()
    size = image_size(data.get("image_width"), data.get("image_height"))
    name = str(data.get("camera_name") or "camera")
    if kind == "SCARAMUZZA":
        extra = unknown_fields(data, KNOWN | {POLY, INVERSE, AFFINE})
        return {name: Camera(_scaramuzza(data, size), size, extra=extra)}
    if kind not in LENSES:
        raise ValueError(f"unknown model_type {kind[:30]!r}; known are {', '.join((*LENSES, 'SCARAMUZZA'))}")
    model, groups = LENSES[kind]
    values: dict[str, Any] = {}
    extra = unknown_fields(data, KNOWN)
    for group, names in groups.items():
        given = data.get(group)
        if not isinstance(given, dict) or not set(names) <= set(given):
            raise ValueError(f"{group} must hold {', '.join(names)}")
        values |= {ours: given[theirs] for theirs, ours in names.items()}
        if unknown := unknown_fields(given, names):
            extra[group] = unknown
    return {name: Camera(build_with_zeros(model, values), size, extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera."""
    if camera.model.name == "ocam":
        return _serialize_scaramuzza(camera)
    kind, groups = next(
        ((kind, groups) for kind, (model, groups) in LENSES.items() if model == camera.model.name), ("", Groups())
    )
    exported = export(camera, MODELS, [ours for names in groups.values() for ours in names.values()])
    values = {
        group: {theirs: exported.values[ours] for theirs, ours in names.items()} for group, names in groups.items()
    }
    return exported.result(_text(camera, kind, exported.size, values), ("camera_name",))


def _text(camera: Camera, kind: str, size: tuple[int, int], groups: Mapping[str, Mapping[str, float]]) -> str:
    name = flow(str(camera.extra.get("camera_name", "camera")))
    lines = ["%YAML:1.0", "---", f"model_type: {kind}", f"camera_name: {name}"]
    lines += [f"image_width: {size[0]}", f"image_height: {size[1]}"]
    for group, values in groups.items():
        lines += [f"{group}:", *(f"   {name}: {flow(value)}" for name, value in values.items())]
    return "\n".join(lines) + "\n"


def _scaramuzza(data: Mapping[str, Any], size: tuple[int, int]) -> CameraModel:
    poly, affine = mapping(data.get(POLY), POLY), mapping(data.get(AFFINE), AFFINE)
    direct = [number(poly.get(f"p{i}"), f"{POLY} p{i}") for i in range(FIXED_TERMS)]
    if not direct[0] < 0:
        raise ValueError(f"{POLY} p0 must be negative (z points back), got {direct[0]:g}")
    plane = {ours: number(affine.get(theirs), f"{AFFINE} {theirs}") for ours, theirs in STRETCH.items()}
    cx, cy = plane["cx"], plane["cy"]
    if _centre_offset((cx, cy), size) > MAX_CENTRE_OFFSET > _centre_offset((cy, cx), size):
        raise ValueError(
            f"the centre ({cx:g}, {cy:g}) of a {size[0]} x {size[1]} image seems to be row, column, as copied from"
            " OCamCalib's text: use the calib_results.txt it came from, or swap cx with cy"
        )
    return model_of_xy([-value for value in direct], **plane)


def _centre_offset(centre: tuple[float, float], size: tuple[int, int]) -> float:
    """Return the offset of a principal point from the image centre over the image side."""
    return max(abs(c - side / 2) / side for c, side in zip(centre, size, strict=True))


def _serialize_scaramuzza(camera: Camera) -> tuple[str, tuple[str, ...]]:
    exported = export_xy(camera, max_terms=INVERSE_TERMS)
    inverse = exported.inverse + [0.0] * (INVERSE_TERMS - len(exported.inverse))
    groups = {
        POLY: {f"p{i}": 0.0 - value for i, value in enumerate(exported.direct)},
        INVERSE: {f"p{i}": value for i, value in enumerate(inverse)},
        AFFINE: {theirs: float(exported.plane[ours]) for ours, theirs in STRETCH.items()},
    }
    return exported.result(_text(camera, "scaramuzza", exported.size, groups), ("camera_name",))
