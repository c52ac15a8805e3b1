"""omnisight calibrate: the requested board, and the one in the images."""

import json

import numpy as np
import pytest
from cli_scene import raises_error, remarks

from drawn import POSES, shot
from omnisight.images import write_image


def test_columns_and_rows_may_be_swapped_and_squares_counted(run, shots):
    straight, swapped, squares = (
        json.loads(run("calibrate", shots, *board, "--model", "equidistant", "--json")[1])
        for board in (("--pattern", "9x6"), ("--pattern", "6x9"), ("--squares", "10x7"))
    )
    assert squares["rms"] == straight["rms"]
    assert swapped["rms"] == pytest.approx(straight["rms"], rel=1e-3)
    assert [image["found"] for image in swapped["images"]] == [True] * 6


@pytest.mark.parametrize(
    ("option", "requested"),
    [
        (("--pattern", "10x7"), "10x7 (11x8 squares)"),
        (("--pattern", "7x5"), "7x5 (8x6 squares)"),
        (("--squares", "9x6"), "8x5 (9x6 squares)"),
    ],
)
def test_wrong_pattern_gives_a_hint_with_the_right_one(refuses, shots, option, requested):
    message = refuses("calibrate", shots, *option)
    assert f"{requested.split()[0]} board detected in 0 of 6 images" in message
    assert "found a grid of 9x6 inner corners (10x7 squares) in 6/6 images" in message
    assert f"but the requested board is {requested}. Use --pattern 9x6 or --squares 10x7." in message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--pattern", "9"),
            "cannot read the pattern '9': expected COLUMNSxROWS, inner corners of a checkerboard",
        ),
        (
            ("--squares", "10by7"),
            "cannot read the squares '10by7': expected COLUMNSxROWS, squares of a checkerboard, such as 10x7",
        ),
        (("--squares", "3x9"), "a board needs 3x3 inner corners or more, got 2x8 (3x9 squares)"),
        (("--pattern", "9x6", "--squares", "10x7"), "specify either --pattern, the inner corners, or --squares"),
        (("--target", "board.json", "--squares", "10x7"), "specify either --target or --pattern and --square"),
        (("--pattern", "2x9"), "a board needs 3x3 inner corners or more, got 2x9"),
        (("--square", "30"), "the length '30' has no unit: write 30mm or 30m"),
        (("--square", "0mm"), "the length '0mm' must be positive"),
        (("--square", "30px"), "the length '30px' has an unknown unit 'px': use one of mm, cm, m, in, um"),
        (
            ("--model", "fisheye9"),
            "unknown camera model 'fisheye9' (did you mean fisheye624?); there are: auto",
        ),
    ],
)
def test_invalid_option_is_reported_before_any_image_is_read(refuses, shots, monkeypatch, options, message):
    monkeypatch.setattr("omnisight.images.read.read_bytes", raises_error(AssertionError("an image was read")))
    monkeypatch.setattr("omnisight.targets.image_files.read_bytes", raises_error(AssertionError("an image was read")))
    assert message in refuses("calibrate", shots, *options)


def test_unknown_loss_is_reported_with_the_known_ones(run, shots):
    status, out, err = run("calibrate", shots, "--loss", "cauchy")
    assert status == 2
    assert "huber" in out + err
    assert "squared" in out + err


def test_no_board_in_any_image_asks_for_the_pattern(refuses, tmp_path):
    for i in range(3):
        write_image(tmp_path / f"{i}.png", np.full((480, 640), 90 * i, np.uint8))
    message = refuses("calibrate", tmp_path)
    assert (
        "no checkerboard, markers or grid of circles detected in 3 images: if they show a board, specify --pattern"
        in message
    )
    message = refuses("calibrate", tmp_path, "--pattern", "9x6")
    assert "9x6 board detected in 0 of 3 images: does it have 9x6 inner corners, which are 10x7 squares?" in message
    assert "0.png: no 9x6 board detected" in message


def test_equirectangular_images_need_no_calibration(refuses, tmp_path):
    for i in range(2):
        write_image(tmp_path / f"{i}.png", np.full((240, 480), 90 * i, np.uint8))
    assert "equirectangular images (2:1) need no calibration; if they show" in refuses("calibrate", tmp_path)


def test_symmetric_board_is_noted(run, tmp_path):
    for i, view in enumerate(POSES[:4]):
        write_image(tmp_path / f"{i}.png", shot(view, 8, 6)[0])
    status, out, _ = run("calibrate", tmp_path, "--model", "equidistant", "--verbose")
    assert status == 0
    (remark,) = [remark for remark in remarks(out) if "upside-down" in remark]
    assert remark.startswith(
        "the 8x6 board looks the same upside-down, which is unambiguous for one camera but not for"
    )
    assert remark.endswith("use one of 8x5 for those")
