"""Draws the figures of the guide to mirrors, as SVG, by tracing rays: the same at every run."""

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
# The chapter's hyperbola, mm: a = 28, c = 38.5, the lens 66.5 from the vertex.
A, C, RIM = 28.0, 38.5, 34.0
FOCAL = 1000.0
PANEL = 440.0, 400.0
TITLE = 30.0


def main() -> None:
    """Draw all figures."""
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
    """Figure 2 of the chapter: two cameras with a single viewpoint, and two whose rays touch a caustic."""
    hyperbola = Conic.hyperbola(A, C, RIM)
    panels = (
        ("(a) A lens alone: all rays through its centre", _lens_alone),
        ("(b) A hyperboloid, the lens in its far focus", lambda s: _mirror(s, hyperbola, A + C, 8)),
        ("(c) The same, the lens 35 mm too near: a caustic", lambda s: _mirror(s, hyperbola, A + C - 35)),
        ("(d) A sphere: a caustic wherever the lens is", lambda s: _mirror(s, Conic.sphere(40.0, 36.0), 66.5)),
    )
    width, height = PANEL
    drawn = list[Markup]()
    for i, (title, draw) in enumerate(panels):
        left, top = 14 + (i % 2) * (width + 18), 12 + (i // 2) * (height + TITLE + 18)
        drawn.append(element("text", title, x=left + 2, y=top + 15, class_="title"))
        section = CrossSection((0.0, 44.0), 3.2, (left, top + TITLE, left + width, top + TITLE + height))
        drawn.append(draw(section))
    entries = [("caustic", "caustic: where rays meet their neighbours above and below")]
    entries += [("sagittal", "its other sheet, on the axis: where they meet those beside them")]
    foot = 12 + 2 * (height + TITLE + 18)
    return svg_document(
        *drawn,
        legend(entries, (18, foot + 10), (0.0, 19.0)),
        width=2 * width + 46,
        height=foot + 48,
        title="Rays of a lens, of a hyperbolic mirror with its lens in the focus and out of it, of a spherical mirror.",
    )


def _lens_alone(section: CrossSection) -> Markup:
    turn = np.linspace(-0.65, 0.65, 13)
    ends = section.extend(np.zeros((13, 2)), np.stack([np.sin(turn), np.cos(turn)], -1))
    rays = [section.line([(0, 0), end], "ray") for end in ends]
    return join(
        section.clip(_axis(section), *rays),
        section.camera(26, 16),
        section.dot((0, 0)),
        section.text("viewpoint", (0, 0), (50, 5), class_="view"),
    )


def _mirror(section: CrossSection, mirror: Conic, distance: float, count: int = 16) -> Markup:
    """Draw rays over a mirror, back to where they seem to come from, and the caustic that they touch there."""
    system = Catadioptric(Pinhole(FOCAL, FOCAL, 0.0, 0.0), (PlacedMirror(mirror, tz=distance),))
    edge = FOCAL * mirror.rim / (distance + float(mirror.sag(mirror.rim))) * (1 - 1e-9)
    radii = np.linspace(0.06, 1, count) * edge
    radii = np.concatenate([-radii[::-1], radii])
    origins, bearings, _ = system.rays(np.stack([radii, 0 * radii], -1))
    corners, away = origins[:, [0, 2]], bearings[:, [0, 2]]
    outer = section.extend(corners, away)
    dense = np.linspace(-edge, edge, 400)
    found = caustic(system, np.stack([dense, 0 * dense], -1))
    touched = caustic(system, np.stack([radii, 0 * radii], -1)).tangential[:, [0, 2]]
    central = np.ptp(found.tangential[:, 2]) < 1e-9
    parts = [_axis(section)]
    # As far as the caustic, and a little past it.
    past = 0.0 if central else 0.12
    for corner, end, far in zip(corners, touched, outer, strict=True):
        parts.append(section.line([corner, end + past * (end - corner)], "virtual" if central else "virtual fine"))
        parts.append(section.line([(0, 0), corner, far], "ray" if central else "ray fine"))
    if central:
        z = float(found.tangential[0, 2])
        marks = section.dot((0, z)), section.text("viewpoint", (0, z), (0, -13), "middle", "view")
    else:
        marks = tuple(
            section.line(sheet[:, [0, 2]], name)
            for sheet, name in ((found.sagittal, "sagittal"), (found.tangential, "caustic"))
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
    """Figure 3 of the chapter: the two mirrors that central cameras are built of, with what Table 1 is about."""
    width, height = PANEL
    left = CrossSection((0.0, 40.0), 3.1, (14, 12 + TITLE, 14 + width, 12 + TITLE + height))
    right = CrossSection((0.0, 40.0), 3.1, (32 + width, 12 + TITLE, 32 + 2 * width, 12 + TITLE + height))
    return svg_document(
        element("text", "Hyperboloid and lens: focus to focus", x=16.0, y=27.0, class_="title"),
        element("text", "Paraboloid and telecentric lens", x=34.0 + width, y=27.0, class_="title"),
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
    corners = origins[:, [0, 2]]
    outer = section.extend(corners, bearings[:, [0, 2]])
    starts = corners * (1, 0) if parallel else 0 * corners
    rays = [section.line(np.stack(three), "ray") for three in zip(starts, corners, outer, strict=True)]
    return section.clip(_axis(section), *(section.line([c, (0, near)], "virtual") for c in corners), *rays)


def model() -> str:
    """Figure 5 of the chapter: the unified model, for a hyperbola with e = 3."""
    xi = Conic.hyperbola(1.0, 3.0, 1.0).epsilon
    theta = np.radians(46.0)
    on_sphere = np.array([np.sin(theta), np.cos(theta)])
    behind, plane = np.array([0.0, -xi]), 1 - xi
    image = np.array([on_sphere[0] / (on_sphere[1] + xi), plane])
    point = 1.55 * on_sphere
    section = CrossSection((0.75, 0.13), 178.0, (14.0, 12.0, 866.0, 492.0))
    turn = np.linspace(0, 2 * np.pi, 361)
    circle = np.stack([np.sin(turn), np.cos(turn)], -1)
    seen = circle[:, 1:] > -xi
    words = (
        ("scene point P = (x, y, z)", point, (12, -2), "start", ""),
        ("1. on the unit sphere: Pₛ = P/|P|", on_sphere, (16, 8), "start", ""),
        ("C, the viewpoint", (0, 0), (-12, 5), "end", "view"),
        ("2. seen from Cε = (0, 0, −ε)", behind, (14, 6), "start", "view"),
        ("3. m = (xₛ, yₛ)/(zₛ + ε), on the plane at distance 1 from Cε", (1.05, plane), (0, 22), "start", ""),
        ("4. p = K m, the pixel", (1.05, plane), (0, 43), "start", ""),
        ("z, from the mirror to the lens", (0, 1.4), (10, 4), "start", "small"),
        ("not seen: zₛ < −ε", (0, -1), (0, 18), "middle", "small"),
        ("θ", (0.10, 0.27), (0, 0), "start", ""),
    )
    return svg_document(
        section.line(np.where(seen, circle, np.nan), "sphere"),
        section.line(np.where(seen, np.nan, circle), "guide"),
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
        *(section.text(text, at, shift, anchor, class_) for text, at, shift, anchor, class_ in words),
        width=880.0,
        height=504.0,
        title="The unified model: a point is projected to the unit sphere, and from there to a plane, seen from epsilon"
        " behind the centre.",
    )


def table() -> str:
    """The radius of the image by the angle: traced, and as Table 1 has it, corrected and as printed."""
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

    # Scaled to the traced image on the axis, where r = f theta/(1 + xi).
    on_axis = corrected.fx / (1 + corrected.xi)
    axes = Axes(
        (0.0, float(np.degrees(theta[-1]))),
        (0.0, 1.55 * edge),
        "angle from the mirror's axis, degrees",
        "radius of the image, px",
        (62.0, 16.0, 836.0, 400.0),
    )
    lines = [
        ("line up", f"ε = d/√(d² + L²/4) = {corrected.xi:.5f}, corrected"),
        ("line printed", f"ε = d/√(d² + 4 L²) = {printed:.5f}, as printed"),
        ("dots", "rays, traced over the mirror"),
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
        title="The radius of the image of a hyperbolic mirror by the angle: rays lie on the corrected curve.",
    )


def design() -> str:
    """What `omnisight design mirror` draws."""
    order = MirrorSpecification("hyperbolic", float(np.radians(20)), float(np.radians(60)), (1280, 960), 3.75e-6)
    made = design_mirror(order)
    return draw_design(made, evaluate_design(made))


if __name__ == "__main__":
    main()
