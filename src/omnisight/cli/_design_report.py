"""What `omnisight design mirror` says."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance, Resolution
from omnisight.optics.design.shapes import KINDS
from omnisight.optics.mirrors.conic import Conic

Array = NDArray[np.float64]

# Elevations in the table are multiples of so many degrees, beside the ends of the field.
STEP = 10.0


def print_report(design: MirrorDesign, shown: Performance) -> None:
    """Print the parts, the field, the resolution and what a misplaced mirror costs."""
    from rich.table import Table

    from omnisight.cli._console import console

    for name, said in facts(design, shown):
        print(f"{name:<12}{said}")
    out = console()
    table = Table(title="how finely elevations are shown", title_justify="left")
    for column in ("elevation", "radius px", "px/degree up", "px/degree around"):
        table.add_column(column, justify="right")
    at = resolution_table(design, shown)
    for theta, *rest in zip(at.theta, at.radius, np.radians(at.up), np.radians(at.around), strict=True):
        table.add_row(f"{np.degrees(theta) - 90:.0f}°", f"{rest[0]:.1f}", f"{rest[1]:.2f}", f"{rest[2]:.2f}")
    out.print(table)
    distance = _length(design.specification.working_distance)
    table = Table(title=f"what a mirror out of its place costs, for things {distance} away", title_justify="left")
    for column in ("mirror", "rays pass the viewpoint, rms", "worst", "parallax px, rms", "worst", "image moves px"):
        table.add_column(column, justify="left" if column == "mirror" else "right")
    for row in shown.misalignments:
        px = (f"{v:.3f}" for v in (row.rms_px, row.worst_px))
        table.add_row(row.description, _length(row.rms), _length(row.worst), *px, f"{row.moved_px:.1f}")
    out.print(table)
    print("Calibration finds how the image moves; the parallax is what a central camera model leaves after it.")


def facts(design: MirrorDesign, shown: Performance) -> list[tuple[str, str]]:
    """Give the parts and the field, in words."""
    order, mirror = design.specification, design.mirror
    rows = [("mirror", KINDS[order.kind].description), ("shape", shape_said(design))]
    half, deep = (1e3 * float(mirror.sag(rho)) for rho in (mirror.rim / 2, mirror.rim))
    rows.append(("rim", f"{_length(2 * mirror.rim)} across, {deep:.6g} mm deep; half way out {half:.6g} mm deep"))
    rows.append(("lens", lens_said(design)))
    point, spread = shown.viewpoint, f"rays pass it at {_length(shown.viewpoint.rms)} rms"
    behind = point.point[2] - design.distance
    place = f"{_length(abs(behind))} {'above' if behind >= 0 else 'below'} the vertex"
    rows.append(("viewpoint", f"{place}, single" if design.central else f"none; the best one {place}, {spread}"))
    rows.append(("field", f"{field_said(design, shown)}, 360 around"))
    rows.append(("blind", blind_said(shown)))
    width, height = order.size
    sensor = f"sensor {width}x{height} px of {order.pixel * 1e6:.4g} um"
    share = 200 * design.circle / min(order.size)
    rows.append(("image", f"{2 * design.circle:.0f} px across, {share:.0f} percent of the shorter side; {sensor}"))
    if design.central:
        model = design.model()
        rows.append(("model", f"unified, xi {model.xi:.6g}, gamma {model.fy:.2f} px"))
    return rows


def shape_said(design: MirrorDesign) -> str:
    """Give the numbers that the mirror is turned by."""
    mirror = design.mirror
    if not isinstance(mirror, Conic):
        return f"half angle {np.degrees(mirror.half_angle):.3f} degrees"
    radius = f"convex, radius at the vertex {1e3 * mirror.radius:.6g} mm"
    e = mirror.eccentricity
    if e <= 1:
        return radius + (f", eccentricity {e:g}, conic constant {-e * e:g}" if e else "")
    a = mirror.radius / (e * e - 1)
    axes = f"a {_length(a)}, b {_length(a * np.sqrt(e * e - 1))}, c {_length(a * e)}"
    return f"{radius}, eccentricity {e:.6g}, conic constant {-e * e:.6g} ({axes})"


def lens_said(design: MirrorDesign) -> str:
    """Say which lens, and where."""
    if design.focal is None:
        size = f"{_length(2 * design.mirror.rim)} wide, magnification {design.magnification:.4g}"
        return f"telecentric, {size}; {_length(design.distance)} from the vertex, or anywhere on the axis"
    angle = 2 * np.degrees(np.arctan(design.circle * design.specification.pixel / design.focal))
    f = f"focal length {_length(design.focal)}, {angle:.1f} degrees across the mirror"
    return f"{f}; its entrance pupil {_length(design.distance)} from the vertex"


def field_said(design: MirrorDesign, shown: Performance) -> str:
    """Say how far up and down it sees."""
    up, low = np.degrees(design.specification.up), 90 - np.degrees(shown.blind.theta)
    above = f"from {up:.1f} degrees {'above' if up >= 0 else 'below'}".replace("-", "")
    return f"{above} the horizon to {low:.1f} below it"


def blind_said(shown: Performance) -> str:
    """Say where it sees itself."""
    blind = shown.blind
    if blind.radius == 0:
        return f"{np.degrees(blind.theta):.1f} degrees around straight down, which the mirror does not show"
    return f"{np.degrees(blind.theta):.1f} degrees around straight down, {blind.radius:.0f} px: the camera itself"


def resolution_table(design: MirrorDesign, shown: Performance) -> Resolution:
    """Give the resolution from the top of the field to its bottom, at round elevations between."""
    low, high = np.degrees(shown.blind.theta) - 90, np.degrees(design.specification.up)
    first, last = np.ceil((low + 1) / STEP), np.floor((high - 1) / STEP)
    between = STEP * np.arange(last, first - 1, -1)
    return shown.resolution.at(np.radians(np.concatenate([[high], between, [low]]) + 90))


def as_json(design: MirrorDesign, shown: Performance) -> None:
    """Print the same as one JSON object, metres, degrees and px."""
    at = resolution_table(design, shown)
    mirror = design.mirror
    numbers: dict[str, Any] = {
        "kind": design.specification.kind,
        "mirror": mirror.to_dict(),
        "distance": design.distance,
        "focal": design.focal,
        "magnification": design.magnification,
        "circle_px": design.circle,
        "up_deg": float(np.degrees(design.specification.up)),
        "down_deg": float(90 - np.degrees(shown.blind.theta)),
        "blind": {"theta_deg": float(np.degrees(shown.blind.theta)), "radius_px": shown.blind.radius},
        "viewpoint": {
            "single": design.central,
            "lens_from_viewpoint": shown.viewpoint.point.tolist(),
            "rms": shown.viewpoint.rms,
            "worst": shown.viewpoint.worst,
        },
        "model": {"name": "unified", **design.model().to_dict()} if design.central else None,
        "resolution": [
            {
                "elevation_deg": float(np.degrees(theta) - 90),
                "radius_px": float(radius),
                "px_per_degree_up": float(np.radians(up)),
                "px_per_degree_around": float(np.radians(around)),
            }
            for theta, radius, up, around in zip(at.theta, at.radius, at.up, at.around, strict=True)
        ],
        "working_distance": design.specification.working_distance,
        "misalignments": [vars(row) for row in shown.misalignments],
    }
    print(json.dumps(numbers))


def _length(metres: float) -> str:
    """Write a length so that it can be read."""
    if abs(metres) < 5e-10:
        return "0"
    if abs(metres) < 1e-3:
        return f"{metres * 1e6:.3g} um"
    return f"{metres * 1e3:.4g} mm" if abs(metres) < 1 else f"{metres:.4g} m"
