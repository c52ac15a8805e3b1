"""OpenSfM's camera_models.json."""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import (
    build,
    is_whole_sphere,
    left_out,
    number,
    picture_size,
    refuse,
    whole_sphere,
    with_size,
)
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map

TITLE = "OpenSfM camera_models.json"
SUFFIX = ".json"
CONVENTION = (
    "x right, y down, z forward; focal length and centre over the longer side of the image, centre from its middle"
)

# Its projection: our model, and the names of its coefficients, which are ours.
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
KIND = re.compile(r'"projection_type"\s*:')


def matches(text: str) -> bool:
    """Say whether this is JSON with a `projection_type` and no file of our own."""
    return text.lstrip().startswith("{") and '"omnisight' not in text[:2000] and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    cameras: dict[str, Camera] = {}
    for name, fields in read_map(text).items():
        if not isinstance(fields, dict) or "projection_type" not in fields:
            raise ValueError(f"{name[:60]}: no camera with a projection_type")
        try:
            cameras[name] = _camera(fields)
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of one camera."""
    refuse(camera, MODELS)
    size = with_size(camera)
    model, values = camera.model.name, camera.model.to_dict()
    build(model, values)
    fields: dict[str, Any] = {"width": size[0], "height": size[1]}
    if model == "equirectangular":
        is_whole_sphere(camera)
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
    return json.dumps({"camera": fields}, indent=4) + "\n", left_out(camera)


def _camera(fields: Mapping[str, Any]) -> Camera:
    kind = fields["projection_type"]
    size = picture_size(fields.get("width"), fields.get("height"))
    if kind in SPHERES:
        extra = note_unknown(fields, {"projection_type", "width", "height"})
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    if kind in ONE_FOCAL:
        model, names = ONE_FOCAL[kind]
        focal = {"fx": "focal", "fy": "focal"}
    elif kind in TWO_FOCALS:
        model, names = TWO_FOCALS[kind]
        focal = {"fx": "focal_x", "fy": "focal_y", "cx": "c_x", "cy": "c_y"}
    else:
        # fisheye62 and fisheye624 take the tangential terms of the undistorted plane, unlike Aria's model of that name.
        known = ", ".join((*ONE_FOCAL, *TWO_FOCALS, *SPHERES))
        raise ValueError(f"no projection_type {kind!r:.40} that a model of ours fits; there are {known}")
    given = {ours: number(fields.get(theirs, 0.0), theirs) * max(size) for ours, theirs in focal.items()}
    middle = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    plane = given | {key: middle[key] + given.get(key, 0.0) for key in middle}
    coefficients = {"kannala_brandt": "k1 k2 k3 k4", "radial_tangential": "k1 k2 p1 p2 k3"}[model].split()
    own = {name: fields.get(name, 0.0) if name in names.split() else 0.0 for name in coefficients}
    known_keys = {"projection_type", "width", "height", *focal.values(), *names.split()}
    return Camera(build(model, plane | own), size, extra=note_unknown(fields, known_keys))
