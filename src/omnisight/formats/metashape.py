"""Agisoft Metashape's camera calibration xml, by itself or inside its cameras.xml.

All in px: fx = f + b1, fy = f, skew = b2, and the centre is an offset from the image's middle, cx = width/2 + cx; the
centre of the top-left pixel is (0.5, 0.5). p1 and p2 are OpenCV's p2 and p1. So the user manual's appendix on camera
models; Agisoft's own answer on fx, fy and skew: "F = Fy, B1 = Fx - Fy, B2 = skew". A `fisheye` is equidistant, its
coefficients act on the plane of theta (radians): k1 ... k4 are those of OpenCV's fisheye.
"""

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
    without,
)
from omnisight.formats._opencv_storage import read_xml
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import scalar

TITLE = "Metashape calibration xml"
SUFFIX = ".xml"
CONVENTION = (
    "the centre of the top-left pixel is (0.5, 0.5); centre from the image's middle; fx = f + b1; p1 and p2 swapped"
)
SHIFT = 0.5
MODELS = (
    *("kannala_brandt", "thin_prism_fisheye", "radial_tangential", "pinhole"),
    *("equidistant", "equisolid", "equirectangular"),
)
RADIAL = ("k1", "k2", "k3", "k4")
NUMBERS = ("f", "cx", "cy", "b1", "b2", *RADIAL, "p1", "p2", "p3", "p4")
FISHEYE = ("fisheye", "equidistant_fisheye")
KIND = re.compile(r"<calibration[ >]")
OTHERS = "<opencv_storage"


def matches(text: str) -> bool:
    """Say whether this is XML with a `calibration`."""
    head = text.lstrip()
    return head.startswith("<") and OTHERS not in head[:2000] and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read every calibration; of an adjusted one and the one it began with, the adjusted."""
    found = _Calibrations()
    read_xml(text, found)
    adjusted = [given for given in found.all if given.get("class") == "adjusted"] or found.all
    cameras: dict[str, Camera] = {}
    for given in adjusted:
        name = "camera" if len(adjusted) == 1 else f"camera{len(cameras)}"
        cameras[name] = _camera(given)
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of one calibration."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    model = camera.model.name
    kind = "frame"
    if model == "equirectangular":
        is_whole_sphere(camera)
        camera, notes, kind = camera, (), "spherical"
        values = {"fx": camera.model.params[0], "fy": camera.model.params[0], "cx": width / 2 - SHIFT}
        values |= {"cy": height / 2 - SHIFT}
    else:
        kind = "equisolid_fisheye" if model == "equisolid" else kind
        kind = "fisheye" if model in ("kannala_brandt", "thin_prism_fisheye", "equidistant") else kind
        camera, notes = without(camera, [n for n in camera.model.param_names if n[0] != "s" or n == "skew"])
        values = camera.model.to_dict()
        build(model, values)
    fields: dict[str, Any] = {
        "projection": kind,
        "width": width,
        "height": height,
        "f": values["fy"],
        "cx": values["cx"] + SHIFT - width / 2,
        "cy": values["cy"] + SHIFT - height / 2,
        "b1": values["fx"] - values["fy"],
        "b2": values.get("skew", 0.0),
        **{name: values.get(name, 0.0) for name in RADIAL},
        "p1": values.get("p2", 0.0),
        "p2": values.get("p1", 0.0),
    }
    body = "".join(f"  <{key}>{value}</{key}>\n" for key, value in fields.items())
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n{body}</calibration>\n', notes + left_out(camera)


class _Calibrations:
    """What the parser calls: gathers the elements of each calibration, and its size."""

    def __init__(self) -> None:
        self.all: list[dict[str, Any]] = []
        self.open: dict[str, Any] | None = None
        self.words: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.words = []
        if tag == "calibration":
            # Attributes of cameras.xml; `type` is what a file by itself calls `projection`.
            self.open = {"projection": attributes.get("type"), "class": attributes.get("class")}
            self.all.append(self.open)
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
                raise ValueError(f"a second {tag[:30]!r}")
            self.open[tag] = scalar(text)
        self.words = []

    def close(self) -> None: ...


def _camera(given: Mapping[str, Any]) -> Camera:
    size = picture_size(given.get("width"), given.get("height"))
    extra = note_unknown(given, {"projection", "class", "width", "height", *NUMBERS})
    kind = given.get("projection")
    if kind == "spherical":
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    v = {name: number(given.get(name, 0.0), name) for name in NUMBERS if name != "f"}
    v["f"] = number(given.get("f"), "f")
    plane = {
        "fx": v["f"] + v["b1"],
        "fy": v["f"],
        "cx": size[0] / 2 + v["cx"] - SHIFT,
        "cy": size[1] / 2 + v["cy"] - SHIFT,
    }
    k = {name: v[name] for name in RADIAL}
    p = {"p1": v["p2"], "p2": v["p1"]}
    unheld = {name: v[name] for name in ("p3", "p4") if v[name]}
    plain = not any((*k.values(), *p.values()))
    if kind == "frame" and plain:
        model = build("pinhole", plane | {"skew": v["b2"]})
    elif kind == "frame":
        unheld |= {name: v[name] for name in ("k4", "b2") if v[name]}
        model = build("radial_tangential", plane | {name: k[name] for name in ("k1", "k2", "k3")} | p)
    elif kind in FISHEYE:
        unheld |= {"b2": v["b2"]} if v["b2"] else {}
        prism = any(p.values())
        own = k | p | {"s1": 0.0, "s2": 0.0} if prism else k
        model = build("thin_prism_fisheye" if prism else "kannala_brandt", plane | own)
    elif kind == "equisolid_fisheye" and plain:
        unheld |= {"b2": v["b2"]} if v["b2"] else {}
        model = build("equisolid", plane)
    else:
        said = "with coefficients " if kind == "equisolid_fisheye" else ""
        known = "frame, fisheye, equisolid_fisheye without coefficients, spherical"
        raise ValueError(f"no projection {str(kind)[:40]!r} {said}of ours; there are {known}")
    if unheld:
        said = ", ".join(f"{name} = {value:g}" for name, value in unheld.items())
        raise ValueError(f"{kind} with {said} is none of our models; calibrate with these fixed at 0")
    return Camera(model, size, extra=extra)
