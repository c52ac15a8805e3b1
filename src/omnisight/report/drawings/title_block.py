"""Tables of an engineering drawing: surface, tolerances and title block."""

import numpy as np

from omnisight import __version__
from omnisight.optics.design.description import (
    describe_tolerance_limits,
    describe_tolerances,
    format_length,
    surface_equation,
)
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance
from omnisight.optics.design.shapes import KINDS
from omnisight.optics.design.tolerances import compute_tolerances
from omnisight.report.drawings.cross_section import CrossSection
from omnisight.report.html import Markup, element, join

ROW_HEIGHT = 19.0
# Rows of the sag table, from the hole to the rim.
SAG_ROWS = 9
Position = tuple[float, float]


def surface_table(design: MirrorDesign, position: Position) -> Markup:
    """Draw the equation of the surface and a table of distance from the axis, sag and slope."""
    x, y = position
    mirror = design.mirror
    rho = np.linspace(mirror.hole, mirror.rim, SAG_ROWS)
    sag = 1e3 * mirror.sag(rho)
    with np.errstate(all="ignore"):
        slope = np.degrees(np.arctan(2 * rho * mirror.profile(rho**2)[1]))
    rows = [("ρ mm", "z mm", "slope")]
    rows += [
        (f"{1e3 * r:.3f}", f"{z:.4f}", f"{a:.3f}°" if np.isfinite(a) else "-")
        for r, z, a in zip(rho, sag, slope, strict=True)
    ]
    heading = element("text", "Surface", x=x, y=y, class_="title")
    equation = element("text", surface_equation(design), x=x, y=y + 21, class_="small")
    return join(heading, equation, _columns(rows, (x, y + 44), (60.0, 150.0, 230.0)))


def tolerance_table(design: MirrorDesign, performance: Performance, position: Position) -> Markup:
    """Draw the tolerances of position and surface."""
    x, y = position
    rows = describe_tolerances(design, compute_tolerances(design, performance))
    return join(
        element("text", "Tolerances", x=x, y=y, class_="title"),
        *(
            _row([(name, x, "start"), (text, x + 190, "end")], y + 24 + ROW_HEIGHT * i)
            for i, (name, text) in enumerate(rows)
        ),
        *(
            element("text", line, x=x, y=y + 34 + ROW_HEIGHT * (len(rows) + i), class_="small")
            for i, line in enumerate(describe_tolerance_limits(design))
        ),
    )


def title_block(design: MirrorDesign, scale: str, box: tuple[float, float, float, float]) -> Markup:
    """Draw the title block."""
    left, top, right, bottom = box
    specification, mirror = design.specification, design.mirror
    material = f"Ø{format_length(2 * mirror.rim)}, depth {format_length(float(mirror.sag(mirror.rim)))}"
    cells = [
        ("title", f"{specification.kind.capitalize()} mirror, {material}"),
        ("type", KINDS[specification.kind].description),
        ("scale", f"{scale} on A4, dimensions in mm"),
        ("drawn by", f"omnisight {__version__}"),
    ]
    height = (bottom - top) / len(cells)
    parts = [element("rect", x=left, y=top, width=right - left, height=bottom - top, class_="block")]
    for i, (name, text) in enumerate(cells):
        y = top + i * height
        parts.append(element("path", d=f"M{left:g} {y:g}H{right:g}", class_="block"))
        parts.append(_row([(name, left + 8, "start"), (text, left + 76, "start")], y + height / 2 + 4))
    return join(*parts)


def scale_bar(section: CrossSection, length_mm: float, position: Position) -> Markup:
    """Draw a bar of a length in millimetres."""
    x, y = position
    width = length_mm * section.scale
    bar = element("path", d=f"M{x:g} {y - 5:g}V{y:g}H{x + width:g}V{y - 5:g}", class_="dimension")
    return join(bar, element("text", f"{length_mm:g} mm", x=x + width + 8, y=y + 2, class_="on small"))


def _columns(rows: list[tuple[str, ...]], position: Position, right: tuple[float, ...]) -> Markup:
    """Draw rows of right-aligned columns."""
    x, y = position
    lines = ([(text, x + edge, "end") for text, edge in zip(row, right, strict=True)] for row in rows)
    return join(*(_row(line, y + ROW_HEIGHT * i) for i, line in enumerate(lines)))


def _row(cells: list[tuple[str, float, str]], y: float) -> Markup:
    """Draw a row of (text, x, anchor)."""
    return join(*(element("text", text, x=x, y=y, text_anchor=anchor, class_="small") for text, x, anchor in cells))
