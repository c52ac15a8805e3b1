"""OpenSfM's camera_models.json."""

import json
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import check_whole_sphere, export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._values import build, build_with_zeros, image_size, mapping, number, whole_sphere
from omnisight.formats._yaml import read_map

TITLE = "OpenSfM camera_models.json"
SUFFIX = ".json"
CONVENTION = (
    "x right, y down, z forward; focal length and offset of the principal point from the image centre are divided by"
    " the longer side"
)

# The projection: our model, and the coefficients, whose names are the same.
ONE_FOCAL = {
    "perspective": ("radial_tangential", "k1 k2"),
    "fisheye": ("kannala_brandt", "k1 k2"),
}
TWO_FOCALS = {
    "fisheye_opencv": ("kannala_brandt", "k1 k2 k3 k4"),
    "brown": ("radial_tangential", "k1 k2 p1 p2 k3"),
    "radial": ("radial_tangential", "k1 k2"),
    "simple_radial": ("radial_tangential", "k1"),
}
SPHERES = ("equirectangular", "spherical")
MODELS = ("kannala_brandt", "radial_tangential", "equirectangular")
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with a `projection_type`."""
    return is_json_with(text, "projection_type")


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    cameras: dict[str, Camera] = {}
    for name, fields in read_map(text).items():
        try:
            cameras[name] = _camera(mapping(fields, "a camera"))
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of one camera."""
    exported = export(camera, MODELS)
    model, size, values = camera.model.name, exported.size, exported.values
    fields: dict[str, Any] = {"width": size[0], "height": size[1]}
    if model == "equirectangular":
        check_whole_sphere(camera)
        fields["projection_type"] = "equirectangular"
    else:
        kind, names = next((kind, names) for kind, (ours, names) in TWO_FOCALS.items() if ours == model)
        longer = max(size)
        fields |= {
            "projection_type": kind,
            "focal_x": values["fx"] / longer,
            "focal_y": values["fy"] / longer,
            "c_x": (values["cx"] - (size[0] - 1) / 2) / longer,
            "c_y": (values["cy"] - (size[1] - 1) / 2) / longer,
            **{name: values[name] for name in names.split()},
        }
    return exported.result(json.dumps({"camera": fields}, indent=4) + "\n")


def _camera(fields: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    kind = fields.get("projection_type")
    size = image_size(fields.get("width"), fields.get("height"))
    if kind in SPHERES:
        extra = unknown_fields(fields, {"projection_type", "width", "height"})
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    if kind in ONE_FOCAL:
        model, names = ONE_FOCAL[kind]
        focal = {"fx": "focal", "fy": "focal"}
    elif kind in TWO_FOCALS:
        model, names = TWO_FOCALS[kind]
        focal = {"fx": "focal_x", "fy": "focal_y", "cx": "c_x", "cy": "c_y"}
    else:
        # Unlike Aria's model, fisheye62 and fisheye624 apply the tangential terms to the undistorted plane.
        known = ", ".join((*ONE_FOCAL, *TWO_FOCALS, *SPHERES))
        raise ValueError(f"unknown projection_type {kind!r:.40}; known are {known}")
    given = {ours: number(fields.get(theirs, 0.0), theirs) * max(size) for ours, theirs in focal.items()}
    centre = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    plane = given | {key: centre[key] + given.get(key, 0.0) for key in centre}
    coefficients = {name: fields.get(name, 0.0) for name in names.split()}
    known_keys = {"projection_type", "width", "height", *focal.values(), *names.split()}
    return Camera(build_with_zeros(model, plane | coefficients), size, extra=unknown_fields(fields, known_keys))
