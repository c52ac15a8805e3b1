"""Real corners: does every model that `auto` tries stay where it is when it is started again from elsewhere?"""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy.io import loadmat

from omnisight.calibrate import BoardViews
from omnisight.calibrate.candidates import AUTO, Candidate, starts_of
from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.initialise import initialise, posed
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.geometry import rotation as so3
from omnisight.targets import Checkerboard

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / os.environ.get("OMNISIGHT_DATA", "../shared/data")
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
RESTARTS = 4


def sets() -> Iterator[tuple[str, BoardViews, tuple[int, int]]]:
    """Give the sets that are there: name, corners, size of the pictures."""
    for name, size in SIZES.items():
        if (path := DATA / f"corners/{name}.npz").exists():
            with np.load(path) as stored:
                points = Checkerboard(*(int(n) for n in stored["pattern"])).points
                yield name, BoardViews.of([(points, pixels) for pixels in stored["corners"].astype(float)]), size
    folder = DATA / "detected_corners_opencv_contrib"
    for file, names in (("calib", ("imagePoints",)), ("stereocalib", ("imagePoints1", "imagePoints2"))):
        if not (path := folder / f"contrib_omni_{file}_data.xml").exists():
            continue
        stored = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        for k, name in enumerate(names):
            sizes = stored.getNode(f"imageSize{k + 1}" if len(names) > 1 else "imageSize")
            width, height = (int(sizes.at(i).real()) for i in (0, 1))
            boards, seen = (stored.getNode(node) for node in ("objectPoints", name))
            views = [(boards.at(i).mat().reshape(-1, 3), seen.at(i).mat().reshape(-1, 2)) for i in range(seen.size())]
            yield f"contrib_{file}{k + 1 if len(names) > 1 else ''}", BoardViews.of(views), (width, height)
    if (path := DATA / "babelcalib_ov_plane/train.mat").exists():
        stored = loadmat(path, squeeze_me=True, struct_as_record=False)
        plane = stored["boards"].X.T
        views = [(np.pad(plane[c.cspond[0] - 1], ((0, 0), (0, 1))), c.x.T - 1.0) for c in stored["corners"]]
        height, width = sorted(int(n) for n in np.ravel(stored["imgsize"])[:2])
        yield "ov_plane", BoardViews.of(views), (width, height)


def restarts(found: State, views: BoardViews, size: tuple[int, int], rng: np.random.Generator) -> Iterator[State]:
    """Give states away from the one found: all of it shaken, and a camera that knew half of the pictures."""
    for _ in range(RESTARTS):
        params = found.model.params.copy()
        names = found.model.param_names
        stretch = 1 + rng.uniform(-0.1, 0.1)
        for i, name in enumerate(names):
            if name in ("fx", "fy"):
                params[i] *= stretch
            elif name in ("cx", "cy"):
                params[i] += rng.uniform(-0.03, 0.03) * size[0]
            elif name[0] == "a" and name[1:].isdigit():
                params[i] *= stretch ** (1 - int(name[1:]))
        shaken = so3.exp(rng.normal(0, np.radians(3), (len(views), 3))) @ found.rotations
        moved = found.translations * (1 + rng.normal(0, 0.05, (len(views), 1)))
        yield State(found.model.with_params(params), shaken, moved)
    half = np.arange(len(views))[:: 2 if len(views) > 7 else 1]
    start = posed(initialise(views.subset(half), size).model, views)
    yield from (state for name, state in starts_of(found.model.name, start, views))


def table() -> str:
    """Calibrate every set as every model and from every restart, and say how many of the restarts are better."""
    lines = ["| set | model | rms, px | restarts | better by, of the good corners' cost |", "|---|---|---|---|---|"]
    for name, views, size in sets():
        rng = np.random.default_rng(0)
        start = initialise(views, size)
        for key, begun in (found for model in AUTO if model != "spline" for found in starts_of(model, start, views)):
            found = Candidate.fit(key, begun, views, Freedom.of(begun.model), loss="huber")
            spread = Spread.of(found.state, views)
            good = ~spread.doubtful(found.state, views)
            unit = float((0.5 * found.state.lengths(views)[good] ** 2).sum())
            others = list[float]()
            for state in restarts(found.state, views, size, rng):
                if state.model.params.shape == begun.model.params.shape:
                    other = Candidate.fit(key, state, views, Freedom.of(state.model), loss="huber").state
                    others.append(_cost(other, views, spread.threshold))
            better = (_cost(found.state, views, spread.threshold) - min(others)) / unit
            equal = sum(o <= _cost(found.state, views, spread.threshold) + 1e-3 * unit for o in others)
            lines.append(f"| {name} | {key} | {found.rms:.4f} | {equal}/{len(others)} reach it | {better:.2g} |")
            print(lines[-1], flush=True)
    return "\n" + "\n".join(lines)


def _cost(state: State, views: BoardViews, threshold: float) -> float:
    lengths = state.lengths(views)
    inside = np.minimum(lengths, threshold)
    return float((inside * (lengths - 0.5 * inside)).sum())
