"""Detected corners of real cameras, to compare solvers on: the same for all."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.io import loadmat

import omnisight as om

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parent.parent.parent / "shared/data"))

SIZES = {
    "kaidan": (640, 480),
    "mei": (1280, 1024),
    "fish1": (1032, 778),
    "camo": (1280, 960),
    "fstereo_left": (960, 600),
    "fstereo_right": (960, 600),
    "ai360_a": (1920, 1920),
    "derlunz": (1000, 750),
}


@dataclass(frozen=True)
class Corners:
    """A set of views with the (width, height) of its pictures; `folds` more rounds of holding out, 0 for none."""

    name: str
    views: om.BoardViews
    size: tuple[int, int]
    folds: int = 0


def corner_sets() -> Iterator[Corners]:
    """Give every set that is there."""
    for name, size in SIZES.items():
        if (path := DATA / "corners" / f"{name}.npz").exists():
            yield Corners(name, detected(path), size)
    contrib = DATA / "detected_corners_opencv_contrib"
    if contrib.exists():
        mono, pair = (contrib / f"contrib_omni_{kind}_data.xml" for kind in ("calib", "stereocalib"))
        yield Corners("contrib", stored(mono, "imagePoints"), (1280, 960))
        for side, number in (("left", 1), ("right", 2)):
            yield Corners(f"contrib_stereo_{side}", stored(pair, f"imagePoints{number}"), (704, 576))
    if (path := DATA / "babelcalib_ov_plane" / "train.mat").exists():
        yield Corners("babelcalib_ov_plane", babelcalib(path), (1280, 800), folds=3)


def detected(path: Path) -> om.BoardViews:
    """Read the corners of whole boards, columns x rows, the square as the unit."""
    with np.load(path) as stored:
        columns, rows = (int(n) for n in stored["pattern"])
        corners, names = stored["corners"].astype(float), [Path(str(name)).name for name in stored["files"]]
    points = om.Checkerboard(columns, rows).points
    return om.BoardViews.of([(points, pixels) for pixels in corners], names)


def stored(path: Path, key: str) -> om.BoardViews:
    """Read OpenCV's own detected corners."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    points, pixels = storage.getNode("objectPoints"), storage.getNode(key)
    pairs = [(points.at(i).mat().reshape(-1, 3), pixels.at(i).mat().reshape(-1, 2)) for i in range(points.size())]
    return om.BoardViews.of(pairs)


def babelcalib(path: Path) -> om.BoardViews:
    """Read BabelCalib's corners, of which every view shows others; its pixels count from 1."""
    data = loadmat(path, squeeze_me=True, struct_as_record=False)
    flat = data["boards"].X.T
    points = np.concatenate([flat, np.zeros((len(flat), 1))], -1)
    return om.BoardViews.of([(points[c.cspond[0].astype(int) - 1], c.x.T - 1.0) for c in data["corners"]])
