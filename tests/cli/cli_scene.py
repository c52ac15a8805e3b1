"""Shared by the tests of the command line: a camera, its board, and helpers for output and damaged files."""

import cv2
import numpy as np

from drawn import CENTRE, FOCAL, SIZE
from jpegs import jpeg
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.images import read_image, write_image
from omnisight.models import model_class
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6)
TRUTH = Camera(model_class("equidistant")(FOCAL, FOCAL, *CENTRE), SIZE, theta_max=1.4)
QUICK = ("--pattern", "9x6", "--model", "equidistant")


def project_boards(count, seed=0):
    """Return corners (count, 54, 2) of tilted boards in front of the camera."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        turn = so3.exp(np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-2, 2)]))
        middle = np.array([*rng.uniform(-6, 6, 2), rng.uniform(6, 10)])
        pixels, _ = TRUTH.project((BOARD.points - BOARD.points.mean(0)) @ turn.T + middle)
        if TRUTH.in_image(pixels).all():
            found.append(pixels + rng.normal(0, 0.1, pixels.shape))
    return np.array(found)


def image_rows(out):
    """Return the rows of the table of images by image name."""
    lines = out.splitlines()
    assert lines[0].split()[:6] == ["image", "corners", "rms", "px", "max", "px"]
    rows = lines[1 : lines.index("")]
    assert rows
    return {line.split()[0]: line for line in rows}


def file_names(folder):
    return sorted(path.name for path in folder.iterdir())


def remarks(out):
    """Return the remarks that `omnisight calibrate --verbose` prints."""
    return [line.removeprefix("remark").strip() for line in out.splitlines() if line.startswith("remark ")]


def raises_error(error):
    def function(*_, **__):
        raise error

    return function


def damage_image(path, damage):
    """Replace an image file by a damaged one."""
    good = read_image(path)
    path.unlink()
    match damage:
        case "text":
            path.with_suffix(".jpg").write_text("no image data")
        case "empty":
            path.with_suffix(".jpg").write_bytes(b"")
        case "truncated":
            path.with_suffix(".jpg").write_bytes(jpeg(good)[:-2000])
        case "HEIC":
            path.with_suffix(".jpg").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
        case "LFS":
            path.with_suffix(".jpg").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
        case "black":
            write_image(path, np.zeros_like(good))
        case "damaged":
            data = bytearray(cv2.imencode(".png", good)[1].tobytes())
            data[len(data) // 2] ^= 255
            path.write_bytes(bytes(data))
