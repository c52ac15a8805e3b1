"""Draw the SVG figures of the mirror guide by ray tracing; every run gives the same figures."""

from pathlib import Path

import numpy as np

from omnisight.models.pinhole import Pinhole
from omnisight.models.unified import Unified
from omnisight.optics import Catadioptric, PlacedMirror, Telecentric
from omnisight.optics.caustic import caustic
from omnisight.optics.design.mirror_design import design_mirror
from omnisight.optics.design.performance import evaluate_design
from omnisight.optics.design.specification import MirrorSpecification
from omnisight.optics.mirrors.conic import Conic
from omnisight.report.axes import Axes, legend
from omnisight.report.drawings.cross_section import CrossSection, svg_document
from omnisight.report.drawings.mirror_design import draw_design
from omnisight.report.html import Markup, element, join

ASSETS = Path(__file__).parent / "assets"
# The hyperbola of the chapter, mm; the lens is a + c = 66.5 mm from the vertex.
A, C, RIM = 28.0, 38.5, 34.0
FOCAL = 1000.0
PANEL = 440.0, 400.0
TITLE = 30.0


def main() -> None:
    """Write all figures."""
    ASSETS.mkdir(exist_ok=True)
    figures = {
        "mirror-viewpoints": viewpoints(),
        "mirror-conics": conics(),
        "mirror-model": model(),
        "mirror-table": table(),
        "mirror-design": design(),
    }
    for name, text in figures.items():
        (ASSETS / f"{name}.svg").write_text(text, encoding="utf-8")


def viewpoints() -> str:
    """Return figure 2 of the chapter: two cameras with a single viewpoint, and two with a caustic."""
    hyperbola = Conic.hyperbola(A, C, RIM)
    panels = (
        ("(a) Lens: all rays meet in its centre", _lens_alone),
        ("(b) Hyperboloid, lens in the far focus", lambda s: _mirror(s, hyperbola, A + C, 8)),
        ("(c) Hyperboloid, lens 35 mm too near: caustic", lambda s: _mirror(s, hyperbola, A + C - 35)),
        ("(d) Sphere: caustic for any lens position", lambda s: _mirror(s, Conic.sphere(40.0, 36.0), 66.5)),
    )
    width, height = PANEL
    drawn = list[Markup]()
    for i, (title, draw) in enumerate(panels):
        left, top = 14 + (i % 2) * (width + 18), 12 + (i // 2) * (height + TITLE + 18)
        drawn.append(element("text", title, x=left + 2, y=top + 15, class_="title"))
        section = CrossSection((0.0, 44.0), 3.2, (left, top + TITLE, left + width, top + TITLE + height))
        drawn.append(draw(section))
    entries = [("caustic", "tangential caustic: rays meet their neighbours in elevation")]
    entries += [("sagittal", "sagittal caustic, on the axis: rays meet their neighbours in azimuth")]
    foot = 12 + 2 * (height + TITLE + 18)
    return svg_document(
        *drawn,
        legend(entries, (18, foot + 10), (0.0, 19.0)),
        width=2 * width + 46,
        height=foot + 48,
        title="Rays of a lens, of a hyperbolic mirror with the lens in and out of focus, and of a spherical mirror.",
    )


def _lens_alone(section: CrossSection) -> Markup:
    angle = np.linspace(-0.65, 0.65, 13)
    ends = section.extend(np.zeros((13, 2)), np.stack([np.sin(angle), np.cos(angle)], -1))
    rays = [section.line([(0, 0), end], "ray") for end in ends]
    return join(
        section.clip(_axis(section), *rays),
        section.camera(26, 16),
        section.dot((0, 0)),
        section.text("viewpoint", (0, 0), (50, 5), class_="view"),
    )


def _mirror(section: CrossSection, mirror: Conic, distance: float, count: int = 16) -> Markup:
    """Draw rays reflected by a mirror, their extensions behind it, and the caustic."""
    system = Catadioptric(Pinhole(FOCAL, FOCAL, 0.0, 0.0), (PlacedMirror(mirror, tz=distance),))
    edge = FOCAL * mirror.rim / (distance + float(mirror.sag(mirror.rim))) * (1 - 1e-9)
    radii = np.linspace(0.06, 1, count) * edge
    radii = np.concatenate([-radii[::-1], radii])
    origins, bearings, _ = system.rays(np.stack([radii, 0 * radii], -1))
    reflections, directions = origins[:, [0, 2]], bearings[:, [0, 2]]
    outer = section.extend(reflections, directions)
    dense = np.linspace(-edge, edge, 400)
    sheets = caustic(system, np.stack([dense, 0 * dense], -1))
    tangent_points = caustic(system, np.stack([radii, 0 * radii], -1)).tangential[:, [0, 2]]
    central = np.ptp(sheets.tangential[:, 2]) < 1e-9
    parts = [_axis(section)]
    # Extend the rays of a non-central camera slightly beyond the caustic.
    excess = 0.0 if central else 0.12
    for reflection, end, far in zip(reflections, tangent_points, outer, strict=True):
        parts.append(
            section.line([reflection, end + excess * (end - reflection)], "virtual" if central else "virtual fine")
        )
        parts.append(section.line([(0, 0), reflection, far], "ray" if central else "ray fine"))
    if central:
        z = float(sheets.tangential[0, 2])
        marks = section.dot((0, z)), section.text("viewpoint", (0, z), (0, -13), "middle", "view")
    else:
        marks = tuple(
            section.line(sheet[:, [0, 2]], name)
            for sheet, name in ((sheets.sagittal, "sagittal"), (sheets.tangential, "caustic"))
        )
    rho = np.linspace(-mirror.rim, mirror.rim, 200)
    surface = np.stack([rho, distance + mirror.sag(np.abs(rho))], -1)
    return join(
        section.clip(*parts),
        section.mirror(surface),
        section.camera(26, 16),
        section.dot((0, 0), "lens-dot", 3.5),
        *marks,
    )


def _axis(section: CrossSection) -> Markup:
    return section.line([(0, -500), (0, 500)], "axis")


def conics() -> str:
    """Return figure 3 of the chapter: hyperbolic and parabolic mirror with the dimensions of Table 1."""
    width, height = PANEL
    left = CrossSection((0.0, 40.0), 3.1, (14, 12 + TITLE, 14 + width, 12 + TITLE + height))
    right = CrossSection((0.0, 40.0), 3.1, (32 + width, 12 + TITLE, 32 + 2 * width, 12 + TITLE + height))
    return svg_document(
        element("text", "Hyperboloid with the lens in its far focus", x=16.0, y=27.0, class_="title"),
        element("text", "Paraboloid with a telecentric lens", x=34.0 + width, y=27.0, class_="title"),
        _hyperbola(left),
        _parabola(right),
        width=2 * width + 46,
        height=height + TITLE + 24,
        title="A hyperboloid with a lens in its far focus, and a paraboloid with a telecentric lens.",
    )


def _hyperbola(section: CrossSection) -> Markup:
    mirror, distance = Conic.hyperbola(A, C, RIM), A + C
    lens = Pinhole(FOCAL, FOCAL, 0.0, 0.0)
    edge = FOCAL * RIM / (distance + float(mirror.sag(RIM))) * (1 - 1e-9)
    near, chord = distance + mirror.foci[0], mirror.latus_rectum / 2
    return join(
        _traced(section, Catadioptric(lens, (PlacedMirror(mirror, tz=distance),)), edge, near, parallel=False),
        _surface(section, mirror, distance),
        section.line([(-chord, near), (chord, near)], "angle"),
        section.camera(20, 12),
        section.dot((0, 0)),
        section.dot((0, near)),
        section.text("viewpoint, focus F", (0, near), (0, -13), "middle", "view"),
        section.text("lens, focus F′", (0, 0), (40, 24), class_="view"),
        section.text("L", (0, near), (-24, 17), "middle", "view"),
        section.dimension([(0, 0), (0, near)], "d = 2c", (-158, 0), side="left"),
        section.dimension([(0, 0), (0, distance)], "a + c", (158, 0), side="right"),
    )


def _parabola(section: CrossSection) -> Markup:
    mirror, distance = Conic.parabola(2 * 19.8, RIM), A + C
    lens = Telecentric(1.0, 1.0, 0.0, 0.0)
    near, chord = distance + mirror.foci[0], mirror.latus_rectum / 2
    return join(
        _traced(
            section, Catadioptric(lens, (PlacedMirror(mirror, tz=distance),)), RIM * (1 - 1e-9), near, parallel=True
        ),
        _surface(section, mirror, distance),
        section.line([(-chord, near), (chord, near)], "angle"),
        section.camera(2 * RIM, 2 * RIM),
        section.dot((0, near)),
        section.text("viewpoint, focus", (0, near), (0, -13), "middle", "view"),
        section.text("L", (0, near), (-24, 17), "middle", "view"),
    )


def _surface(section: CrossSection, mirror: Conic, distance: float) -> Markup:
    rho = np.linspace(-mirror.rim, mirror.rim, 200)
    return section.mirror(np.stack([rho, distance + mirror.sag(np.abs(rho))], -1))


def _traced(section: CrossSection, system: Catadioptric, edge: float, near: float, *, parallel: bool) -> Markup:
    radii = edge * np.array([-1, -0.72, -0.42, 0.42, 0.72, 1])
    origins, bearings, _ = system.rays(np.stack([radii, 0 * radii], -1))
    reflections = origins[:, [0, 2]]
    outer = section.extend(reflections, bearings[:, [0, 2]])
    starts = reflections * (1, 0) if parallel else 0 * reflections
    rays = [section.line(np.stack(points), "ray") for points in zip(starts, reflections, outer, strict=True)]
    return section.clip(_axis(section), *(section.line([p, (0, near)], "virtual") for p in reflections), *rays)


def model() -> str:
    """Return figure 5 of the chapter: the unified model, for a hyperbola with e = 3."""
    xi = Conic.hyperbola(1.0, 3.0, 1.0).epsilon
    theta = np.radians(46.0)
    on_sphere = np.array([np.sin(theta), np.cos(theta)])
    behind, plane = np.array([0.0, -xi]), 1 - xi
    image = np.array([on_sphere[0] / (on_sphere[1] + xi), plane])
    point = 1.55 * on_sphere
    section = CrossSection((0.75, 0.13), 178.0, (14.0, 12.0, 866.0, 492.0))
    angle = np.linspace(0, 2 * np.pi, 361)
    circle = np.stack([np.sin(angle), np.cos(angle)], -1)
    visible = circle[:, 1:] > -xi
    labels = (
        ("scene point P = (x, y, z)", point, (12, -2), "start", ""),
        ("1. unit sphere: Pₛ = P/|P|", on_sphere, (16, 8), "start", ""),
        ("C, viewpoint", (0, 0), (-12, 5), "end", "view"),
        ("2. centre of projection Cε = (0, 0, −ε)", behind, (14, 6), "start", "view"),
        ("3. m = (xₛ, yₛ)/(zₛ + ε), plane at distance 1 from Cε", (1.05, plane), (0, 22), "start", ""),
        ("4. pixel p = K m", (1.05, plane), (0, 43), "start", ""),
        ("z, from the mirror to the lens", (0, 1.4), (10, 4), "start", "small"),
        ("not visible: zₛ < −ε", (0, -1), (0, 18), "middle", "small"),
        ("θ", (0.10, 0.27), (0, 0), "start", ""),
    )
    return svg_document(
        section.line(np.where(visible, circle, np.nan), "sphere"),
        section.line(np.where(visible, np.nan, circle), "guide"),
        section.line([(0, -1), (0, 1.42)], "axis"),
        section.line([(-1.3, plane), (3.0, plane)], "dimension"),
        section.line([(0, 0), point], "ray"),
        section.line([behind, image], "virtual"),
        section.line([image, on_sphere], "virtual"),
        section.arc((0, 0), 40, np.pi, np.pi - theta),
        section.dimension([(0, 0), behind], "ε", (-196, 0), side="left"),
        section.dimension([(0, plane), behind], "1", (-222, 0), side="left"),
        *(section.dot(p) for p in ((0, 0), behind)),
        *(section.dot(p, "lens-dot") for p in (point, on_sphere, image)),
        *(section.text(text, at, shift, anchor, class_) for text, at, shift, anchor, class_ in labels),
        width=880.0,
        height=504.0,
        title="The unified model: a point is projected to the unit sphere, and then to a plane, from a centre epsilon"
        " behind the sphere centre.",
    )


def table() -> str:
    """Return the image radius over the angle: traced, and by Table 1, corrected and as printed."""
    mirror, distance = Conic.hyperbola(A, C, RIM), A + C
    system = Catadioptric(Pinhole(FOCAL, FOCAL, 0.0, 0.0), (PlacedMirror(mirror, tz=distance),))
    edge = FOCAL * RIM / (distance + float(mirror.sag(RIM))) * (1 - 1e-9)
    radii = np.linspace(0, edge, 19)
    bearings = system.rays(np.stack([radii, 0 * radii], -1)).bearings
    traced = np.arctan2(bearings[:, 0], -bearings[:, 2])
    corrected = Unified.from_hyperbola(A, C, FOCAL, (0.0, 0.0))
    d = 2 * C
    printed = d / np.sqrt(d**2 + 4 * mirror.latus_rectum**2)
    theta = np.linspace(0, traced[-1], 200)

    def radius(xi: float) -> np.ndarray:
        return np.sin(theta) / (np.cos(theta) + xi)

    # Scale to the traced image on the axis, where r = f theta/(1 + xi).
    on_axis = corrected.fx / (1 + corrected.xi)
    axes = Axes(
        (0.0, float(np.degrees(theta[-1]))),
        (0.0, 1.55 * edge),
        "angle off-axis, degrees",
        "image radius, px",
        (62.0, 16.0, 836.0, 400.0),
    )
    lines = [
        ("line up", f"ε = d/√(d² + L²/4) = {corrected.xi:.5f}, corrected"),
        ("line printed", f"ε = d/√(d² + 4 L²) = {printed:.5f}, as printed"),
        ("dots", "traced rays"),
    ]
    degrees = np.degrees(theta)
    return svg_document(
        axes.frame(),
        axes.clip(
            axes.line(degrees, corrected.fx * radius(corrected.xi), "up"),
            axes.line(degrees, on_axis * (1 + printed) * radius(float(printed)), "printed"),
            axes.dots(np.degrees(traced), radii, ""),
        ),
        legend(lines[:2], (84, 40), (0.0, 19.0)),
        element("path", d="M96 78h0", class_="dots"),
        element("text", lines[2][1], x=116.0, y=82.0, class_="on"),
        width=860.0,
        height=444.0,
        title="Image radius of a hyperbolic mirror over the angle: traced rays agree with the corrected formula.",
    )


def design() -> str:
    """Return the drawing of `omnisight design mirror`."""
    specification = MirrorSpecification(
        "hyperbolic", float(np.radians(20)), float(np.radians(60)), (1280, 960), 3.75e-6
    )
    mirror_design = design_mirror(specification)
    return draw_design(mirror_design, evaluate_design(mirror_design))


if __name__ == "__main__":
    main()
