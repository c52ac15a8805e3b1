"""The profile of a mirror as a DXF file (AutoCAD R12), which drawing and machining programs read."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from omnisight.optics.design.description import describe_lens, describe_shape, surface_equation
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance

# Points of the profile from one rim to the other; the sagitta of a segment is about a 10000th of the sag of the rim.
PROFILE_POINTS = 401
# Layers and their colours by AutoCAD's index.
LAYERS = {"MIRROR": 7, "AXIS": 8, "LENS": 5, "VIEWPOINT": 1, "TEXT": 7}
Tags = list[tuple[int, str]]


def mirror_dxf(design: MirrorDesign, performance: Performance) -> str:
    """Return the axial section of a mirror in millimetres, with the vertex at the origin and y the sag.

    The layers are the profile, the axis, the centre of the lens, the (best) viewpoint, and notes.
    """
    mirror = design.mirror
    rim, hole, distance = 1e3 * mirror.rim, 1e3 * mirror.hole, 1e3 * design.distance
    viewpoint = 1e3 * (float(performance.viewpoint.point[2]) - design.distance)
    top, size = 1e3 * float(mirror.sag(mirror.rim)), rim / 12
    entities = [_line((0, -1.1 * distance), (0, top + rim / 2), "AXIS")]
    entities += [_polyline(part, "MIRROR") for part in _profile(design, hole, rim)]
    entities += [_point((0, -distance), "LENS"), _point((0, viewpoint), "VIEWPOINT")]
    notes = [
        f"{design.specification.kind} mirror, dimensions in mm",
        describe_shape(design),
        surface_equation(design).replace("ρ", "rho").replace("²", "^2").replace("·", "*").replace("√", "sqrt"),
        f"rim diameter {2 * rim:.6g}, hole diameter {2 * hole:.6g}, sag of the rim {top:.6g}",
        f"lens: {describe_lens(design)}",
        f"viewpoint at y = {viewpoint:.6g}",
    ]
    entities += [_text(note, (1.2 * rim, top - 2 * size * i), size) for i, note in enumerate(notes)]
    return _document(entities)


def _profile(design: MirrorDesign, hole: float, rim: float) -> list[np.ndarray]:
    """Return the profile (N, 2), mm: one line, or one on each side of the hole."""
    sides = [(-rim, rim)] if hole == 0 else [(-rim, -hole), (hole, rim)]
    lines = [np.linspace(first, last, PROFILE_POINTS) for first, last in sides]
    return [np.stack([x, 1e3 * design.mirror.sag(np.abs(x) / 1e3)], -1) for x in lines]


def _document(entities: Sequence[Tags]) -> str:
    layers: Tags = []
    for name, color in LAYERS.items():
        layers += [(0, "LAYER"), (2, name), (70, "0"), (62, str(color)), (6, "CONTINUOUS")]
    table = [(0, "TABLE"), (2, "LAYER"), (70, str(len(LAYERS))), *layers, (0, "ENDTAB")]
    linetype = [(0, "LTYPE"), (2, "CONTINUOUS"), (70, "0"), (3, "solid"), (72, "65"), (73, "0"), (40, "0.0")]
    linetypes = [(0, "TABLE"), (2, "LTYPE"), (70, "1"), *linetype, (0, "ENDTAB")]
    tags: Tags = [(999, "omnisight; unit: mm")]
    tags += _section("HEADER", [(9, "$ACADVER"), (1, "AC1009"), (9, "$MEASUREMENT"), (70, "1")])
    tags += _section("TABLES", [*linetypes, *table])
    tags += _section("ENTITIES", [tag for entity in entities for tag in entity])
    return "".join(f"{code:>3}\n{value}\n" for code, value in [*tags, (0, "EOF")])


def _section(name: str, content: Iterable[tuple[int, str]]) -> Tags:
    return [(0, "SECTION"), (2, name), *content, (0, "ENDSEC")]


def _entity(kind: str, layer: str) -> Tags:
    return [(0, kind), (8, layer)]


def _at(point: ArrayLike, code: int = 10) -> Tags:
    x, y = np.asarray(point, float)
    return [(code, f"{x:.9g}"), (code + 10, f"{y:.9g}"), (code + 20, "0.0")]


def _line(start: ArrayLike, end: ArrayLike, layer: str) -> Tags:
    return [*_entity("LINE", layer), *_at(start), *_at(end, 11)]


def _point(point: ArrayLike, layer: str) -> Tags:
    return [*_entity("POINT", layer), *_at(point)]


def _polyline(points: np.ndarray, layer: str) -> Tags:
    vertices = [tag for point in points for tag in [*_entity("VERTEX", layer), *_at(point)]]
    return [*_entity("POLYLINE", layer), (66, "1"), *_at((0, 0)), (70, "0"), *vertices, *_entity("SEQEND", layer)]


def _text(text: str, point: ArrayLike, height: float) -> Tags:
    return [*_entity("TEXT", "TEXT"), *_at(point), (40, f"{height:.6g}"), (1, text)]
