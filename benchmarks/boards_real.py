"""Board detection in the real image sets: recall, speed, and accuracy of the calibration.

The variable OMNISIGHT_DATA names the folder of the sets; missing sets are left out. Ours gets no
pattern. A calibration on our corners judges the corners of every detector: those more than 2 px from where the robust
fit of their image predicts are wrong.
"""

import os
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.boards_detectors import DETECTORS, NEAR, Found, classic, nothing, sector_based
from omnisight.calibration.bundle_adjustment import State, refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import linear_board_poses
from omnisight.images import read_image, to_gray8
from omnisight.models import CameraModel
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.targets import Checkerboard, detect_boards
from omnisight.targets.observations import Observations

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parent.parent.parent / "shared/data"))


@dataclass(frozen=True)
class ImageSet:
    """Images of one camera; only OpenCV gets the columns and rows of the board."""

    files: str
    columns: int
    rows: int
    redistributable: bool = False

    @property
    def paths(self) -> list[Path]:
        return sorted(p for p in DATA.glob(self.files) if p.suffix.lower() in (".jpg", ".png"))


SETS = {
    "kaidan": ImageSet("kaidan_catadioptric/*.jpg", 11, 7, redistributable=True),
    "mei": ImageSet("mei_paracatadioptric/*.png", 8, 6),
    "fisheye1": ImageSet("fisheye1_urban/*.jpg", 8, 6),
    "camodocal": ImageSet("camodocal_fisheye/*.png", 9, 6),
    "sourishg left": ImageSet("stereo_fisheye_sourishg/left*.jpg", 9, 6),
    "sourishg right": ImageSet("stereo_fisheye_sourishg/right*.jpg", 9, 6),
    "ai360": ImageSet("ai360_lens_a/*.jpg", 11, 8),
    "gopro": ImageSet("gopro_derlunz_static_board/*.JPG", 15, 9),
}

PEERS = {"OpenCV classic": classic, "OpenCV SB": sector_based}


@dataclass(eq=False)
class SetResult:
    """What a set gave: by detector its corners in each image, which of them are wrong, and figures."""

    name: str
    paths: list[Path]
    board: Checkerboard
    found: dict[str, list[Found]]
    wrong: dict[str, list[NDArray[np.bool_]]] = field(default_factory=dict)
    figures: dict[str, dict[str, float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def measure(only: Iterable[str] = ()) -> list[SetResult]:
    """Run the sets, or those whose name begins as one of `only`."""
    only = tuple(only)
    chosen = {name: s for name, s in SETS.items() if s.paths and (not only or name.startswith(only))}
    if not chosen:
        raise SystemExit(f"no set of images found in {DATA}; OMNISIGHT_DATA says where they are")
    first = next(iter(chosen.values()))
    detect_boards(first.paths[:2], Checkerboard(first.columns, first.rows), cache=False)  # compiled and warm
    return [run_set(name, image_set) for name, image_set in chosen.items()]


def run_set(name: str, image_set: ImageSet) -> SetResult:
    paths, board = image_set.paths, Checkerboard(image_set.columns, image_set.rows)
    found, seconds = {}, {}
    cv2.setNumThreads(2)
    start = time.perf_counter()
    search = detect_boards(paths, None, cache=False)
    seconds["omnisight"] = time.perf_counter() - start
    notes = [] if search.hint is None else [search.hint]
    seen = search.board
    if not isinstance(seen, Checkerboard) or {seen.columns, seen.rows} != {board.columns, board.rows}:
        notes.append(f"takes the board for one of {seen}")
        search = detect_boards(paths, board, cache=False)
    else:
        board = seen
    found["omnisight"] = [
        nothing() if d is None else Found(d.ids, d.pixels, d.covariance) for d in (p.detection for p in search.images)
    ]
    extra = sum(max(len(p.boards) - 1, 0) for p in search.images)
    if extra:
        notes.append(f"{extra} more boards seen in images that show one")
    for peer in PEERS:
        found[peer], seconds[peer] = _timed(peer, paths, Checkerboard(image_set.columns, image_set.rows))
    result = SetResult(name, paths, board, found, notes=notes)
    size = cv2.imread(str(paths[0]), 0).shape[::-1]
    _judge(result, size, Checkerboard(image_set.columns, image_set.rows))
    for detector, each in found.items():
        result.figures[detector] = {
            "images": len(paths),
            "boards": sum(len(f) > 0 for f in each),
            "corners": sum(map(len, each)),
            "wrong": int(sum(w.sum() for w in result.wrong[detector])),
            "seconds": seconds[detector],
        }
    for peer in PEERS:
        mine, theirs, views, corners = _common(result, peer, size)
        result.figures[peer] |= {"rms": theirs, "our_rms": mine, "common_views": views, "common_corners": corners}
    return result


def _timed(peer: str, paths: list[Path], board: Checkerboard) -> tuple[list[Found], float]:
    """Run a peer over images both by two threads of its own and over a pool of two; its faster time counts."""

    def one(path: Path) -> Found:
        return DETECTORS[peer](to_gray8(read_image(path)), board)

    times = []
    for threads in (1, 2):
        cv2.setNumThreads(threads)
        start = time.perf_counter()
        if threads == 1:
            with ThreadPoolExecutor(2) as pool:
                found = list(pool.map(one, paths))
        else:
            found = [one(path) for path in paths]
        times.append(time.perf_counter() - start)
    return found, min(times)


def _judge(result: SetResult, size: tuple[int, int], theirs: Checkerboard) -> None:
    """Mark the wrong corners of all detectors by the camera that ours calibrate."""
    mine = [(i, f) for i, f in enumerate(result.found["omnisight"]) if len(f)]
    for name, each in result.found.items():
        result.wrong[name] = [np.zeros(len(f), bool) for f in each]
    try:
        points = [result.board.points[f.ids] for _, f in mine]
        camera = calibrate(Observations.from_arrays(points, [f.pixels for _, f in mine], size=size))
    except ValueError as error:
        result.notes.append(f"no referee: {error}")
        return
    result.notes.append(f"referee: {camera.camera.model.__class__.__name__}, rms {camera.rms:.3f} px")
    for name, each in result.found.items():
        board = result.board if name == "omnisight" else theirs
        for i, f in enumerate(each):
            if len(f):
                result.wrong[name][i] = _misfits(camera.camera.model, board.points[f.ids], f.pixels)


def _misfits(model: CameraModel, points: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which corners lie more than 2 px from the robust fit of their board's pose, with a known camera."""
    size = (int(pixels[:, 0].max()) + 1, int(pixels[:, 1].max()) + 1)  # any that holds them
    view = Observations.from_arrays([points], [pixels], size=size)
    rotations, translations = linear_board_poses(view, model.unproject(pixels)[0])
    if not np.isfinite(rotations).all():
        return np.ones(len(pixels), bool)
    state = State(model, rotations, translations)
    return refine(state, view, free_parameters=FreeParameters.none(model)).state.lengths(view) > NEAR


def _common(result: SetResult, peer: str, size: tuple[int, int]) -> tuple[float, float, int, int]:
    """Return rms of one model calibrated on the corners that ours and a peer share, by each; then views and corners."""
    mine, theirs = [], []
    for a, b in zip(result.found["omnisight"], result.found[peer], strict=True):
        if not len(a) or not len(b):
            continue
        distance, nearest = cKDTree(b.pixels).query(a.pixels)
        near = distance < NEAR
        if near.sum() >= 12:
            points = result.board.points[a.ids[near]]
            mine.append((points, a.pixels[near]))
            theirs.append((points, b.pixels[nearest[near]]))
    try:
        options = CalibrateOptions(model="mei", loss="squared")
        observations = (Observations.from_arrays(*zip(*views, strict=True), size=size) for views in (mine, theirs))
        fits = [calibrate(views, options).rms for views in observations]
    except ValueError:
        return float("nan"), float("nan"), len(mine), sum(len(p) for p, _ in mine)
    return fits[0], fits[1], len(mine), sum(len(p) for p, _ in mine)


def figures(results: list[SetResult]) -> dict[str, dict[str, object]]:
    return {r.name: {"board": str(r.board), "notes": r.notes, **r.figures} for r in results}


def table(rows: dict[str, dict[str, object]]) -> str:
    """Return the figures as a Markdown table."""
    lines = [
        f"| {' / '.join(DETECTORS)} | board | boards | corners | wrong | seconds"
        " | rms, ours / classic | rms, ours / SB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        each = [row[detector] for detector in DETECTORS]
        rms = [f"{row[p]['our_rms']:.3f} / {row[p]['rms']:.3f} ({row[p]['common_corners']})" for p in PEERS]
        columns = [" / ".join(str(e[key]) for e in each) for key in ("boards", "corners", "wrong")]
        columns[0] += f" of {each[0]['images']}"
        columns.append(" / ".join(f"{e['seconds']:.2f}" for e in each))
        lines.append(f"| {name} | {row['board']} | {' | '.join(columns)} | {' | '.join(rms)} |")
    return "\n".join(lines)


def hardest(result: SetResult) -> int:
    """Return the image that the peers find least of; among several the one whose board is least sharp."""

    def ease(i: int) -> tuple[int, float]:
        peers = sum(len(result.found[p][i]) - int(result.wrong[p][i].sum()) for p in PEERS)
        gray = to_gray8(read_image(result.paths[i]))
        corners = np.concatenate([f[i].pixels for f in result.found.values()])
        if len(corners):
            (left, top), (right, bottom) = np.maximum(corners.min(0), 0).astype(int), corners.max(0).astype(int) + 2
            gray = gray[top:bottom, left:right]
        return peers, float(cv2.Laplacian(gray, cv2.CV_32F).var() / max(float(gray.var()), 1.0))

    return min(range(len(result.paths)), key=ease)
