"""Target files: omnisight's, Kalibr's, and invalid ones."""

import contextlib
import json
import os

import numpy as np
import pytest
from example_boards import BOARDS, aprilgrid, charuco, checkerboard, circles

from omnisight.targets.target_file import load_board, save_board

APRILGRID = """target_type: 'aprilgrid' #gridtype
tagCols: 6               #number of apriltags
tagRows: 5               #number of apriltags
tagSize: 0.088           #size of apriltag, edge to edge [m]
tagSpacing: 0.3          #ratio of space between tags to tagSize
"""
CHECKERBOARD = """%YAML:1.0
---
target_type: "checkerboard"
# number of internal chessboard corners
targetCols: 9
targetRows: 6
rowSpacingMeters: 0.03
colSpacingMeters: 3.0e-2
"""
CIRCLES = """target_type: circlegrid
targetCols: 4
targetRows: 11
spacingMeters: 0.02
asymmetricGrid: True
"""


@pytest.fixture
def written(tmp_path):
    def write(content):
        path = tmp_path / "board.json"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.mark.parametrize("board", BOARDS)
def test_board_round_trips_through_its_file(board, tmp_path):
    path = tmp_path / "board.json"
    save_board(board, path)
    assert load_board(path) == board
    assert [file.name for file in tmp_path.iterdir()] == ["board.json"]


def test_file_has_the_documented_content(tmp_path):
    path = tmp_path / "board.json"
    save_board(checkerboard(9, 6, 0.03), path)
    assert path.read_text() == '{"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}\n'
    save_board(checkerboard(9, 6), path)
    assert load_board(path) == checkerboard(9, 6)


@pytest.mark.parametrize(
    ("text", "board"),
    [
        (APRILGRID, aprilgrid(6, 5, 0.088, 0.3)),
        (CHECKERBOARD, checkerboard(9, 6, 0.03)),
        (CIRCLES, circles(4, 11, 0.02)),
        ('{"tagCols": 6, "tagRows": 5, "tagSize": 0.088, "tagSpacing": 0.3}', aprilgrid(6, 5, 0.088, 0.3)),
        (APRILGRID + "low_id: 0\n", aprilgrid(6, 5, 0.088, 0.3)),
        (APRILGRID.replace("\n", "\r\n"), aprilgrid(6, 5, 0.088, 0.3)),
        (APRILGRID.encode("utf-16"), aprilgrid(6, 5, 0.088, 0.3)),
        (b"\xef\xbb\xbf" + CIRCLES.encode(), circles(4, 11, 0.02)),
        (
            '{"target": "charuco", "columns": 9, "rows": 6, "square": "3cm", "marker": "0.022 m"}',
            charuco(9, 6, 0.03, 0.022),
        ),
    ],
)
def test_kalibr_and_what_people_write_is_read(written, text, board):
    assert load_board(written(text)) == board


def test_a_length_reads_back_to_the_last_bit_that_matters(tmp_path):
    board = charuco(9, 6, 0.0254 * 1.1, 1 / 70)
    save_board(board, tmp_path / "board.json")
    read = load_board(tmp_path / "board.json")
    assert (read.square, read.marker) == pytest.approx((board.square, board.marker), rel=1e-9)


@pytest.mark.parametrize("content", [b"%PDF-1.4\n%\xe2\xe3", b"<svg/>", b"<?xml version='1.0'?>"])
def test_the_print_of_a_board_names_the_file_that_describes_it(tmp_path, content):
    path = tmp_path / "print.pdf"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"is the print of a board: .*print\.json"):
        load_board(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty file"),
        ("  \n", "empty file"),
        ("[1, 2]", "line 1 is '[1, 2]': expected JSON, or lines of Kalibr's YAML"),
        ("{", "line 1 is not JSON"),
        ('{"columns": 9}', "target is missing: expected one of aprilgrid, aruco_grid, charuco, checkerboard, circles"),
        ('{"target": "dots"}', "target is 'dots': expected one of"),
        ('{"target": ["a"]}', "target is ['a']: expected one of"),
        ('{"target": "../x"}', "target is '../x': expected one of"),
        ('{"target": "_markers"}', "target is '_markers': expected one of"),
        ('{"target": "checkerboard", "columns": 9}', "the target checkerboard needs rows"),
        ('{"target": "checkerboard", "columns": 9, "rows": NaN}', "rows is nan: expected an integer"),
        ('{"target": "checkerboard", "columns": 9, "rows": 6, "square": "30"}', "square: the length '30' has no unit"),
        ('{"target": "checkerboard", "columns": 9, "rows": 6, "square": 0.03}', "square is 0.03: expected a length"),
        ('{"target": "checkerboard", "columns": 9, "rows": 6, "square": "1e999m"}', "must be positive"),
        ('{"target": "aprilgrid", "columns": 1, "rows": 1, "tag": "1mm", "spacing": Infinity}', "spacing is inf"),
        ('{"target": "checkerboard", "columns": ' + "9" * 5000 + ', "rows": 6}', "integer string conversion"),
        ('{"target": "checkerboard", "columns": 9, "rows": 6, "square": "' + "9" * 500_000 + '"}', "square is '999"),
        ("[" * 500_000, "line 1 is"),
        ('{"target":' * 100_000, "brackets are nested too deeply"),
        (b"\x89PNG\r\n\x1a\n" + bytes(500), "expected JSON"),
        (b" " * 1_000_001, "more than 1000000 bytes"),
        (
            "cam0:\n  camera_model: pinhole\n",
            "target_type is missing: expected JSON with a target, or a target of Kalibr: ",
        ),
        ("target_type: halfmoon", "target_type is 'halfmoon'"),
        (APRILGRID.replace("tagRows", "#"), "tagRows is missing"),
        (APRILGRID.replace("0.088", "8.8cm"), "tagSize is '8.8cm': expected a positive number"),
        (APRILGRID.replace("0.088", ".nan"), "tagSize is '.nan': expected a positive number"),
        (APRILGRID.replace("0.088", "-1"), "tagSize is -1: expected a positive number"),
        (APRILGRID.replace(" 6 ", " 6.5 "), "tagCols is 6.5: expected an integer"),
        (APRILGRID.replace(" 6 ", " 6000 "), "columns is 6000: expected an integer from 1 to 1000"),
        (APRILGRID + "codeOffset: -1\n", "first_marker is -1: expected an integer from 0 to 1000"),
        (APRILGRID + "low_id: 600\n", "an aprilgrid of 6x5 from number 600 needs 630 tags; the family 36h11 has 587"),
        (APRILGRID + "colour: 7\n", "Kalibr's aprilgrid has no 'colour'"),
        (CHECKERBOARD.replace("0.03", "0.04"), "rowSpacingMeters 0.04: a checkerboard has squares"),
        (CIRCLES.replace("True", "3"), "asymmetricGrid is 3: expected true or false"),
        ("tagCols: !!python/object/apply:os.system ['true']\ntarget_type: aprilgrid\n", 'tagCols is "!!python/obj'),
    ],
)
def test_invalid_target_file_raises_with_file_field_and_value(written, text, said):
    path = written(text)
    with pytest.raises(ValueError, match=r"board\.json: ") as caught:
        load_board(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert said in message
    assert len(message) < len(str(path)) + 400


def test_missing_file_and_folder_raise(tmp_path):
    with pytest.raises(ValueError, match=r"none\.json: no such file"):
        load_board(tmp_path / "none.json")
    with pytest.raises(ValueError, match="is a folder, not a target file"):
        load_board(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such files")
def test_pipe_raises_without_blocking(tmp_path):
    os.mkfifo(tmp_path / "board.json")
    with pytest.raises(ValueError, match=r"board\.json: is a pipe or a device"):
        load_board(tmp_path / "board.json")


@pytest.mark.parametrize("text", [APRILGRID, CHECKERBOARD, json.dumps(charuco(9, 6, 0.03, 0.02).to_dict())])
def test_corrupted_files_raise_value_error_only(written, text):
    rng = np.random.default_rng(0)
    for _ in range(200):
        data = bytearray(text.encode())
        for _ in range(rng.integers(1, 6)):
            data[rng.integers(len(data))] = rng.integers(256)
        with contextlib.suppress(ValueError):
            load_board(written(bytes(data)))
