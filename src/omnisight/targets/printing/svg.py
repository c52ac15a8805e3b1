"""Render a page as SVG in millimetres, which keeps the true scale in programs that honour units."""

from xml.sax.saxutils import escape

from omnisight.targets.printing.drawing import Disc, Page, Shape, Text


def render_svg(page: Page) -> str:
    """Return the text of an SVG file."""
    width, height = _mm(page.width), _mm(page.height)
    size = f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
        f"<title>{escape(page.title)}</title>",
        # Programs with a black background would hide the board without it.
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        '<g id="board">',
        *map(_shape, page.board),
        '</g>\n<g id="ruler">',
        *map(_shape, page.ruler),
        '</g>\n<g id="text" font-family="Helvetica, Arial, Liberation Sans, sans-serif">',
        *map(_text, page.texts),
        "</g>\n</svg>",
    ]
    return "\n".join(lines) + "\n"


def _shape(shape: Shape) -> str:
    fill = "#fff" if shape.white else "#000"
    if isinstance(shape, Disc):
        x, y = map(_mm, shape.centre)
        return f'<circle cx="{x}" cy="{y}" r="{_mm(shape.radius)}" fill="{fill}"/>'
    corners = " ".join(f"{_mm(x)},{_mm(y)}" for x, y in shape.corners)
    return f'<polygon points="{corners}" fill="{fill}"/>'


def _text(text: Text) -> str:
    x, y = map(_mm, text.at)
    return f'<text x="{x}" y="{y}" font-size="{_mm(text.size)}">{escape(text.content)}</text>'


def _mm(metres: float) -> str:
    """Format a length in millimetres, to the nanometre."""
    return f"{metres * 1e3:.6f}".rstrip("0").rstrip(".")
