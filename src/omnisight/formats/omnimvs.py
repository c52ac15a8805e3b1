"""The config.yaml of OmniMVS: OCam cameras and their poses.

As published with the data of Won, Ryu and Lim, OmniMVS, ICCV 2019 (`poly` starts with its length): OCamCalib's numbers,
`image_size` and `center` as row, column; `pose` is rig_from_cam as rotation vector (radians) and translation (metres);
`max_fov` the whole field of view in degrees. Of the matches of its images, 57 to 87 % are on the epipolar curves of
these poses, and at most 10 % on those of their inverse.
"""

import math
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import check_supported, dropped_fields, known_size, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import cameras_of, check_count, make_rig, pose_of_vector, rig_notes, single
from omnisight.formats._scaramuzza import inverse_polynomial, model_of
from omnisight.formats._values import image_size, number, numbers
from omnisight.formats._yaml import flow, read_map
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.models.ocam import Ocam
from omnisight.rig import Rig

TITLE = "OmniMVS config.yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "OCamCalib's numbers (a0 < 0; size and centre as row, column); pose is rig_from_cam: rotation vector, translation"
)
MODELS = ("ocam",)
KNOWN = {"cam_id", "model", "poly", "inv_poly", "center", "affine", "image_size", "pose", "max_fov"}
SHARED = ("config", "dataset")
KEPT = ("img_dir", "invalid_mask", *SHARED)
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether lines begin with `cameras:`, `poly:` and `max_fov:` or `inv_poly:`."""
    return has_lines(text, "cameras") and has_lines(text, "-?[ \t]*poly", "-?[ \t]*(?:inv_poly|max_fov)", indented=True)


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    rig = parse_rig(text)
    return {name: camera for name, (camera, _) in cameras_of(rig).items()}


def parse_rig(text: str) -> Rig:
    """Return the rig of a file, in the frame of its poses."""
    data = read_map(text)
    entries = data.get("cameras")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError("cameras must be a list of cameras")
    check_count(len(entries))
    shared = {key: data[key] for key in SHARED if key in data}
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for i, entry in enumerate(entries):
        name = f"cam{entry.get('cam_id', i + 1)}"
        if name in sensors:
            raise ValueError(f"duplicate camera {name}")
        try:
            sensors[name] = _camera(entry, shared), _pose(entry)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return make_rig(sensors)


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig of one camera."""
    return serialize_rig(single(camera, "cam1"))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig; its cameras are numbered from 1 unless their names are cam and a number."""
    sensors, notes = cameras_of(rig), dict[str, tuple[str, ...]]()
    names = list(sensors)
    ids = [int(name[3:]) for name in names if name.startswith("cam") and name[3:].isdecimal()]
    ids = ids if len(set(ids)) == len(names) else list(range(1, len(names) + 1))
    lines = [f"{key}: {flow(rig.cameras[0].extra[key])}" for key in SHARED if key in rig.cameras[0].extra]
    lines.append("cameras:")
    for key, (name, (camera, pose)) in zip(ids, sensors.items(), strict=True):
        fields, notes[name] = _fields(camera, pose.inverse())
        lines += [f"- cam_id: {key}", *(f"  {field}: {flow(value)}" for field, value in fields.items())]
    return "\n".join(lines) + "\n", rig_notes(rig, notes)


def _fields(camera: Camera, rig_from_cam: Pose) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the fields of a camera and what they do not hold."""
    check_supported(camera, MODELS)
    size, model = known_size(camera), camera.model
    assert isinstance(model, Ocam)
    inverse, notes = inverse_polynomial(model, size)
    angle = {} if camera.theta_max is None else {"max_fov": 2 * math.degrees(camera.theta_max)}
    fields = {
        "model": "ocam",
        "poly": [len(model.polynomial), *(-float(value) for value in model.polynomial)],
        "inv_poly": [len(inverse), *inverse],
        "center": [model.cy, model.cx],
        "affine": [model.c, model.d, model.e],
        "image_size": [size[1], size[0]],
        "pose": [*so3.log(rig_from_cam.rotation).tolist(), *rig_from_cam.translation.tolist()],
        **angle,
        **{key: value for key, value in camera.extra.items() if key in KEPT and key not in SHARED},
    }
    lost = [note.replace("the calibrated field of view, ", "") for note in dropped_fields(camera, KEPT)]
    return fields, notes + tuple(note for note in lost if note != "not written: the calibrated field of view")


def _camera(entry: Mapping[str, Any], shared: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    if (kind := entry.get("model", "ocam")) != "ocam":
        raise ValueError(f"unknown model {kind!r:.40}; known is ocam")
    poly = numbers(entry.get("poly"), "poly")
    if not poly or poly[0] != len(poly) - 1:
        raise ValueError(f"poly must hold its number of coefficients and then these, got {poly!r:.60}")
    row, column = numbers(entry.get("center"), "center", 2)
    c, d, e = numbers(entry.get("affine"), "affine", 3)
    height, width = numbers(entry.get("image_size"), "image_size", 2)
    model = model_of([-value for value in poly[1:]], cx=column, cy=row, c=c, d=d, e=e)
    theta_max = None
    if entry.get("max_fov") is not None:
        if not 0 < (field := number(entry["max_fov"], "max_fov")) <= 360:
            raise ValueError(f"max_fov must lie between 0 and 360 degrees, got {field:g}")
        theta_max = math.radians(field / 2)
    extra = {**unknown_fields(entry, KNOWN), **shared}
    return Camera(model, image_size(width, height), theta_max=theta_max, extra=extra)


def _pose(entry: Mapping[str, Any]) -> Pose:
    """Return sensor_from_rig of an entry."""
    values = numbers(entry.get("pose"), "pose", 6)
    return pose_of_vector(values[:3], values[3:]).inverse()
