"""The yaml of MultiCol-SLAM, the LaFiDa data set and CubemapSLAM: Scaramuzza's model under flat names.

The polynomial a0 ... a4 has OCamCalib's sign (a0 < 0: its z points back), in px^(1-i); pol0 ... is the inverse
polynomial in atan(z/r), radians, lowest first. u0 is x, and the stretch [c d; e 1] acts on x, y, as
`cCamModelGeneral_::WorldToImg` has it, and not on row, column as in OCamCalib. Integer pixel = pixel centre.
"""

import re
from collections.abc import Mapping
from typing import cast

from omnisight.camera import Camera
from omnisight.formats._checks import left_out, number, picture_size, refuse, with_size
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
from omnisight.models.ocam import Ocam

TITLE = "MultiCol-SLAM yaml"
SUFFIX = ".yaml"
MODELS = ("ocam",)
CONVENTION = "z back, so a0 < 0; u0 is x; the stretch [c d; e 1] acts on x, y; integer pixel = pixel centre"
FIRST = re.compile(r"^Camera\.a0[ \t]*:", re.MULTILINE)
PLANE = {"c": "Camera.c", "d": "Camera.d", "e": "Camera.e", "cx": "Camera.u0", "cy": "Camera.v0"}
MOST = 40  # coefficients


def matches(text: str) -> bool:
    """Say whether a line begins with `Camera.a0:`."""
    return FIRST.search(text[:1_000_000]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    size = picture_size(data.get("Camera.Iw"), data.get("Camera.Ih"))
    counts = [number(data.get(name), name) for name in ("Camera.nrpol", "Camera.nrinvpol")]
    if any(count != int(count) or not 1 <= count <= MOST for count in counts):
        raise ValueError(f"Camera.nrpol and Camera.nrinvpol must be counts from 1 to {MOST}, got {counts}")
    direct = [number(data.get(f"Camera.a{i}"), f"Camera.a{i}") for i in range(int(counts[0]))]
    if not direct[0] < 0:
        raise ValueError(f"Camera.a0 must be negative (z points back), got {direct[0]:g}")
    plane = {ours: number(data.get(theirs), theirs) for ours, theirs in PLANE.items()}
    used = {"Camera.Iw", "Camera.Ih", "Camera.nrpol", "Camera.nrinvpol", *PLANE.values()}
    used |= {f"Camera.a{i}" for i in range(len(direct))} | {f"Camera.pol{i}" for i in range(int(counts[1]))}
    model = model_of_xy([-value for value in direct], **plane)
    return {"camera": Camera(model, size, extra=note_unknown(data, used))}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with an inverse polynomial fitted anew."""
    refuse(camera, MODELS, "convert it with --model ocam")
    size = with_size(camera)
    camera, notes = of_degree_four(camera)
    model = cast(Ocam, camera.model)
    direct, c, d, e = xy_of_model(model)
    plane = {"c": c, "d": d, "e": e, "cx": model.cx, "cy": model.cy}
    model_of_xy(direct, **plane)
    inverse, error = inverse_polynomial(model, picture_radius(model, size), scale=model.c)
    if error > INVERSE_PX:
        notes += (f"the inverse polynomial is {error:.2g} px off at most: programs that project with it are, too",)
    lines = ["%YAML:1.0", "", f"Camera.Iw: {size[0]}", f"Camera.Ih: {size[1]}", ""]
    lines += [f"Camera.nrpol: {TERMS}", f"Camera.nrinvpol: {len(inverse)}", ""]
    lines += [f"Camera.a{i}: {flow(0.0 - value)}" for i, value in enumerate(direct)]
    lines += [f"Camera.pol{i}: {flow(value)}" for i, value in enumerate(inverse)]
    lines += [f"{theirs}: {flow(float(plane[ours]))}" for ours, theirs in PLANE.items()]
    lines += ["", "Camera.mirrorMask: 1"]
    return "\n".join(lines) + "\n", notes + left_out(camera, ("Camera.mirrorMask",))
