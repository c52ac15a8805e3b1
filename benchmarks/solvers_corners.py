"""Detected corners of real cameras, the common input of the solvers that are compared."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
CONTRIB = {
    "contrib": ("contrib_omni_calib_data.xml", "imagePoints", (1280, 960)),
    "contrib_stereo_left": ("contrib_omni_stereocalib_data.xml", "imagePoints1", (704, 576)),
    "contrib_stereo_right": ("contrib_omni_stereocalib_data.xml", "imagePoints2", (704, 576)),
}


@dataclass(frozen=True)
class Corners:
    """Observations with the (width, height) of their images, and the number of cross-validation folds or 0."""

    name: str
    views: om.Observations
    size: tuple[int, int]
    folds: int = 0


def corner_sets() -> Iterator[Corners]:
    """Yield every set that is present in the data folder."""
    for name, size in SIZES.items():
        if (path := DATA / "corners" / f"{name}.npz").exists():
            yield read(name, path, size)
    for name, (file, which, size) in CONTRIB.items():
        if (path := DATA / "detected_corners_opencv_contrib" / file).exists():
            yield read(name, path, size, which)
    if (path := DATA / "babelcalib_ov_plane" / "train.mat").exists():
        yield read("babelcalib_ov_plane", path, folds=3)


def read(
    name: str, path: Path, size: tuple[int, int] | None = None, which: str | None = None, folds: int = 0
) -> Corners:
    """Read a corner file; lengths are in squares."""
    search = om.read_corners([path], size=size, which=which)
    return Corners(name, om.Observations.from_detections(search), search.size, folds)
