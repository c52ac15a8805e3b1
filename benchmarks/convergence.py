"""Does every calibration reach the global optimum by itself? `python -m benchmarks.convergence [--quick] [--real]`.

Each cell of the matrix (benchmarks/convergence_scenes.py) is calibrated as every model that can represent its lens,
from nothing, and once more from the truth: the true poses, and the model fitted to the true lens. Reached is a robust
cost, what is known of parameters beforehand in it, no more than a thousandth of what the good corners cost above that
of the start from the truth, both by the latter's threshold, or as much as 0.0002 px of their rms. A cell's text, as
printed with a failure, runs it alone: `--only 280/parabola/aside/parts/0.2/0.1/4 --model mei`.
"""

import argparse
import itertools
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields

import numpy as np

from benchmarks.convergence_real import table as real_table
from benchmarks.convergence_scenes import AXES, BOARDS, LENSES, Array, Cell, Scene, scene
from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel, model_class, model_names
from omnisight.models._profile_camera import ProfileCamera
from omnisight.targets.observations import Observations

# Not the spline: its knots follow from the corners, so that two starts are two problems.
MODELS = tuple(name for name in model_names() if issubclass(model_class(name), ProfileCamera) and name != "spline")
# A model can represent a lens that it follows this closely over the part of it where boards are, px (rms).
ABLE = 1.0
EXCESS = 1e-3
# px: residuals of the good corners (rms) that differ by less are the same.
SAME = 2e-4
NOISES, OUTLIERS, VIEWS = (0.0, 0.2, 1.0), (0.0, 0.1), (4, 10, 20, 60)


@dataclass(frozen=True)
class Run:
    """One calibration: by how much its cost exceeds that from the truth, in costs of the good corners.

    Attributes
    ----------
    cell, model
        What was calibrated, as what.
    excess
        Of the robust cost over that of the start from the truth; inf where there was no result.
    error_deg
        Largest angle to the true bearings over the part of the lens where boards are, turned to fit.
    seconds
        Of the start that all models share, and of the model's own fit.
    """

    cell: Cell
    model: str
    excess: float
    error_deg: float
    seconds: tuple[float, float]

    @property
    def reached(self) -> bool:
        return self.excess <= EXCESS


def matrix(*, quick: bool) -> Iterator[Cell]:
    """Yield the cells: every lens, axis and kind of boards; noise, outliers and number of views alternate."""
    turns = list(itertools.product(NOISES, OUTLIERS, VIEWS))
    order = np.random.default_rng(0).permutation(len(turns))
    count = itertools.count()
    for fov, lenses in LENSES.items():
        for (lens, axis), boards in itertools.product(itertools.product(lenses, AXES), BOARDS):
            if boards == "past90" and fov < 240:
                continue
            for k in range(1 if quick else 4):
                noise, outliers, views = turns[order[next(count) % len(order)]]
                if not quick or (k == 0 and views < 60 and next(count) % 3 == 0):
                    yield Cell(fov, lens, axis, boards, noise, outliers, views)


def cost(state: State, views: Observations, threshold: float) -> Array:
    """Return the robust cost of each corner."""
    inside = np.minimum(lengths := state.lengths(views), threshold)
    return inside * (lengths - 0.5 * inside)


def fitted(name: str, start: State, views: Observations) -> State:
    """Refine as a calibration with no flags does."""
    return Candidate.fit(name, start, views, FreeParameters.of(start.model), loss="huber").state


def compared(state: State, views: Observations, weights: ResidualWeights) -> State:
    """Bring a result to the bottom of the cost that it is compared by: a few steps, too few to go anywhere else."""
    return refine(state, views, weights=weights, iterations=30).state


def from_truth(made: Scene, models: Sequence[str] = MODELS) -> dict[str, State]:
    """Return the true state in every model that can represent the lens, by the name of its candidate."""
    truth = made.state
    seen, _ = truth.model.project_numpy(made.cone)
    found: dict[str, State] = {}
    for name in models:
        try:
            fits = model_class(name).variants(len(made.views.pixels)).items()
            fitted = {label: fit(made.cone, seen, fixed=("skew",)) for label, fit in fits}
        except ValueError:
            continue
        if name == truth.model.name and list(fitted) == [name]:
            fitted = {name: truth.model}
        for key, model in fitted.items():
            away = np.linalg.norm(model.project_numpy(made.cone)[0] - seen, axis=1)
            if np.sqrt((away**2).mean()) < ABLE:
                found[key] = State(model, truth.rotations, truth.translations)
    return found


def run(cell: Cell, models: Sequence[str] = MODELS) -> list[Run]:
    """Calibrate one cell as every model that can represent it."""
    made = scene(cell)
    begun = time.perf_counter()
    start = estimate_initial_camera(made.views)
    shared = time.perf_counter() - begun
    runs: list[Run] = []
    for key, true_start in from_truth(made, models).items():
        best = fitted(key, true_start, made.views)
        # Where a corner begins to count as doubtful follows from the residuals: one threshold, to compare.
        weights = ResidualWeights.estimate(best, made.views)
        best, threshold = compared(best, made.views, weights), weights.threshold
        unit = float(cost(best, made.views, threshold)[made.clean].sum())
        # As `fit_candidates` does for one model; other degrees of a polynomial are left out.
        begun = time.perf_counter()
        started = dict(model_starts(key.split()[0], start, made.views))
        if key not in started:
            runs.append(Run(cell, key, np.inf, np.nan, (shared, 0.0)))
            continue
        found = fitted(key, started[key], made.views)
        own = time.perf_counter() - begun
        found = compared(found, made.views, weights)
        minimised = Bundle(made.views, FreeParameters.of(best.model), weights).cost
        above = minimised(found) - minimised(best)
        count = 0.5 * float(made.clean.sum())
        apart = float(np.sqrt(max(unit + above, 0.0) / count) - np.sqrt(unit / count))
        excess = above / unit if abs(apart) > SAME else 0.0
        runs.append(Run(cell, key, excess, bearing_error(found.model, made), (shared, own)))
    return runs


def bearing_error(model: CameraModel, made: Scene) -> float:
    """Return the largest angle (degrees) between true bearings and those of the model for the same pixels.

    The cameras may be turned against each other: a centre a little aside is a rotation, and no pose of a board knows.
    """
    found, valid = model.unproject_numpy(made.state.model.project_numpy(made.cone)[0])
    if not (valid.all() and np.isfinite(found).all()):
        return 180.0
    aligned = found @ so3.nearest(made.cone.T @ found).T
    return float(np.degrees(np.linalg.norm(aligned - made.cone, axis=1).max()))


def tables(runs: list[Run]) -> str:
    """Return the table of reached / runs by field of view and lens, and by each of the other columns."""
    lines = list[str]()
    columns = {f.name: (lambda r, name=f.name: getattr(r.cell, name)) for f in fields(Cell)}
    rows = {"fov/lens": lambda r: f"{r.cell.fov} {r.cell.lens}", "model": lambda r: r.model.split()[0]}
    for title, key in rows.items():
        lines += [f"| {title} | " + " | ".join(BOARDS) + " | all | error, deg |", "|---" * (len(BOARDS) + 3) + "|"]
        groups = defaultdict[str, list[Run]](list)
        for r in runs:
            groups[key(r)].append(r)
        for name, part in groups.items():
            counts = [_count([r for r in part if r.cell.boards == boards]) for boards in BOARDS]
            error = np.nanmedian([r.error_deg for r in part])
            lines.append(f"| {name} | {' | '.join(counts)} | {_count(part)} | {error:.3f} |")
        lines.append("")
    for name in ("axis", "boards", "noise", "outliers", "views"):
        values = dict.fromkeys(columns[name](r) for r in runs)
        counts = [f"{v}: {_count([r for r in runs if columns[name](r) == v])}" for v in sorted(values)]
        lines.append(f"{name}: {', '.join(counts)}")
    shared = {r.cell: r.seconds[0] for r in runs}
    by_views = {v: np.median([s for c, s in shared.items() if c.views == v] or [np.nan]) for v in VIEWS}
    lines.append("start, median: " + ", ".join(f"{v} views {s * 1e3:.0f} ms" for v, s in by_views.items()))
    lines.append(f"all: {_count(runs)} reached in {len(shared)} cells")
    return "\n".join(lines)


def _count(runs: list[Run]) -> str:
    return f"{sum(r.reached for r in runs)}/{len(runs)}" if runs else ""


def _quiet(cell: Cell, models: Sequence[str]) -> list[Run]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return run(cell, models)


def main(arguments: list[str] | None = None) -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.convergence", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few minutes instead of tens")
    parser.add_argument("--real", action="store_true", help="real corners instead of the matrix")
    parser.add_argument("--only", help="one cell by its text, or all that contain it")
    parser.add_argument("--model", help="one camera model")
    parser.add_argument("--share", type=float, default=1.0, help="part of the cells, drawn at random, 0 to 1")
    parser.add_argument("--seed", type=int, default=0, help="of the random part")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    chosen = parser.parse_args(arguments)
    if chosen.real:
        print(real_table())
        return
    cells = [c for c in matrix(quick=chosen.quick) if chosen.only is None or chosen.only in str(c)]
    if chosen.share < 1:
        drawn = np.random.default_rng(chosen.seed).permutation(len(cells))[: round(chosen.share * len(cells))]
        cells = [cells[i] for i in sorted(drawn)]
    if not cells and chosen.only and chosen.only.count("/") == 6:
        cells = [Cell.parse(chosen.only)]
    runs, begun = list[Run](), time.perf_counter()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for done in pool.map(
            _quiet, cells, itertools.repeat(MODELS if chosen.model is None else (chosen.model,)), chunksize=4
        ):
            runs += done
            for r in done:
                if not r.reached or len(cells) == 1:
                    print(f"{r.cell} {r.model}: excess {r.excess:.2g}, error {r.error_deg:.3f} deg", flush=True)
    print("\n" + tables(runs))
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
