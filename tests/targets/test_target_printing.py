"""Printed pages: true scale in PDF and SVG, legible, without overlaps."""

import math
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from example_boards import BOARDS, SCALE, aprilgrid, charuco, checkerboard, circles, rasterise

from omnisight.targets.printing.drawing import Disc, Polygon
from omnisight.targets.printing.page import PAGE_MARGIN, lay_out, smallest_paper
from omnisight.targets.printing.paper import PAPERS, paper_sizes
from omnisight.targets.printing.pdf import render_pdf
from omnisight.targets.printing.svg import render_svg

SVG = "{http://www.w3.org/2000/svg}"
POINT = 0.0254 / 72

# Widths of Helvetica's letters over their size, from Adobe's metrics.
WIDTHS = {
    0.222: "ijl'",
    0.278: "ftI ,.:/!",
    0.333: "r-()",
    0.334: "{}",
    0.355: '"',
    0.5: "ckvxszyJ",
    0.556: "abdeghnopquL_0123456789",
    0.611: "FTZ",
    0.667: "ABEKPSVXY",
    0.722: "CDHNRUw",
    0.778: "GOQ",
    0.833: "mM",
    0.889: "%",
    0.944: "W",
}


def width_of(text):
    return text.size * sum(next(width for width, letters in WIDTHS.items() if c in letters) for c in text.content)


def box(shape):
    """Return left, top, right, bottom of a shape or text, m."""
    if isinstance(shape, Disc):
        (x, y), r = shape.centre, shape.radius
        return x - r, y - r, x + r, y + r
    if isinstance(shape, Polygon):
        x, y = zip(*shape.corners, strict=True)
        return min(x), min(y), max(x), max(y)
    (x, y), size = shape.at, shape.size
    return x, y - 0.73 * size, x + width_of(shape), y + 0.22 * size


def union(boxes):
    boxes = np.array(boxes)
    return (*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0))


def apart(a, b):
    return a[2] <= b[0] + 1e-9 or b[2] <= a[0] + 1e-9 or a[3] <= b[1] + 1e-9 or b[3] <= a[1] + 1e-9


def read_svg(text):
    """Return paper size, board, ruler and texts of an SVG, in metres."""
    root = ET.fromstring(text)
    sides = [float(re.fullmatch(r"([\d.]+)mm", root.get(name))[1]) for name in ("width", "height")]
    assert root.get("viewBox") == f"0 0 {sides[0]:g} {sides[1]:g}"
    groups = {group.get("id"): list(group) for group in root.iter(f"{SVG}g")}
    shapes = {name: [svg_shape(e) for e in groups[name]] for name in ("board", "ruler")}
    return np.array(sides) / 1e3, shapes["board"], shapes["ruler"], [e.text for e in groups["text"]]


def svg_shape(element):
    white = {"#fff": True, "#000": False}[element.get("fill")]
    if element.tag == f"{SVG}circle":
        x, y, r = (float(element.get(name)) / 1e3 for name in ("cx", "cy", "r"))
        return Disc((x, y), r, white)
    return Polygon(
        tuple(tuple(float(v) / 1e3 for v in corner.split(",")) for corner in element.get("points").split()), white
    )


def read_pdf(data):
    """Return paper size (m), the outlines (N, 2) in m with their colour, and the texts of a PDF of one page."""
    table = int(re.search(rb"startxref\n(\d+)\n%%EOF\n$", data)[1])
    head, count = re.match(rb"xref\n(\d+) (\d+)\n", data[table:]).groups()
    rows = re.findall(rb"(\d{10}) (\d{5}) ([nf]) \n", data[table:])
    assert (int(head), int(count)) == (0, len(rows))
    for number, (place, _, used) in enumerate(rows):
        assert used == (b"n" if number else b"f")
        assert not number or data[int(place) :].startswith(b"%d 0 obj\n" % number)
    assert f"/Size {len(rows)} ".encode() in data[table:]
    box = [float(v) for v in re.search(rb"/MediaBox \[(.*?)\]", data)[1].split()]
    assert box[:2] == [0, 0]
    (length, content) = re.search(rb"/Length (\d+) >>\nstream\n(.*)\nendstream", data, re.DOTALL).groups()
    assert int(length) == len(content)
    outlines, texts, white, path, operands = [], [], None, [], []
    for line in content.decode("cp1252").splitlines():
        if line.startswith("BT "):
            texts.append(re.search(r"\((.*)\) Tj", line)[1].replace("\\(", "(").replace("\\)", ")"))
            continue
        for word in line.split():
            if re.fullmatch(r"-?[\d.]+", word):
                operands.append(float(word))
                continue
            if word == "g":
                white = operands == [1]
            elif word in "ml":
                path.append(operands)
            elif word == "c":
                p = np.array([path[-1], *np.reshape(operands, (3, 2))])
                t = np.linspace(0, 1, 46)[1:, None]
                path += list(
                    (1 - t) ** 3 * p[0] + 3 * t * (1 - t) ** 2 * p[1] + 3 * t * t * (1 - t) * p[2] + t**3 * p[3]
                )
            elif word == "f":
                outlines.append(((np.array(path) * (1, -1) + (0, box[3])) * POINT, white))
                path = []
            operands = []
    return np.array(box[2:]) * POINT, outlines, texts


@pytest.mark.parametrize("board", BOARDS)
def test_svg_is_at_true_scale(board):
    page = lay_out(board, smallest_paper(board))
    size, shapes, ruler, texts = read_svg(render_svg(page))
    assert size == pytest.approx((page.width, page.height), abs=1e-12)
    assert len(shapes) == len(board.drawing())
    for ours, read in zip([*page.board, *page.ruler], [*shapes, *ruler], strict=True):
        assert type(ours) is type(read)
        assert ours.white == read.white
        assert box(read) == pytest.approx(box(ours), abs=2e-9)
    assert texts == [text.content for text in page.texts]


@pytest.mark.parametrize("board", BOARDS)
def test_pdf_is_at_true_scale(board):
    page = lay_out(board, smallest_paper(board))
    data = render_pdf(page)
    assert data.startswith(b"%PDF-1.")
    assert b"/PrintScaling /None" in data
    size, outlines, texts = read_pdf(data)
    assert size == pytest.approx((page.width, page.height), abs=1e-8)
    assert len(outlines) == len(page.board) + len(page.ruler)
    for shape, (outline, white) in zip([*page.board, *page.ruler], outlines, strict=True):
        assert white == shape.white
        if isinstance(shape, Disc):
            radii = np.linalg.norm(outline - shape.centre, axis=1)
            assert radii == pytest.approx(shape.radius, rel=3e-4)
        else:
            np.testing.assert_allclose(outline, shape.corners, atol=1e-8)
    assert texts == [text.content for text in page.texts]


def test_opencv_detects_a_printed_page_in_place():
    board = charuco(9, 6, 0.024, 0.018)
    page = lay_out(board, "A4")
    (width, height), outlines, _ = read_pdf(render_pdf(page))
    image = rasterise([Polygon(tuple(map(tuple, outline)), white) for outline, white in outlines], width, height)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    theirs = cv2.aruco.CharucoBoard((10, 7), 0.024, 0.018, dictionary)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(theirs).detectBoard(image)
    assert len(ids) == 54
    expected = (board.points[:, :2] + page.origin) * SCALE - 0.5
    assert np.linalg.norm(corners.reshape(-1, 2) - expected[ids.ravel()], axis=1).max() < 0.3


@pytest.mark.parametrize("paper", ["A4", "A3", "Letter", "600x400mm", "80x200mm", "0.05x0.3m"])
def test_ruler_has_a_tick_per_millimetre_and_the_stated_length(paper):
    page = lay_out(checkerboard(3, 3, 0.006), paper)
    _, _, ruler, texts = read_svg(render_svg(page))
    base, *ticks = (box(shape) for shape in ruler)
    middles = np.array([(left + right) / 2 for left, _, right, _ in ticks])
    length = middles[-1] - middles[0]
    np.testing.assert_allclose(np.diff(middles), 1e-3, atol=2e-9)
    assert base[2] - base[0] == pytest.approx(length, abs=2e-9)
    message = re.search(r"this ruler must measure (\d+) mm", " ".join(texts))
    assert int(message[1]) == pytest.approx(length * 1e3, abs=1e-5)
    assert int(message[1]) == 100 or min(page.width, page.height) < 0.1
    assert "Print at 100 %, do not fit to page" in " ".join(texts)


@pytest.mark.parametrize("paper", ["A5", "A4", "A3", "A2", "Letter", "Legal", "Tabloid", "700x900mm", "120x2000mm"])
@pytest.mark.parametrize(
    "board",
    [
        checkerboard(9, 6, 0.008),
        checkerboard(4, 15, 0.006),
        charuco(5, 4, 0.016, 0.012),
        aprilgrid(6, 6, 0.01, 0.3),
        circles(4, 11, 0.006, 0.006),
    ],
    ids=lambda board: f"{board.kind}-{board}",
)
def test_nothing_overlaps_and_everything_is_on_the_paper(board, paper):
    page = lay_out(board, paper)
    ink = union([box(shape) for shape in page.board])
    others = [box(item) for item in (*page.ruler, *page.texts)]
    words = [box(text) for text in page.texts]
    left, top, right, bottom = union([*others, ink])
    assert min(left, top) >= PAGE_MARGIN - 1e-9
    assert right <= page.width - PAGE_MARGIN + 1e-9
    assert bottom <= page.height - PAGE_MARGIN + 1e-9
    # White is half a square at least, a whole one where the paper has it, and equal on opposite sides.
    ruled = union(others)
    above, below, beside = ink[1], ruled[1] - ink[3], (ink[0], page.width - ink[2])
    assert beside[0] == pytest.approx(beside[1])
    assert above == pytest.approx(below, abs=1.5e-3)
    assert min(above, below, *beside) >= board.quiet_zone / 2 - 1e-9
    assert words
    for i, word in enumerate(words):
        assert all(apart(word, other) for other in [*words[:i], *(box(shape) for shape in page.ruler)])


def test_large_sheet_leaves_a_square_of_margin_in_the_better_orientation():
    page = lay_out(checkerboard(9, 6, 0.03), "A3")
    ink = union([box(shape) for shape in page.board])
    assert page.width > page.height
    assert min(ink[0], ink[1]) > 0.03
    assert lay_out(checkerboard(6, 9, 0.03), "A3").height > page.height


def test_board_that_does_not_fit_raises_with_what_would():
    with pytest.raises(ValueError, match=r"needs 330 x 25.*mm of paper") as caught:
        lay_out(checkerboard(9, 6, 0.03), "A4")
    message = str(caught.value)
    assert message.startswith("the 9x6 checkerboard with square 30mm is 300 x 210 mm and needs 330 x ")
    assert "A4 offers 297 x 210 mm: the largest square that fits is 24" in message
    assert message.endswith(", or use --paper A3")
    largest = float(re.search(r"fits is ([\d.]+)mm", message)[1]) / 1e3
    lay_out(checkerboard(9, 6, largest), "A4")
    with pytest.raises(ValueError, match="or use --paper A3"):
        lay_out(checkerboard(9, 6, largest + 2e-4), "A4")


@pytest.mark.parametrize("names", [["A4", "A3", "A2", "A1", "A0"], ["Letter", "Tabloid", "A2", "A1", "A0"]])
@pytest.mark.parametrize("board", BOARDS)
def test_smallest_paper_is_the_smallest_that_fits(board, names, monkeypatch):
    for name in ("LC_ALL", "LANG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("LC_PAPER", "en_CA.UTF-8" if names[0] == "Letter" else "de_DE.UTF-8")
    smallest = smallest_paper(board)
    lay_out(board, smallest)
    for smaller in names[: names.index(smallest)]:
        with pytest.raises(ValueError, match=f"or use --paper {smallest}$"):
            lay_out(board, smaller)


def test_board_larger_than_a0_raises_with_a_paper_that_fits():
    board = aprilgrid(10, 8, 0.2, 0.3)
    with pytest.raises(ValueError, match="or use --paper ") as caught:
        lay_out(board, "A0")
    lay_out(board, re.search(r"--paper (\d+x\d+mm)$", str(caught.value))[1])


def test_board_larger_than_any_paper_raises_with_the_largest_square_that_fits():
    with pytest.raises(ValueError, match=r"A0 offers .*: the largest square that fits is \d+.*mm$"):
        lay_out(checkerboard(9, 6, 3.0), "A0")


def test_paper_sizes():
    for name, (width, height) in PAPERS.items():
        assert paper_sizes(name.lower()) == [(width, height), (height, width)]
        assert width < height
    assert all(math.isclose(h / w, 2**0.5, rel_tol=0.01) for name, (w, h) in PAPERS.items() if name.startswith("A"))
    assert paper_sizes("600x400mm") == [(pytest.approx(0.6), pytest.approx(0.4))]
    assert paper_sizes("24in x 36in") == [(pytest.approx(0.6096), pytest.approx(0.9144))]


@pytest.mark.parametrize("paper", ["", "B4", "600x400", "0x400mm", "600x400km", "9x9m", "1mx1mm", "1..2x1m", "A4" * 99])
def test_invalid_paper_raises(paper):
    with pytest.raises(ValueError, match=r"mm|unit"):
        paper_sizes(paper)
