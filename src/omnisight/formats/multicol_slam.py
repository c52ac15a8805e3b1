"""The yaml of MultiCol-SLAM, the LaFiDa data set and CubemapSLAM: Scaramuzza's model under flat names.

The polynomial a0 ... a4 has OCamCalib's sign (a0 < 0: its z points back), in px^(1-i); pol0 ... is the inverse
polynomial in atan(z/r), radians, lowest first. u0 is x, and the stretch [c d; e 1] acts on x, y, as
`cCamModelGeneral_::WorldToImg` has it, not on row, column as in OCamCalib. Integer pixel = pixel centre.
"""

from collections.abc import Mapping

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import unknown_fields
from omnisight.formats._limits import MAX_INVERSE_TERMS
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import FIXED_TERMS, export_xy, model_of_xy
from omnisight.formats._values import image_size, number
from omnisight.formats._yaml import flow, read_map

TITLE = "MultiCol-SLAM yaml"
SUFFIX = ".yaml"
MODELS = ("ocam",)
CONVENTION = "z back, so a0 < 0; u0 is x; the stretch [c d; e 1] acts on x, y; integer pixel = pixel centre"
PLANE = {"c": "Camera.c", "d": "Camera.d", "e": "Camera.e", "cx": "Camera.u0", "cy": "Camera.v0"}
COUNTS = ("Camera.nrpol", "Camera.nrinvpol")
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether a line begins with `Camera.a0:`."""
    return has_lines(text, r"Camera\.a0")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    size = image_size(data.get("Camera.Iw"), data.get("Camera.Ih"))
    counts = [number(data.get(name), name) for name in COUNTS]
    if any(count != int(count) or not 1 <= count <= MAX_INVERSE_TERMS for count in counts):
        raise ValueError(f"{' and '.join(COUNTS)} must be counts from 1 to {MAX_INVERSE_TERMS}, got {counts}")
    direct = [number(data.get(f"Camera.a{i}"), f"Camera.a{i}") for i in range(int(counts[0]))]
    if not direct[0] < 0:
        raise ValueError(f"Camera.a0 must be negative (z points back), got {direct[0]:g}")
    plane = {ours: number(data.get(theirs), theirs) for ours, theirs in PLANE.items()}
    used = {"Camera.Iw", "Camera.Ih", *COUNTS, *PLANE.values()}
    used |= {f"Camera.a{i}" for i in range(len(direct))} | {f"Camera.pol{i}" for i in range(int(counts[1]))}
    model = model_of_xy([-value for value in direct], **plane)
    return {"camera": Camera(model, size, extra=unknown_fields(data, used))}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with a new inverse polynomial."""
    export = export_xy(camera)
    lines = ["%YAML:1.0", "", f"Camera.Iw: {export.size[0]}", f"Camera.Ih: {export.size[1]}", ""]
    lines += [f"Camera.nrpol: {FIXED_TERMS}", f"Camera.nrinvpol: {len(export.inverse)}", ""]
    lines += [f"Camera.a{i}: {flow(0.0 - value)}" for i, value in enumerate(export.direct)]
    lines += [f"Camera.pol{i}: {flow(value)}" for i, value in enumerate(export.inverse)]
    lines += [f"{theirs}: {flow(float(export.plane[ours]))}" for ours, theirs in PLANE.items()]
    lines += ["", "Camera.mirrorMask: 1"]
    return export.result("\n".join(lines) + "\n", ("Camera.mirrorMask",))
