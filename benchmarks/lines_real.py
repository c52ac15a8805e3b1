"""Calibration from lines on real images, compared with the board calibration of the same camera.

`python -m benchmarks.lines real [sets]`; the variable OMNISIGHT_DATA names the folder of the images.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines import LineObservations, LinesCalibration, PixelChains, bearing_sigma, detect_lines
from omnisight.calibration.lines.focal_scale import scale_ambiguity
from omnisight.camera import Camera
from omnisight.formats import load
from omnisight.geometry import rotation as so3
from omnisight.images import read_image
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.pipeline.calibration.calibrate_lines import calibrate_lines
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.targets import Checkerboard, Detection, detect_boards
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parent.parent.parent / "shared/data"))
SETS = {
    "kaidan": ("kaidan_catadioptric/*.jpg", Checkerboard(11, 7)),
    "mei": ("mei_paracatadioptric/*.png", Checkerboard(8, 6)),
    "sourishg left": ("stereo_fisheye_sourishg/left*.jpg", Checkerboard(9, 6)),
    "camodocal": ("camodocal_fisheye/*.png", Checkerboard(9, 6)),
}
# Published calibrations.
FILES = (
    "with_calibration/woodscape_front/front.json",
    "with_calibration/ocam_test_fisheye/calib_results_fisheye.txt",
    "with_calibration/ocam_matsuren/calib_results_0.txt",
)
# Images whose edges are detected, evenly spaced in a set.
EDGE_IMAGES = 8
STEP = 12  # px between compared pixels


@dataclass(frozen=True)
class Compared:
    """Bearing differences of two calibrations of one camera after a best rotation, degrees.

    Attributes
    ----------
    rms, maximum
        Difference of the bearings.
    stated
        Standard deviation that the calibration from lines states, rms over the same pixels.
    board
        Standard deviation that the board calibration states.
    """

    rms: float
    maximum: float
    stated: float
    board: float

    @property
    def ratio(self) -> float:
        """The difference divided by the combined standard deviation."""
        return self.rms / float(np.hypot(self.stated, self.board))


def compare(found: LinesCalibration, board: Calibration) -> Compared:
    """Compare at the pixels inside the calibrated field of view of both."""
    camera = found.camera
    size = np.array(camera.size)
    pixels = np.stack(np.meshgrid(*(np.arange(STEP / 2, n, STEP) for n in size)), -1).reshape(-1, 2)
    a, seen_a = camera.model.unproject_numpy(pixels)
    b, seen_b = board.camera.model.unproject_numpy(pixels)
    with np.errstate(invalid="ignore"):
        common = seen_a & seen_b & (a[:, 2] > np.cos(camera.theta_max)) & (b[:, 2] > np.cos(board.camera.theta_max))
    a, b, pixels = a[common], b[common], pixels[common]
    off = np.linalg.norm(a @ so3.nearest(b.T @ a).T - b, axis=1)
    own = bearing_sigma(board.camera.model, board.camera.covariance, pixels)
    stated = found.bearing_sigma_at(pixels)
    return Compared(*(float(np.degrees(x)) for x in (np.sqrt((off**2).mean()), off.max(), stated, own)))


def rows_and_columns(points: Array, ids: Array, pixels: Array) -> Iterator[Array]:
    """Yield the corners (n, 2) of each row and column with at least four."""
    for axis in (0, 1):
        for value in np.unique(points[ids, axis]):
            chosen = np.flatnonzero(points[ids, axis] == value)
            if len(chosen) >= 4:
                yield pixels[chosen[np.argsort(points[ids[chosen], 1 - axis])]]


def measure(name: str) -> Iterator[tuple[str, LinesCalibration, Compared]]:
    """Calibrate a set from its boards, from their rows and columns, and from the edges of its scenes."""
    truth, seen, paths = on_boards(name, "mei")
    board, size = SETS[name][1], truth.camera.size
    rows = [(line, i) for i, d in seen for line in rows_and_columns(board.points, d.ids, d.pixels)]
    chains = PixelChains.from_arrays([r for r, _ in rows], [i for _, i in rows])
    found = calibrate_lines(LineObservations(chains, size, all_inliers=True))
    yield "rows of corners", found, compare(found, truth)
    few = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, EDGE_IMAGES).round().astype(int))]
    found = calibrate_lines(detect_lines(few))
    yield f"edges of {len(few)} scenes", found, compare(found, truth)


def shapes(camera: Camera) -> tuple[float, float, float]:
    """Return the factor on tan(theta) of the unified model fitted to exact lines of a camera.

    It is the scale error caused by the camera's radial profile alone. Also return the scale ambiguity, which is the
    stated uncertainty, and the rms distance of the lines.
    """
    rng = np.random.default_rng(0)
    reach = min(camera.theta_max or np.pi, np.radians(100))
    arcs: list[Array] = []
    while len(arcs) < 60:
        across = np.linalg.svd(rng.normal(size=(1, 3)))[2][1:]
        start = rng.uniform(0, 2 * np.pi)
        turn = np.linspace(start, start + np.radians(rng.uniform(20, 70)), 40)[:, None]
        bearings = np.cos(turn) * across[0] + np.sin(turn) * across[1]
        pixels, valid = camera.model.project_numpy(bearings)
        if valid.all() and (bearings[:, 2] > np.cos(reach)).all() and camera.in_image(pixels).all():
            arcs.append(pixels)
    observations = LineObservations(PixelChains.from_arrays(arcs), camera.size, all_inliers=True)
    found = calibrate_lines(observations)
    pixels = np.concatenate(arcs)
    a, b = found.camera.model.unproject_numpy(pixels)[0], camera.model.unproject_numpy(pixels)[0]
    factors = np.exp(np.linspace(-0.2, 0.2, 201))
    factor = float(min(factors, key=lambda k: rotated_difference(a * (k, k, 1.0), b)))
    return factor, scale_ambiguity(found.camera.model, a), found.rms


def rotated_difference(a: Array, b: Array) -> float:
    """Return the angle (rms) between directions (N, 3) after a best rotation."""
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    return float(np.sqrt(((a @ so3.nearest(b.T @ a).T - b) ** 2).sum(1).mean()))


def report_shapes(only: list[str]) -> None:
    """Print the scale error and ambiguity of real cameras."""
    print("| camera | its model | factor on tan(theta) | families disagree | lines off px |")
    print("|---|---|---|---|---|")

    def row(name: str, camera: Camera) -> None:
        factor, doubt, rms = shapes(camera)
        print(f"| {name} | {camera.model.name} | {factor:.3f} | {doubt:.3f} | {rms:.3f} |", flush=True)

    for name, (pattern, _) in SETS.items():
        if (only and not name.startswith(tuple(only))) or not list(DATA.glob(pattern)):
            continue
        for model in ("kannala_brandt", "mei"):
            row(name, on_boards(name, model)[0].camera)
    for file in FILES:
        if (DATA / file).exists() and (not only or file.startswith(tuple(only))):
            row(Path(file).name, load(DATA / file))


def on_boards(name: str, model: str) -> tuple[Calibration, list[tuple[int, Detection]], list[Path]]:
    """Calibrate a set from its boards; return the calibration, the detections by image and the image files."""
    pattern, board = SETS[name]
    paths = sorted(DATA.glob(pattern))
    seen = [(i, p.detection) for i, p in enumerate(detect_boards(paths, board).images) if p.detection is not None]
    points, pixels = [board.points[d.ids] for _, d in seen], [d.pixels for _, d in seen]
    height, width = read_image(paths[0]).shape[:2]
    observations = Observations.from_arrays(points, pixels, size=(width, height))
    return calibrate(observations, CalibrateOptions(model=model)), seen, paths


def report(only: list[str]) -> None:
    """Print the table."""
    print("| images | lines from | lines | rms px | difference deg | worst deg | stated deg | board deg | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in SETS:
        if (only and not name.startswith(tuple(only))) or not list(DATA.glob(SETS[name][0])):
            continue
        for source, found, c in measure(name):
            print(
                f"| {name} | {source} | {len(found.lines)} | {found.rms:.3f} | {c.rms:.2f} | {c.maximum:.2f} |"
                f" {c.stated:.2f} | {c.board:.2f} | {c.ratio:.1f} |",
                flush=True,
            )
