"""Drawing of a mirror camera: its cross section with rays, and its resolution over the elevation."""

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.caustic import caustic
from omnisight.optics.design.description import describe_field, describe_lens, describe_shape
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance
from omnisight.optics.design.shapes import KINDS
from omnisight.report.axes import Axes, legend, nice_floor
from omnisight.report.drawings.cross_section import CrossSection, svg_document
from omnisight.report.drawings.title_block import scale_bar, surface_table, title_block, tolerance_table
from omnisight.report.html import Markup, element, join

Array = NDArray[np.float64]

# A4, landscape, with 4 units per mm; the frame leaves the margin that printers need.
UNITS_PER_MM = 4.0
WIDTH, HEIGHT = 297 * UNITS_PER_MM, 210 * UNITS_PER_MM
SECTION_BOX, CHART_BOX = (36.0, 100.0, 630.0, 800.0), (728.0, 122.0, 1148.0, 290.0)
TEXT_LEFT, TOLERANCE_LEFT, TABLE_TOP = 694.0, 958.0, 468.0
TITLE_BOX = (688.0, 704.0, 1152.0, 804.0)
# Scales of engineering drawings (ISO 5455), as millimetres of the drawing per millimetre.
SCALES = {f"{n}:1": float(n) for n in (50, 20, 10, 5, 2, 1)} | {
    f"1:{n}": 1 / n for n in (2, 5, 10, 20, 50, 100, 200, 500, 1000)
}
# Space above the mirror for its dimension, and below the lens for the camera, in units of the drawing.
SPACE_ABOVE, SPACE_BELOW = 64.0, 118.0
NUM_RAYS = 5
# A caustic that is smaller, in units of the drawing, is drawn as a dot.
MIN_CAUSTIC_SIZE = 1


def draw_design(design: MirrorDesign, performance: Performance) -> str:
    """Return the drawing as an SVG document."""
    title = f"{design.specification.kind.capitalize()} mirror, {describe_field(design, performance)}"
    kind = KINDS[design.specification.kind].description
    scale, section = _scaled_section(design, performance)
    return svg_document(
        element("rect", x=20.0, y=20.0, width=WIDTH - 40, height=HEIGHT - 40, class_="block"),
        element("text", title, x=36.0, y=50.0, class_="title"),
        element("text", f"mirror: {describe_shape(design)}", x=36.0, y=71.0, class_="small"),
        element("text", f"lens: {describe_lens(design)}", x=36.0, y=89.0, class_="small"),
        _cross_section(design, performance, section),
        scale_bar(section, nice_floor(120 / section.scale), (SECTION_BOX[0] + 8, SECTION_BOX[3] - 8)),
        _chart(design, performance),
        surface_table(design, (TEXT_LEFT, TABLE_TOP)),
        tolerance_table(design, performance, (TOLERANCE_LEFT, TABLE_TOP)),
        title_block(design, scale, TITLE_BOX),
        width=WIDTH,
        height=HEIGHT,
        units_per_mm=UNITS_PER_MM,
        title=f"Cross section of a mirror camera: {kind}; {describe_field(design, performance)}.",
    )


def _scaled_section(design: MirrorDesign, performance: Performance) -> tuple[str, CrossSection]:
    """Return the largest standard scale at which mirror, lens and viewpoint fit, and the section at that scale."""
    rim, distance = 1e3 * design.mirror.rim, 1e3 * design.distance
    highest = max(
        distance + 1e3 * float(design.mirror.sag(design.mirror.rim)), 1e3 * float(performance.viewpoint.point[2])
    )
    left, upper, right, lower = SECTION_BOX
    largest = min((lower - upper - SPACE_ABOVE - SPACE_BELOW) / highest, (right - left) / (4.2 * rim))
    name, ratio = next(
        ((name, ratio) for name, ratio in SCALES.items() if ratio * UNITS_PER_MM <= largest), list(SCALES.items())[-1]
    )
    scale = ratio * UNITS_PER_MM
    return name, CrossSection((0.0, (highest - (SPACE_BELOW - SPACE_ABOVE) / scale) / 2), scale, SECTION_BOX)


def _cross_section(design: MirrorDesign, performance: Performance, section: CrossSection) -> Markup:
    rim, body = 1e3 * design.mirror.rim, 1e3 * design.specification.body
    distance = 1e3 * design.distance
    top = distance + 1e3 * float(design.mirror.sag(design.mirror.rim))
    viewpoint = 1e3 * performance.viewpoint.point[[0, 2]]
    telecentric = design.focal is None
    camera_width = max(2 * rim, body) if telecentric else body
    rays, virtual = _rays(design, performance, section)
    dimension_x = -max(rim, camera_width / 2)
    label = "viewpoint" if design.central else "best viewpoint"
    return join(
        section.clip(
            *_field(design, performance, section),
            section.line([(0, -1e3), (0, 1e3)], "axis"),
            section.line(section.extend([viewpoint] * 2, [(-1, 0), (1, 0)]), "guide"),
            *virtual,
            *rays,
        ),
        section.camera(camera_width, 2 * rim if telecentric else 0.6 * body),
        *_caustic(design, performance, section),
        *_mirror(design, section),
        section.dot((0, 0), "lens-dot", 3.5) if not telecentric else None,
        section.dot(viewpoint),
        *_angles(design, performance, section, viewpoint),
        section.dimension([(-rim, top), (rim, top)], f"{2 * rim:.4g} mm", (0, -34), side="above"),
        section.dimension([(dimension_x, 0), (dimension_x, distance)], f"{distance:.4g} mm", (-26, 0), side="left"),
        *_depth_dimensions(design, section, float(viewpoint[1])),
        section.text(label, viewpoint, (0, -13 if design.central else 21), "middle", "view"),
    )


def _mirror(design: MirrorDesign, section: CrossSection) -> list[Markup]:
    """Draw the mirror on both sides of its hole."""
    rim, hole = design.mirror.rim, design.mirror.hole
    sides = [(-rim, rim)] if hole == 0 else [(-rim, -hole), (hole, rim)]
    profiles = [np.linspace(first, last, 240) for first, last in sides]
    return [
        section.mirror(1e3 * np.stack([rho, design.distance + design.mirror.sag(np.abs(rho))], -1)) for rho in profiles
    ]


def _depth_dimensions(design: MirrorDesign, section: CrossSection, viewpoint: float) -> list[Markup]:
    """Draw the dimensions of the rim's depth, of the viewpoint and of the hole, from the vertex."""
    mirror, vertex = design.mirror, 1e3 * design.distance
    rim, hole, depth = 1e3 * mirror.rim, 1e3 * mirror.hole, 1e3 * float(mirror.sag(mirror.rim))
    parts = [
        section.dimension([(rim, vertex + depth), (rim, vertex)], f"{depth:.4g} mm", (26, 0), side="right"),
        section.dimension(
            [(-rim, vertex), (-rim, viewpoint)], f"{abs(viewpoint - vertex):.4g} mm", (-26, 0), side="left"
        ),
    ]
    if hole:
        parts.append(
            section.dimension([(-hole, vertex), (hole, vertex)], f"hole {2 * hole:.4g} mm", (0, 30), side="above")
        )
    return parts


def _rays(design: MirrorDesign, performance: Performance, section: CrossSection) -> tuple[list[Markup], list[Markup]]:
    """Draw rays on both sides, evenly over the field, and their extensions to the axis."""
    rays, virtual = list[Markup](), list[Markup]()
    for side in (-1, 1):
        points, directions = _trace(design, performance, NUM_RAYS, side)
        for point, direction in zip(points, directions, strict=True):
            start = np.array([0.0 if design.focal else point[0], 0.0])
            axis = point - point[0] / direction[0] * direction
            rays.append(section.line(np.stack([start, point, section.extend(point, direction)]), "ray"))
            virtual.append(section.line(np.stack([point, axis]), "virtual"))
    return rays, virtual


def _caustic(design: MirrorDesign, performance: Performance, section: CrossSection) -> list[Markup]:
    """Draw the caustic that the rays of a non-central design are tangent to."""
    if design.central:
        return []
    u, v = design.centre
    radii = performance.resolution.radius
    sides = [np.stack([u + side * radii, np.full_like(radii, v)], -1) for side in (-1, 1)]
    sheets = [1e3 * caustic(design.system(), pixels).tangential[:, [0, 2]] for pixels in sides]
    if max(float(np.ptp(sheet, axis=0).max()) for sheet in sheets) * section.scale < MIN_CAUSTIC_SIZE:
        return [section.dot(sheet[0], "caustic-dot", 3.5) for sheet in sheets]
    return [section.line(sheet, "caustic") for sheet in sheets]


def _trace(design: MirrorDesign, performance: Performance, count: int, side: int) -> tuple[Array, Array]:
    """Return the origins (N, 2) of rays on the mirror, mm, and their directions, evenly from blind spot to rim."""
    theta = np.linspace(performance.blind.theta, design.specification.theta, count)
    radii = np.clip(
        performance.resolution.at(theta).radius, performance.resolution.radius[0], performance.resolution.radius[-1]
    )
    u, v = design.centre
    origins, bearings, _ = design.system().rays(np.stack([u + side * radii, np.full(count, v)], -1))
    return 1e3 * origins[:, [0, 2]], bearings[:, [0, 2]]


def _field(design: MirrorDesign, performance: Performance, section: CrossSection) -> list[Markup]:
    """Fill the field of view, and the blind spot that the camera occludes."""
    parts = list[Markup]()
    edges = list[Array]()
    for side in (-1, 1):
        points, directions = _trace(design, performance, 48, side)
        parts.append(section.area([*points, *section.extend(points, directions)[::-1]], "field"))
        angles = np.linspace(side * performance.blind.theta, 0, 24)
        edges += [points[:1], section.extend(points[0], np.stack([np.sin(angles), -np.cos(angles)], -1))]
    left, far_left, right, far_right = edges
    return [*parts, section.area([*left, *far_left, *far_right[::-1], *right], "blind")]


def _angles(design: MirrorDesign, performance: Performance, section: CrossSection, viewpoint: Array) -> list[Markup]:
    """Draw the angles of the field above and below the horizon, and of the blind spot."""
    up, down, blind = design.specification.up, np.pi / 2 - performance.blind.theta, performance.blind.theta
    right, bottom = section.box[2:]
    x, y = map(float, section.positions(viewpoint))
    width = right - x
    max_radius = (y - section.box[1] - 4) / np.sin(up) if up > 0 else np.inf
    outer = min(0.80 * width, float(max_radius))
    parts = [
        section.arc(viewpoint, outer, np.pi / 2, np.pi / 2 + up),
        section.arc(viewpoint, 0.70 * width, np.pi / 2, np.pi / 2 - down),
        _angle_label(f"{abs(np.degrees(up)):.0f}° {'up' if up > 0 else 'down'}", x, y, outer + 8, np.pi / 2 + up / 2),
        _angle_label(f"{np.degrees(down):.0f}° down", x, y, 0.70 * width + 8, np.pi / 2 - 0.35 * down),
        element("text", "horizon", x=section.box[0] + 5, y=y - 6, class_="on small"),
        element("text", f"blind {np.degrees(blind):.0f}°", x=x, y=bottom - 8, text_anchor="middle", class_="on"),
    ]
    return parts


def _angle_label(text: str, x: float, y: float, radius: float, angle: float) -> Markup:
    return element(
        "text", text, x=x + radius * float(np.sin(angle)), y=y + radius * float(np.cos(angle)) + 4, class_="on"
    )


def _chart(design: MirrorDesign, performance: Performance) -> Markup:
    resolution = performance.resolution
    elevation = np.degrees(resolution.theta) - 90
    up, around = np.radians(resolution.up), np.radians(resolution.around)
    axes = Axes(
        (float(elevation.min()), float(elevation.max())),
        (0.0, 1.1 * float(max(up.max(), around.max()))),
        "elevation, degrees",
        "px per degree",
        CHART_BOX,
    )
    left, top, _, bottom = CHART_BOX
    return join(
        element("text", "Resolution", x=left - 34, y=top - 18, class_="title"),
        axes.frame(),
        axes.clip(axes.line(elevation, around, "around"), axes.line(elevation, up, "up")),
        legend([("line up", "vertical"), ("line around", "horizontal")], (left + 14, top + 18), (0.0, 19.0)),
        _key_figures(design, performance, (left - 34, bottom + 62)),
    )


def _key_figures(design: MirrorDesign, performance: Performance, position: tuple[float, float]) -> Markup:
    """List the key figures."""
    x, y = position
    specification = design.specification
    lines = [
        f"sensor {specification.size[0]} x {specification.size[1]} px of {specification.pixel * 1e6:.4g} µm",
        f"image of the mirror {2 * design.circle:.0f} px across",
        f"blind spot {2 * performance.blind.radius:.0f} px across",
    ]
    if design.central:
        lines.append(f"unified model: xi {design.model().xi:.5g}, gamma {design.model().fy:.1f} px")
    else:
        lines.append("red: caustic, tangent to all rays")
        lines.append(f"rms distance of rays from the best viewpoint {1e3 * performance.viewpoint.rms:.2g} mm")
    return join(*(element("text", line, x=x, y=y + 20 * i, class_="small") for i, line in enumerate(lines)))
