"""omnisight target."""

import pytest
from cli_scene import TRUTH, file_names

from omnisight.formats import save
from omnisight.targets.target_file import load_board


@pytest.fixture
def make(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: run("target", *arguments)


@pytest.fixture
def cannot(refuses, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: refuses("target", *arguments)


@pytest.mark.parametrize(
    ("arguments", "values"),
    [
        (("checkerboard", "9x6", "--square", "24mm"), {"square": "24mm"}),
        (("charuco", "9x6", "--square", "24mm"), {"square": "24mm", "marker": "18mm", "dictionary": "DICT_5X5_100"}),
        (
            ("charuco", "9x6", "--square", "24mm", "--marker", "12mm", "--dictionary", "DICT_4X4_50", "--legacy"),
            {"marker": "12mm", "dictionary": "DICT_4X4_50", "legacy": True},
        ),
        (("charuco", "9x6", "--square", "24mm", "--dictionary", "4x4_50"), {"dictionary": "DICT_4X4_50"}),
        (
            ("charuco", "5x4", "--square", "24mm", "--dictionary", "apriltag_36H11"),
            {"dictionary": "DICT_APRILTAG_36h11"},
        ),
        (("aprilgrid", "6x6", "--tag", "24mm"), {"tag": "24mm", "spacing": 0.3}),
        (("aprilgrid", "6x6", "--tag", "2cm", "--spacing", "0.25"), {"tag": "20mm", "spacing": 0.25}),
        (("circles", "4x11", "--spacing", "18mm"), {"spacing": "18mm", "diameter": "18mm"}),
        (("circles", "4x11", "--spacing", "18mm", "--diameter", "1cm"), {"spacing": "18mm", "diameter": "10mm"}),
    ],
)
def test_target_make_writes_three_files_and_prints_them(make, tmp_path, arguments, values):
    status, out, err = make(*arguments)
    assert (status, err) == (0, "")
    kind, pattern = arguments[:2]
    first = values.get("square") or values.get("tag") or values.get("spacing") or "24mm"
    name = f"{kind}_{pattern}_{first if isinstance(first, str) else '18mm'}"
    assert file_names(tmp_path) == sorted(f"{name}.{suffix}" for suffix in ("json", "pdf", "svg"))
    board = load_board(tmp_path / f"{name}.json")
    assert (board.kind, str(board)) == (kind, pattern)
    assert values.items() <= board.to_dict().items()
    assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / f"{name}.svg").read_text().startswith("<svg")
    for message in ("paper    A4, ", "print    at 100 %", "must measure 100 mm", f"--target {name}.json"):
        assert message in out
    assert f"board    {kind} {pattern}, {board.size} points, " in out
    assert "note" not in out


@pytest.mark.parametrize("kind", ["checkerboard", "charuco"])
def test_a_board_may_be_specified_by_its_squares(make, tmp_path, kind):
    assert make(kind, "--squares", "10x7", "--square", "24mm", "-o", "b.pdf")[0] == 0
    assert str(load_board(tmp_path / "b.json")) == "9x6"


def test_symmetric_circles_have_the_diameter_of_opencv_by_default(make, tmp_path):
    status, _, err = make("symmetric_circles", "7x6", "--spacing", "20mm", "-o", "b.pdf")
    assert (status, err) == (0, "")
    assert load_board(tmp_path / "b.json").to_dict()["diameter"] == "8mm"


@pytest.mark.parametrize(("locale", "paper"), [("de_DE.UTF-8", "A4"), ("en_US.UTF-8", "Letter")])
def test_the_default_paper_is_that_of_the_territory(make, cannot, monkeypatch, locale, paper):
    monkeypatch.setenv("LC_ALL", locale)
    assert f"paper    {paper}, " in make("checkerboard", "9x6", "--square", "20mm")[1]
    assert f"; {paper} offers " in cannot("checkerboard", "9x6", "--square", "30mm")


def test_the_printed_command_is_complete_for_a_name_with_a_space(make):
    status, out, _ = make("checkerboard", "9x6", "--square", "20mm", "-o", "my board.pdf")
    assert status == 0
    assert "next     omnisight calibrate images/ --target 'my board.json'\n" in out


def test_the_scale_of_the_print_is_reported_for_narrow_paper(make):
    status, out, _ = make("checkerboard", "4x3", "--square", "8mm", "--paper", "60x80mm")
    assert status == 0
    assert "\nprint    at 100 %, do not fit to page: this ruler must measure 20 mm. Measure the board" in out


@pytest.mark.parametrize("name", ["b.pdf", "b", "b.svg", "b.json", "b.PDF", "b.2"])
def test_target_make_writes_files_next_to_each_other(make, tmp_path, name):
    (tmp_path / "out").mkdir()
    status, out, _ = make("checkerboard", "9x6", "--square", "35mm", "--paper", "a3", "-o", f"out/{name}")
    assert status == 0
    assert "paper    a3, 420 x 297 mm" in out
    stem = "b.2" if name == "b.2" else "b"
    assert file_names(tmp_path / "out") == [f"{stem}.json", f"{stem}.pdf", f"{stem}.svg"]


@pytest.mark.parametrize(
    ("kind", "pattern", "options", "better"),
    [
        ("checkerboard", "8x6", ("--square", "20mm"), "9x6"),
        ("checkerboard", "9x7", ("--square", "20mm"), "10x7"),
        ("checkerboard", "7x7", ("--square", "20mm"), "8x7"),
        ("circles", "4x10", ("--spacing", "15mm"), "4x11"),
    ],
)
def test_symmetric_board_gives_a_note_with_an_alternative(make, kind, pattern, options, better):
    status, out, _ = make(kind, pattern, *options)
    assert status == 0
    assert f"note     {kind} {pattern} looks the same upside-down" in out
    assert f"{better} is unambiguous" in out
    assert ("quarter turn" in out) is (pattern == "7x7")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("dots", "9x6"), "unknown kind of target 'dots'; there are: aprilgrid, aruco_grid, charuco, checkerboard"),
        (
            ("checkerboard", "nine"),
            "cannot read the pattern 'nine': expected COLUMNSxROWS, inner corners",
        ),
        (("checkerboard", "9x6"), "the side of a square of the 9x6 board is unknown: specify it, such as 30mm"),
        (("checkerboard", "9x6", "--square", "30"), "square: the length '30' has no unit: write 30mm"),
        (("checkerboard", "9x6", "--square", "30mm", "--tag", "3mm"), "the target checkerboard has no 'tag'"),
        (("checkerboard", "9x6", "--square", "30mm", "--paper", "A4"), "or use --paper A3"),
        (("checkerboard", "9x6", "--square", "25mm"), "the largest square that fits is 24.3mm, or use --paper A3"),
        (("checkerboard", "9x6", "--square", "30mm", "--paper", "B4"), "cannot read the paper 'B4'"),
        (("checkerboard", "2x6", "--square", "30mm"), "needs 3x3 inner corners or more, got 2x6"),
        (("checkerboard", "9x6", "--square", "3m"), "the largest square that fits is 24.3mm"),
        (("checkerboard", "--square", "24mm"), "the target checkerboard needs its pattern, such as 9x6"),
        (
            ("checkerboard", "9x6", "--squares", "10x7", "--square", "24mm"),
            "the target checkerboard: specify either its pattern or --squares",
        ),
        (
            ("circles", "--squares", "10x7", "--spacing", "9mm"),
            "the target circles has no squares: specify its pattern, such as 9x6, not --squares",
        ),
        (("charuco", "--squares", "10by7"), "cannot read the squares '10by7': expected COLUMNSxROWS, squares"),
        (("charuco", "9x6"), "the target charuco needs --square, a length with its unit, such as 24mm"),
        (("charuco", "9x6", "--square", "x"), "cannot read the length 'x'"),
        (("charuco", "9x6", "--square", "3cm", "--dictionary", "DICT_9"), "such as DICT_5X5_100"),
        (
            ("charuco", "9x6", "--square", "3cm", "--dictionary", "DICT_4X4"),
            "unknown dictionary of markers 'DICT_4X4'; did you mean DICT_4X4_50, DICT_4X4_100, DICT_4X4_250 or",
        ),
        (("charuco", "9x6", "--square", "3cm", "--dictionary", "DICT_5X4_100"), "did you mean DICT_"),
        (("charuco", "9x6", "--square", "1.2mm"), "the marker of the 9x6 charuco is 0.9mm: less than 1mm"),
        (("checkerboard", "200x101", "--square", "1mm"), "the 200x101 checkerboard has 20200 points: more than 10000"),
        (
            ("checkerboard", "9x6", "--square", "24mm", "-o", "b.png"),
            "output is a PDF, an SVG and a JSON; name the PDF, b.pdf",
        ),
        (("aprilgrid", "6x6", "--tag", "3cm", "--spacing", "9mm"), "--spacing must be a number, such as 0.3"),
        (("aprilgrid", "6x6", "--tag", "3cm", "--spacing", "nan"), "spacing is nan"),
        (("circles", "4x11"), "the target circles needs --spacing, a length"),
        (("checkerboard", "9x6", "--square", "24mm", "-o", "."), "is a folder; name a file in it"),
        (("checkerboard", "9x6", "--square", "24mm", "-o", "none/b.pdf"), "the folder none does not exist"),
    ],
)
def test_invalid_target_reports_the_reason_and_writes_nothing(cannot, tmp_path, arguments, message):
    assert message in cannot(*arguments)
    assert file_names(tmp_path) == []


def test_target_make_overwrites_only_its_own_files(make, cannot, tmp_path):
    board = ("checkerboard", "9x6", "--square", "24mm", "-o", "b.pdf")
    assert make(*board)[0] == 0
    assert make(*board)[0] == 0
    assert "b.json: exists and describes another board" in cannot(*board[:3], "20mm", "-o", "b.pdf")
    assert load_board(tmp_path / "b.json").square == 0.024
    for name in ("other.pdf", "other.svg"):
        (tmp_path / name).write_text("a drawing of someone else's")
        assert f"{name}: exists and was not written by omnisight" in cannot(*board[:4], "-o", "other.pdf")
        (tmp_path / name).unlink()
    camera = save(TRUTH, tmp_path / "camera.json").path
    kept = camera.read_bytes()
    assert "exists and is no target, so it is not overwritten" in cannot(*board[:4], "-o", "camera.pdf")
    assert camera.read_bytes() == kept
    assert "camera.pdf" not in file_names(tmp_path)


def test_unknown_action_is_a_usage_error(run):
    assert run("target", "bake", "checkerboard", "9x6")[0] == 2
