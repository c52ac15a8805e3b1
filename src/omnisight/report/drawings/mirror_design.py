"""Draws a mirror camera: its cross section with rays, and how finely it shows elevations."""

import numpy as np
from numpy.typing import NDArray

from omnisight.cli._design_report import field_said, lens_said, shape_said
from omnisight.optics.caustic import caustic
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance
from omnisight.optics.design.shapes import KINDS
from omnisight.report.axes import Axes
from omnisight.report.drawings.cross_section import Section, legend, paper
from omnisight.report.html import Markup, element, together

Array = NDArray[np.float64]

WIDTH, HEIGHT = 980.0, 664.0
BOX = (20.0, 84.0, 600.0, 644.0)
# px that the drawing leaves above the mirror, and below the lens for its camera.
ABOVE, BELOW = 64.0, 118.0
CHART = (672.0, 132.0, 950.0, 480.0)
RAYS = 5


def draw_design(design: MirrorDesign, shown: Performance) -> str:
    """Give the SVG."""
    title = f"{design.specification.kind.capitalize()} mirror, {field_said(design, shown)}"
    return paper(
        element("text", title, x=20.0, y=30.0, class_="title"),
        element("text", f"mirror: {shape_said(design)}", x=20.0, y=51.0, class_="small"),
        element("text", f"lens: {lens_said(design)}", x=20.0, y=69.0, class_="small"),
        _cross_section(design, shown),
        _chart(design, shown),
        width=WIDTH,
        height=HEIGHT,
        said=f"Cross section of a mirror camera: {KINDS[design.specification.kind].description}; {field_said(design, shown)}.",
    )


def _cross_section(design: MirrorDesign, shown: Performance) -> Markup:
    rim, body = 1e3 * design.mirror.rim, 1e3 * design.specification.body
    distance = 1e3 * design.distance
    top = distance + 1e3 * float(design.mirror.sag(design.mirror.rim))
    viewpoint = 1e3 * shown.viewpoint.point[[0, 2]]
    parallel = design.focal is None
    wide = max(2 * rim, body) if parallel else body
    left, upper, right, lower = BOX
    highest = max(top, float(viewpoint[1]))
    scale = min((lower - upper - ABOVE - BELOW) / highest, (right - left) / (4.2 * rim))
    section = Section((0.0, (highest - (BELOW - ABOVE) / scale) / 2), scale, BOX)
    rho = np.linspace(-rim, rim, 240)
    surface = np.stack([rho, distance + 1e3 * design.mirror.sag(np.abs(rho) / 1e3)], -1)
    rays, virtual = _rays(design, shown, section)
    beside = -max(rim, wide / 2)
    label = "viewpoint" if design.central else "best viewpoint"
    return together(
        section.inside(
            *_field(design, shown, section),
            section.line([(0, -1e3), (0, 1e3)], "axis"),
            section.line(section.reach([viewpoint] * 2, [(-1, 0), (1, 0)]), "guide"),
            *virtual,
            *rays,
        ),
        section.camera(wide, 2 * rim if parallel else 0.6 * body),
        *_caustic(design, shown, section),
        section.mirror(surface),
        section.dot((0, 0), "lens-dot", 3.5) if not parallel else None,
        section.dot(viewpoint),
        *_angles(design, shown, section, viewpoint),
        section.dimension([(-rim, top), (rim, top)], f"{2 * rim:.4g} mm", (0, -34), beside="above"),
        section.dimension([(beside, 0), (beside, distance)], f"{distance:.4g} mm", (-26, 0), beside="left"),
        section.text(label, viewpoint, (0, -13 if design.central else 21), "middle", "view"),
    )


def _rays(design: MirrorDesign, shown: Performance, section: Section) -> tuple[list[Markup], list[Markup]]:
    """Draw some rays to either side, evenly over the field, and where they seem to come from."""
    rays, virtual = list[Markup](), list[Markup]()
    for side in (-1, 1):
        corners, away = _traced(design, shown, RAYS, side)
        for corner, direction in zip(corners, away, strict=True):
            start = np.array([0.0 if design.focal else corner[0], 0.0])
            # Back to where the ray meets the axis, as the others do, there or nearby.
            axis = corner - corner[0] / direction[0] * direction
            rays.append(section.line(np.stack([start, corner, section.reach(corner, direction)]), "ray"))
            virtual.append(section.line(np.stack([corner, axis]), "virtual"))
    return rays, virtual


def _caustic(design: MirrorDesign, shown: Performance, section: Section) -> list[Markup]:
    """Draw what the rays touch where they have no point in common, to either side."""
    if design.central:
        return []
    u, v = design.centre
    radii = shown.resolution.radius
    sides = [np.stack([u + side * radii, np.full_like(radii, v)], -1) for side in (-1, 1)]
    sheets = [1e3 * caustic(design.system(), pixels).tangential[:, [0, 2]] for pixels in sides]
    if max(float(np.ptp(sheet, axis=0).max()) for sheet in sheets) * section.scale < 1:  # of a cone, a circle
        return [section.dot(sheet[0], "caustic-dot", 3.5) for sheet in sheets]
    return [section.line(sheet, "caustic") for sheet in sheets]


def _traced(design: MirrorDesign, shown: Performance, count: int, side: int) -> tuple[Array, Array]:
    """Give where (N, 2) rays leave the mirror, mm, and their directions, evenly from the blind spot to the rim."""
    theta = np.linspace(shown.blind.theta, design.specification.theta, count)
    radii = np.clip(shown.resolution.at(theta).radius, shown.resolution.radius[0], shown.resolution.radius[-1])
    u, v = design.centre
    origins, bearings, _ = design.system().rays(np.stack([u + side * radii, np.full(count, v)], -1))
    return 1e3 * origins[:, [0, 2]], bearings[:, [0, 2]]


def _field(design: MirrorDesign, shown: Performance, section: Section) -> list[Markup]:
    """Fill what is seen, and below the mirror what the camera hides."""
    parts = list[Markup]()
    edges = list[Array]()
    for side in (-1, 1):
        corners, away = _traced(design, shown, 48, side)
        parts.append(section.area([*corners, *section.reach(corners, away)[::-1]], "field"))
        turn = np.linspace(side * shown.blind.theta, 0, 24)
        edges += [corners[:1], section.reach(corners[0], np.stack([np.sin(turn), -np.cos(turn)], -1))]
    left, far_left, right, far_right = edges
    return [*parts, section.area([*left, *far_left, *far_right[::-1], *right], "blind")]


def _angles(design: MirrorDesign, shown: Performance, section: Section, viewpoint: Array) -> list[Markup]:
    """Mark the angles up and down, and the blind one."""
    up, down, hidden = design.specification.up, np.pi / 2 - shown.blind.theta, shown.blind.theta
    right, bottom = section.box[2:]
    x, y = map(float, section.at(viewpoint))
    reach = right - x
    room = (y - section.box[1] - 4) / np.sin(up) if up > 0 else np.inf
    outer = min(0.80 * reach, float(room))
    parts = [
        section.arc(viewpoint, outer, np.pi / 2, np.pi / 2 + up),
        section.arc(viewpoint, 0.70 * reach, np.pi / 2, np.pi / 2 - down),
        _words(f"{abs(np.degrees(up)):.0f}° {'up' if up > 0 else 'down'}", x, y, outer + 8, np.pi / 2 + up / 2),
        _words(f"{np.degrees(down):.0f}° down", x, y, 0.70 * reach + 8, np.pi / 2 - 0.35 * down),
        element("text", "horizon", x=section.box[0] + 5, y=y - 6, class_="on small"),
        element("text", f"blind {np.degrees(hidden):.0f}°", x=x, y=bottom - 8, text_anchor="middle", class_="on"),
    ]
    return parts


def _words(words: str, x: float, y: float, radius: float, turn: float) -> Markup:
    return element(
        "text", words, x=x + radius * float(np.sin(turn)), y=y + radius * float(np.cos(turn)) + 4, class_="on"
    )


def _chart(design: MirrorDesign, shown: Performance) -> Markup:
    r = shown.resolution
    elevation = np.degrees(r.theta) - 90
    up, around = np.radians(r.up), np.radians(r.around)
    axes = Axes(
        (float(elevation.min()), float(elevation.max())),
        (0.0, 1.1 * float(max(up.max(), around.max()))),
        "elevation, degrees",
        "px per degree",
        CHART,
    )
    left, top = CHART[:2]
    turned = f"rotate(-90 {left - 40:g} {(top + CHART[3]) / 2:g})"
    frame = Axes(axes.x, axes.y, axes.x_label, "", CHART).frame()
    return together(
        element("text", "How finely it sees", x=left - 34, y=top - 18, class_="title"),
        frame,
        axes.inside(axes.line(elevation, around, "around"), axes.line(elevation, up, "up")),
        element(
            "text",
            axes.y_label,
            x=left - 40,
            y=(top + CHART[3]) / 2,
            text_anchor="middle",
            transform=turned,
            class_="small",
        ),
        legend([("line up", "up and down"), ("line around", "around")], (left + 14, top + 22)),
        _facts(design, shown, (left - 34, CHART[3] + 70)),
    )


def _facts(design: MirrorDesign, shown: Performance, at: tuple[float, float]) -> Markup:
    """List the few numbers that are asked for first."""
    x, y = at
    order = design.specification
    lines = [
        f"sensor {order.size[0]} x {order.size[1]} px of {order.pixel * 1e6:.4g} µm",
        f"image of the mirror {2 * design.circle:.0f} px across",
        f"blind spot {2 * shown.blind.radius:.0f} px across",
    ]
    if design.central:
        lines.append(f"unified model: xi {design.model().xi:.5g}, gamma {design.model().fy:.1f} px")
    else:
        lines.append("red: the caustic, that all rays touch")
        lines.append(f"rays pass the best viewpoint at {1e3 * shown.viewpoint.rms:.2g} mm rms")
    return together(*(element("text", line, x=x, y=y + 20 * i, class_="small") for i, line in enumerate(lines)))
