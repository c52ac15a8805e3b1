"""Render a page as PDF at true scale: one sheet of black and white vectors and text."""

from omnisight.targets.printing.drawing import Disc, Page, Shape, Text

POINTS_PER_METRE = 72 / 0.0254
# Length of a handle over the radius of the cubic that approximates a quarter of a circle, within 0.03 %.
CIRCLE_HANDLE = 4 / 3 * (2**0.5 - 1)


def render_pdf(page: Page) -> bytes:
    """Return the bytes of a PDF file of one page."""
    content = "\n".join(
        [*(_shape(s, page) for s in (*page.board, *page.ruler)), "0 g", *(_text(t, page) for t in page.texts)]
    ).encode("cp1252", "replace")
    box = f"0 0 {_pt(page.width)} {_pt(page.height)}"
    sheet = f"/MediaBox [{box}] /Contents 4 0 R /Resources << /Font << /F 5 0 R >> >>"
    objects = [
        # Viewers that honour it print at 100 % by default.
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R {sheet} >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        b"<< /Title %s /Producer (omnisight) >>" % _string(page.title).encode("cp1252", "replace"),
    ]
    out = bytearray(b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n")
    offsets: list[int] = []
    for number, body in enumerate(objects, 1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    out += b"trailer\n<< /Size %d /Root 1 0 R /Info 6 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(out)


def _shape(shape: Shape, page: Page) -> str:
    fill = "1 g" if shape.white else "0 g"
    if isinstance(shape, Disc):
        return f"{fill} {_circle(shape, page)} f"
    first, *others = (_point(corner, page) for corner in shape.corners)
    return f"{fill} {first} m {' '.join(f'{other} l' for other in others)} h f"


def _circle(disc: Disc, page: Page) -> str:
    (x, y), r, k = disc.centre, disc.radius, disc.radius * CIRCLE_HANDLE
    quarters = [
        ((x + r, y + k), (x + k, y + r), (x, y + r)),
        ((x - k, y + r), (x - r, y + k), (x - r, y)),
        ((x - r, y - k), (x - k, y - r), (x, y - r)),
        ((x + k, y - r), (x + r, y - k), (x + r, y)),
    ]
    return f"{_point((x + r, y), page)} m " + " ".join(
        " ".join(_point(handle, page) for handle in quarter) + " c" for quarter in quarters
    )


def _text(text: Text, page: Page) -> str:
    return f"BT /F {_pt(text.size)} Tf {_point(text.at, page)} Td {_string(text.content)} Tj ET"


def _string(text: str) -> str:
    for special in "\\()":
        text = text.replace(special, f"\\{special}")
    return f"({text})"


def _point(point: tuple[float, float], page: Page) -> str:
    """Format a point of the page; PDF has its origin at the bottom left and y upwards."""
    return f"{_pt(point[0])} {_pt(page.height - point[1])}"


def _pt(metres: float) -> str:
    return f"{metres * POINTS_PER_METRE:.5f}".rstrip("0").rstrip(".")
