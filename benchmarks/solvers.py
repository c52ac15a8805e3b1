"""Compare calibration solvers on corners of real cameras, with the same corners and the same model.

`python -m benchmarks solvers [SET ...]` prints the table. All solvers minimize the plain sum of squares; the row
"ours, huber" is the default of omnisight with a robust loss, whose rms is larger if there are outliers. Held out: the
camera is estimated from the even views, the board poses of the odd views are estimated with it by the same refinement
for all solvers, and the rms of the odd views is reported. A solver may drop views, as cv2.omnidir.calibrate does; an
additional row then has our result on the views that it keeps.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

import omnisight as om
from benchmarks.solvers_corners import Corners, corner_sets
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.ocamcalib import calibrate_ocamcalib
from omnisight.calibration.resection import reresect
from omnisight.calibration.state import State

# Strict, so that the other solvers converge: with 200 iterations and 1e-8 some stop early.
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
DEGREE = 4
EVERYTHING = ("mei", "kannala_brandt", "ocam")


@dataclass(frozen=True)
class Solved:
    """A camera with the board poses of the views that the solver kept."""

    state: State
    kept: Sequence[int]


@dataclass(frozen=True)
class Row:
    """Result of one solver on one set.

    Attributes
    ----------
    corners, model, solver
        Names.
    given, kept
        Number of views, and of those that the solver used.
    rms
        Over the used views, px; None if the solver failed.
    held_out
        Rms over the odd views with the camera of the even views, px; None if not available.
    folds
        Rms of a 3-fold cross-validation, px; None for sets without it.
    seconds
        Processor time of the calibration on all views with initialization; None if not comparable.
    note
        Error message of a failed solver.
    """

    corners: str
    model: str
    solver: str
    given: int
    kept: int = 0
    rms: float | None = None
    held_out: float | None = None
    folds: float | None = None
    seconds: float | None = None
    note: str = ""


Solve = Callable[[om.Observations, tuple[int, int]], Solved]


def ours(name: str, loss: str = "squared") -> Solve:
    def solve(views: om.Observations, size: tuple[int, int]) -> Solved:
        starts = dict(model_starts(name, estimate_initial_camera(views), views))
        initial = starts[f"ocam degree {DEGREE}" if name == "ocam" else name]
        # cv2.omnidir estimates the skew.
        free_parameters = FreeParameters.of(initial.model, free=("skew",) if name == "mei" else ())
        return Solved(refine(initial, views, free_parameters=free_parameters, loss=loss).state, range(len(views)))

    return solve


def omnidir(views: om.Observations, size: tuple[int, int]) -> Solved:
    objects, images = _lists(views)
    _, k, xi, d, turns, shifts, kept = cv2.omnidir.calibrate(objects, images, size, None, None, None, 0, CRITERIA)
    k1, k2, p1, p2 = d.ravel()
    model = _camera("mei", k, skew=k[0, 1], xi=xi.item(), k1=k1, k2=k2, p1=p1, p2=p2)
    return Solved(_state(model, turns, shifts), [int(i) for i in kept.ravel()])


def fisheye(views: om.Observations, size: tuple[int, int]) -> Solved:
    objects, images = _lists(views)
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    _, k, d, turns, shifts = cv2.fisheye.calibrate(objects, images, size, None, None, flags=flags, criteria=CRITERIA)
    k1, k2, k3, k4 = d.ravel()
    model = _camera("kannala_brandt", k, k1=k1, k2=k2, k3=k3, k4=k4)
    return Solved(_state(model, turns, shifts), range(len(views)))


def ocamcalib(views: om.Observations, size: tuple[int, int]) -> Solved:
    return Solved(calibrate_ocamcalib(views, size, degree=DEGREE).state, range(len(views)))


PEERS: dict[str, tuple[str, Solve]] = {
    "mei": ("cv2.omnidir", omnidir),
    "kannala_brandt": ("cv2.fisheye", fisheye),
    "ocam": ("ocamcalib", ocamcalib),
}


def rows(only: Iterable[str] = (), models: Iterable[str] = EVERYTHING) -> Iterator[Row]:
    """Yield the results of all solvers on every set.

    Parameters
    ----------
    only
        Names of sets; empty for all that are present.
    models
        Names of models.
    """
    wanted, models = set(only), tuple(models)
    for corners in corner_sets():
        if not wanted or corners.name in wanted:
            for model in models:
                yield from _of(corners, model)


def _of(corners: Corners, model: str) -> Iterator[Row]:
    squared, solved = _row(corners, model, "ours", ours(model), None)
    hint = solved.state if solved else None
    yield squared
    yield _row(corners, model, "ours, huber", ours(model, "huber"), hint)[0]
    name, solve = PEERS[model]
    theirs, _ = _row(corners, model, name, solve, hint)
    yield theirs
    if 0 < theirs.kept < theirs.given:
        same, _ = _row(corners, model, f"ours, the views of {name}", on_the_views_of(solve, ours(model)), hint)
        yield replace(same, seconds=None)


def on_the_views_of(peer: Solve, own: Solve) -> Solve:
    """Return a solver that runs on the views that the peer keeps."""

    def solve(views: om.Observations, size: tuple[int, int]) -> Solved:
        kept = peer(views, size).kept
        return Solved(own(views.subset(np.array(kept)), size).state, kept)

    return solve


def _row(corners: Corners, model: str, name: str, solve: Solve, hint: State | None) -> tuple[Row, Solved | None]:
    views, every = corners.views, np.arange(len(corners.views))
    row = Row(corners.name, model, name, len(every))
    start = time.process_time()
    try:
        solved = solve(views, corners.size)
    except (cv2.error, ValueError) as error:
        return replace(row, note=_message(error)), None
    seconds = time.process_time() - start
    kept = views.subset(np.array(solved.kept))
    row = replace(row, kept=len(kept), rms=_rms([solved.state.lengths(kept)]), seconds=seconds)
    hint = solved.state if hint is None else hint
    try:
        row = replace(row, held_out=_held_out(corners, solve, hint, [every[1::2]]))
        if corners.folds:
            thirds = [every[i :: corners.folds] for i in range(corners.folds)]
            row = replace(row, folds=_held_out(corners, solve, hint, thirds))
    except (cv2.error, ValueError) as error:
        row = replace(row, note=f"held out: {_message(error)}")
    return row, solved


def _held_out(corners: Corners, solve: Solve, hint: State, tests: Sequence[np.ndarray]) -> float:
    lengths: list[np.ndarray] = []
    for test in tests:
        train = np.setdiff1d(np.arange(len(corners.views)), test)
        camera = solve(corners.views.subset(train), corners.size).state.model
        seen = corners.views.subset(test)
        # Initial board pose: resection, or the pose of our calibration on all views, whichever has the lower cost.
        initial = reresect(State(camera, hint.rotations[test], hint.translations[test]), seen)
        lengths.append(
            refine(initial, seen, free_parameters=FreeParameters.none(camera), loss="squared").state.lengths(seen)
        )
    return _rms(lengths)


def _lists(views: om.Observations) -> tuple[list[np.ndarray], list[np.ndarray]]:
    return [views.points[g][None] for g in views.groups], [views.pixels[g][None] for g in views.groups]


def _camera(name: str, k: np.ndarray, **rest: float) -> om.CameraModel:
    return om.model_class(name).from_dict({"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]} | rest)


def _state(model: om.CameraModel, turns: Sequence[np.ndarray], shifts: Sequence[np.ndarray]) -> State:
    rotations = np.array([cv2.Rodrigues(np.asarray(turn, float).reshape(3))[0] for turn in turns])
    return State(model, rotations, np.array([np.ravel(shift) for shift in shifts], float))


def _rms(lengths: Sequence[np.ndarray]) -> float:
    return float(np.sqrt((np.concatenate(lengths) ** 2).mean()))


def _message(error: Exception) -> str:
    """Return an error message on one line, for OpenCV without the path of its source file."""
    text = " ".join(str(error).split())
    return text.rpartition("error: ")[2].replace("|", "/")[:120]


def line(r: Row) -> str:
    """Return a row of the Markdown table."""
    figures = [f"{x:.4f}" if x is not None else "" for x in (r.rms, r.held_out, r.folds)]
    seconds = f"{r.seconds:.2f}" if r.seconds is not None else ""
    return "| " + " | ".join([r.corners, r.model, r.solver, f"{r.kept} of {r.given}", *figures, seconds, r.note]) + " |"


HEAD = """\
| corners | model | solver | views | rms, px | held out, px | 3-fold, px | CPU s | |
|---|---|---|---|---|---|---|---|---|"""


def main(only: Sequence[str] = ()) -> None:
    """Print the table of all sets, or of those named."""
    print(f"OpenCV {cv2.__version__}; rms of |d| over all corners.\n\n{HEAD}")
    for row in rows(only):
        print(line(row), flush=True)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
