"""Agisoft Metashape's camera calibration xml, alone or inside cameras.xml.

All in px: fx = f + b1, fy = f, skew = b2, and the principal point is an offset from the image centre, width/2 + cx; the
centre of the top-left pixel is (0.5, 0.5). p1 and p2 are OpenCV's p2 and p1 (user manual, appendix on camera models;
Agisoft's support: "F = Fy, B1 = Fx - Fy, B2 = skew"). A `fisheye` is equidistant, its coefficients act on the plane of
theta (radians): k1 ... k4 are those of OpenCV's fisheye.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._export import check_whole_sphere, export, unknown_fields
from omnisight.formats._limits import HEAD_CHARS
from omnisight.formats._opencv_storage import read_xml
from omnisight.formats._readers import Reader
from omnisight.formats._values import HALF_PIXEL, build, image_size, number, whole_sphere
from omnisight.formats._yaml import scalar
from omnisight.models import CameraModel

TITLE = "Metashape calibration xml"
SUFFIX = ".xml"
CONVENTION = (
    "the centre of the top-left pixel is (0.5, 0.5); principal point from the image centre; fx = f + b1; p1 and p2"
    " swapped"
)
MODELS = (
    *("kannala_brandt", "thin_prism_fisheye", "radial_tangential", "pinhole"),
    *("equidistant", "equisolid", "equirectangular"),
)
RADIAL = ("k1", "k2", "k3", "k4")
NUMBERS = ("f", "cx", "cy", "b1", "b2", *RADIAL, "p1", "p2", "p3", "p4")
FISHEYE = ("fisheye", "equidistant_fisheye")
# The projection of our models; the others are `frame`.
PROJECTIONS = {
    "kannala_brandt": "fisheye",
    "thin_prism_fisheye": "fisheye",
    "equidistant": "fisheye",
    "equisolid": "equisolid_fisheye",
    "equirectangular": "spherical",
}
KIND = re.compile(r"<calibration[ >]")
COMMENT = "<!-- {} -->"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is XML with a `calibration`."""
    head = text.lstrip()
    return head.startswith("<") and "<opencv_storage" not in head[:HEAD_CHARS] and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the calibration of every sensor; an adjusted one supersedes the initial one."""
    target = _Calibrations()
    read_xml(text, target)
    found = list(zip(target.all, target.sensors, strict=True))
    adjusted = {sensor for fields, sensor in found if fields.get("class") == "adjusted"}
    used = [fields for fields, sensor in found if fields.get("class") == "adjusted" or sensor not in adjusted]
    cameras: dict[str, Camera] = {}
    for fields in used:
        name = "camera" if len(used) == 1 else f"camera{len(cameras)}"
        cameras[name] = _camera(fields)
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of one calibration."""
    held = [name for name in camera.model.param_names if name[0] != "s" or name == "skew"]
    exported = export(camera, MODELS, held)
    (width, height), values = exported.size, exported.values
    if camera.model.name == "equirectangular":
        check_whole_sphere(camera)
        values = values | {"fy": values["fx"], "cx": width / 2 - HALF_PIXEL, "cy": height / 2 - HALF_PIXEL}
    fields: dict[str, Any] = {
        "projection": PROJECTIONS.get(camera.model.name, "frame"),
        "width": width,
        "height": height,
        "f": values["fy"],
        "cx": values["cx"] + HALF_PIXEL - width / 2,
        "cy": values["cy"] + HALF_PIXEL - height / 2,
        "b1": values["fx"] - values["fy"],
        "b2": values.get("skew", 0.0),
        **{name: values.get(name, 0.0) for name in RADIAL},
        "p1": values.get("p2", 0.0),
        "p2": values.get("p1", 0.0),
    }
    body = "".join(f"  <{key}>{value}</{key}>\n" for key, value in fields.items())
    return exported.result(f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n{body}</calibration>\n')


class _Calibrations:
    """A target of the XML parser that collects the elements of each calibration."""

    def __init__(self) -> None:
        self.all: list[dict[str, Any]] = []
        self.sensors: list[int] = []  # of each calibration: fixed ones are not adjusted
        self.sensor = 0
        self.open: dict[str, Any] | None = None
        self.words: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.words = []
        if tag == "sensor":
            self.sensor += 1
        elif tag == "calibration":
            # In cameras.xml these are attributes, and `projection` is `type`.
            self.open = {"projection": attributes.get("type"), "class": attributes.get("class")}
            self.all.append(self.open)
            self.sensors.append(self.sensor)
        elif tag == "resolution" and self.open is not None:
            self.open |= {side: scalar(attributes.get(side, "")) for side in ("width", "height")}

    def data(self, text: str) -> None:
        self.words.append(text)

    def end(self, tag: str) -> None:
        text = "".join(self.words).strip()
        if tag == "calibration":
            self.open = None
        elif self.open is not None and text:
            if self.open.get(tag) is not None:
                raise ValueError(f"duplicate {tag[:30]!r}")
            self.open[tag] = scalar(text)
        self.words = []

    def close(self) -> None: ...


def _camera(fields: Mapping[str, Any]) -> Camera:
    """Return the camera of the elements of a calibration."""
    size = image_size(fields.get("width"), fields.get("height"))
    extra = unknown_fields(fields, {"projection", "class", "width", "height", *NUMBERS})
    kind = str(fields.get("projection"))
    if kind == "spherical":
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    v = {name: number(fields.get(name, 0.0), name) for name in NUMBERS if name != "f"}
    v["f"] = number(fields.get("f"), "f")
    return Camera(_model(kind, v, size), size, extra=extra)


def _model(kind: str, v: Mapping[str, float], size: tuple[int, int]) -> CameraModel:
    """Return the model of a projection and its numbers."""
    plane = {
        "fx": v["f"] + v["b1"],
        "fy": v["f"],
        "cx": size[0] / 2 + v["cx"] - HALF_PIXEL,
        "cy": size[1] / 2 + v["cy"] - HALF_PIXEL,
    }
    k = {name: v[name] for name in RADIAL}
    p = {"p1": v["p2"], "p2": v["p1"]}
    is_ideal = not any((*k.values(), *p.values()))
    unsupported = ["p3", "p4"]
    if kind == "frame" and is_ideal:
        model, values = "pinhole", plane | {"skew": v["b2"]}
    elif kind == "frame":
        unsupported += ["k4", "b2"]
        model, values = "radial_tangential", plane | {name: k[name] for name in ("k1", "k2", "k3")} | p
    elif kind in FISHEYE and any(p.values()):
        unsupported += ["b2"]
        model, values = "thin_prism_fisheye", plane | k | p | {"s1": 0.0, "s2": 0.0}
    elif kind in FISHEYE:
        unsupported += ["b2"]
        model, values = "kannala_brandt", plane | k
    elif kind == "equisolid_fisheye" and is_ideal:
        unsupported += ["b2"]
        model, values = "equisolid", plane
    else:
        with_coefficients = " with coefficients" if kind == "equisolid_fisheye" else ""
        known = "frame, fisheye, equisolid_fisheye without coefficients, spherical"
        raise ValueError(f"projection {kind[:40]!r}{with_coefficients} is not supported; known are {known}")
    if nonzero := [f"{name} = {v[name]:g}" for name in unsupported if v[name]]:
        raise ValueError(f"{kind} with {', '.join(nonzero)} is not supported; calibrate with these fixed at 0")
    return build(model, values)
