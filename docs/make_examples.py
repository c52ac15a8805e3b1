"""Run the examples, and store their printed output and small copies of their images for the page of the examples.

`python docs/make_examples.py [NAME...]` runs all examples, or those whose file names begin with a NAME.
"""

import contextlib
import io
import itertools
import re
import runpy
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

import omnisight as om

ROOT = Path(__file__).resolve().parent.parent
OUTPUTS = ROOT / "docs" / "assets" / "examples"
FOLDER = "output"  # stands for the folder of the files in the stored text
WIDTH_PX = 800
GAP_PX = 6
MAX_BYTES = 60_000  # of an image in the documentation
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")

# The rows of images that the page shows for each example that writes images.
IMAGES = {
    "02_calibrate": (("image0.png", "image1.png", "image2.png"),),
    "03_panorama": (("image.jpg", "window.jpg"), ("panini.jpg", "ideal_fisheye.jpg"), ("sphere.jpg",)),
    "04_mirror": (("mirror.jpg", "planet.jpg"), ("cylinder.jpg",), ("left.jpg", "front.jpg", "right.jpg", "back.jpg")),
    "06_video_remapper": (("last.jpg",),),
    "08_rig": (("pair-front.jpg", "pair-back.jpg", "pair.jpg"), ("ring-cam0.jpg", "ring-cam4.jpg", "ring.jpg")),
    "09_surround": (("front.jpg", "above.jpg"), ("left.jpg", "back.jpg", "right.jpg")),
    "11_refine_photometrically": (("first.jpg",),),
    "12_training_data": (("0.jpg", "1.jpg", "2.jpg", "3.jpg"),),
}


def main(names: list[str]) -> None:
    """Store the outputs of the examples whose names begin with one of `names`; without names, of all."""
    OUTPUTS.mkdir(exist_ok=True)
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        if names and not path.stem.startswith(tuple(names)):
            continue
        with tempfile.TemporaryDirectory() as folder:
            text = run_example(path, Path(folder))
            (OUTPUTS / f"{path.stem}.txt").write_text(text, encoding="utf-8")
            if path.stem in IMAGES:
                rows = [[om.read_image(Path(folder) / name) for name in row] for row in IMAGES[path.stem]]
                write_small(OUTPUTS / f"{path.stem}.jpg", montage(rows))
        print(path.stem)


def run_example(path: Path, folder: Path) -> str:
    """Run an example that writes to `folder`; return what it prints, with `FOLDER` in place of the folder."""
    printed, arguments = io.StringIO(), sys.argv
    sys.argv = [str(path), str(folder)]
    try:
        with contextlib.redirect_stdout(printed):
            runpy.run_path(str(path), run_name="__main__")
    finally:
        sys.argv = arguments
    lines = printed.getvalue().replace(str(folder), FOLDER).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def differing_lines(stored: str, printed: str) -> list[tuple[str, str]]:
    """Return the pairs of lines that differ by more than spaces, times, or 5 % or 0.02 of a number."""
    pairs = itertools.zip_longest(stored.splitlines(), printed.splitlines(), fillvalue="")
    return [(old, new) for old, new in pairs if not _are_close(old, new)]


def _are_close(old: str, new: str) -> bool:
    # Times depend on the machine.
    old, new = (re.sub(r"\d+(?= (ms|fps)\b)", "0", line) for line in (old, new))
    texts = ["".join(NUMBER.sub("#", line).split()) for line in (old, new)]
    numbers = [np.array([float(number) for number in NUMBER.findall(line)]) for line in (old, new)]
    return texts[0] == texts[1] and np.allclose(*numbers, rtol=0.05, atol=0.02)


def montage(rows: list[list[np.ndarray]]) -> np.ndarray:
    """Return rows of images, each row reduced to the width of the page and to images of one height."""
    joined = [_joined(row) for row in rows]
    return np.vstack([part for row in joined for part in (_gap(GAP_PX, row.shape[1]), row)][1:])


def _joined(row: list[np.ndarray]) -> np.ndarray:
    aspects = [image.shape[1] / image.shape[0] for image in row]
    space = WIDTH_PX - GAP_PX * (len(row) - 1)
    height = round(min(space / sum(aspects), max(len(image) for image in row)))
    widths = [round(height * aspect) for aspect in aspects]
    if abs(space - sum(widths)) <= len(row):  # a row of small images does not fill the width
        widths[-1] += space - sum(widths)
    parts = [cv2.resize(image, (w, height), interpolation=cv2.INTER_AREA) for image, w in zip(row, widths, strict=True)]
    return np.hstack([part for image in parts for part in (_gap(height, GAP_PX), image)][1:])


def _gap(height: int, width: int) -> np.ndarray:
    return np.full((height, width, 3), 255, np.uint8)


def write_small(path: Path, image: np.ndarray) -> None:
    """Write a JPEG of the highest quality that needs less than `MAX_BYTES`."""
    data = next(data for data in _jpegs(image) if len(data) < MAX_BYTES)
    path.write_bytes(data)


def _jpegs(image: np.ndarray) -> Iterator[bytes]:
    for quality in range(88, 30, -4):
        yield cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


if __name__ == "__main__":
    main(sys.argv[1:])
