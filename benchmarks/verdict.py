"""Compare the verdict with the true error: `python -m benchmarks verdict [--seeds 9] [--part all|tuned|aside]`.

Simulated image sets of good and bad quality (benchmarks/verdict_scenes.py) with known cameras are calibrated without
options. The error of each camera, after the best rotation to the true camera, is evaluated over the calibrated field of
view and over all that the images show, and compared with the verdict. The limits of quality/checks
were tuned on the even seeds; the odd seeds are the test set.

Errors are in px of an image 1000 px wide, as in the verdict. The printed name of a case runs it alone:
`--only "bent board/3"`.
"""

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.convergence_scenes import Array
from benchmarks.verdict_scenes import KINDS, Case, GroundTruth, scene
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.geometry import rotation as so3
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.quality.evidence import Level
from omnisight.quality.uncertainty import Uncertainty

# Error assigned to directions that the estimated camera cannot project, px.
LOST = 100.0
# A camera with a smaller error (px rms over the calibrated field of view) is good, with a larger one bad.
GOOD, BAD = 0.5, 2.0


@dataclass(frozen=True)
class Error:
    """Difference of a camera from the true camera over some directions after the best rotation; px, degrees.

    Attributes
    ----------
    rms, worst
        Pixel error.
    rms_deg, worst_deg
        Bearing error.
    stated
        Rms of the predicted standard deviations of the pixel.
    typical
        Median over the directions of the ratio of the error to its predicted standard deviation.
    """

    rms: float
    worst: float
    rms_deg: float
    worst_deg: float
    stated: float
    typical: float


@dataclass(frozen=True)
class Run:
    """One calibration: its errors over the calibrated cone and over the whole field, and its verdict.

    `failed` are the checks that failed, `noted` those that failed or made a remark.
    """

    case: Case
    lens: str
    model: str
    noise: float
    cone: Error
    field: Error
    level: Level
    failed: tuple[str, ...]
    noted: tuple[str, ...]
    reasons: tuple[str, ...]
    seconds: float

    def __str__(self) -> str:
        return (
            f"{self.case!s:20s} {self.lens:22s} {self.model:17s} noise {self.noise:.2f}: off {self.cone.rms:6.2f} px"
            f" in the cone ({self.cone.stated:6.2f} stated), {self.field.rms:6.2f} in the field"
            f" ({self.field.stated:6.2f});"
            f" {self.level}: {', '.join(self.failed)}"
        )


def run(case: Case) -> Run:
    """Calibrate one case and compare it with the truth."""
    session, truth, views = scene(case)
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        found = calibrate(views, CalibrateOptions(model=session.model, force=True))
        seconds = time.perf_counter() - start
        return judged(case, session.noise, truth, found, seconds)


def judged(case: Case, noise: float, truth: GroundTruth, found: Calibration, seconds: float = 0.0) -> Run:
    """Compare a calibration with the truth."""
    bearings, pixels = truth.field()
    theirs, valid = found.camera.unproject(pixels)
    cone = valid & found.camera.calibrated(theirs)
    checks = [check for check in found.verdict.checks if check.level]
    return Run(
        case,
        truth.name,
        found.best.name,
        noise,
        _error(found, bearings[cone], pixels[cone]),
        _error(found, bearings, pixels),
        found.verdict.level,
        tuple(f"{check.name}{'!' * (check.level - 1)}" for check in checks),
        tuple(check.name for check in found.verdict.checks if check.sentence),
        found.reasons,
        seconds,
    )


def _error(found: Calibration, bearings: Array, pixels: Array) -> Error:
    camera = found.camera
    if not len(bearings):
        return Error(LOST, LOST, 180.0, 180.0, np.inf, np.nan)
    off = np.linalg.norm(rotation_aligned_difference(camera.model, bearings, pixels), axis=1)
    off = np.minimum(np.nan_to_num(off, nan=LOST), LOST) / camera.px_unit
    theirs, _ = camera.unproject(pixels)
    known = np.isfinite(theirs).all(1)
    angles = np.full(len(bearings), 180.0)
    aligned = theirs[known] @ so3.nearest(bearings[known].T @ theirs[known]).T
    angles[known] = np.degrees(np.linalg.norm(aligned - bearings[known], axis=1))
    spread = np.trace(Uncertainty.of(camera).projection(bearings), axis1=1, axis2=2)
    stated = np.sqrt(np.minimum(np.nan_to_num(spread, nan=LOST**2), LOST**2)) / camera.px_unit
    rms = float(np.sqrt((off**2).mean()))
    typical = float(np.median(off / np.maximum(stated, 1e-9)))
    rms_deg = float(np.sqrt((angles**2).mean()))
    return Error(rms, float(off.max()), rms_deg, float(angles.max()), float(np.sqrt((stated**2).mean())), typical)


def table(runs: Sequence[Run]) -> str:
    """Return tables of the true errors by verdict, of the verdicts by true error, and of both by kind of set."""
    lines = ["| verdict | sets | off in the cone, px: median, 90 %, worst | in the field | cone, degrees |"]
    lines += ["|---|---|---|---|---|"]
    for level in Level:
        part = [r for r in runs if r.level == level]
        if part:
            columns = [_three([figure(r) for r in part]) for figure in FIGURES]
            lines.append(f"| {level} | {len(part)} | {' | '.join(columns)} |")
    lines += ["", "| off in the cone | sets | " + " | ".join(str(level) for level in Level) + " |", "|---" * 5 + "|"]
    classes: dict[str, Callable[[Run], bool]] = {
        f"below {GOOD} px": lambda r: r.cone.rms < GOOD,
        "between": lambda r: GOOD <= r.cone.rms <= BAD,
        f"above {BAD} px": lambda r: r.cone.rms > BAD,
        f"above {BAD} px in the field": lambda r: r.field.rms > BAD,
    }
    for name, of_class in classes.items():
        part = [r for r in runs if of_class(r)]
        counts = [sum(r.level == level for r in part) for level in Level]
        lines.append(f"| {name} | {len(part)} | " + " | ".join(str(n) for n in counts) + " |")
    lines += ["", "| verdict | true over stated, cone: median, 90 %, worst | field | along directions, median |"]
    lines += ["|---|---|---|---|"]
    for level in Level:
        part = [r for r in runs if r.level == level]
        if part:
            cone, field = (_three([over(of(r)) for r in part]) for of in (lambda r: r.cone, lambda r: r.field))
            typical = np.nanmedian([r.cone.typical for r in part])
            lines.append(f"| {level} | {cone} | {field} | {typical:.2f} |")
    lines += ["", "| kind | sets | " + " | ".join(str(level) for level in Level) + " | off, px | true/stated |"]
    lines += ["|---" * 7 + "|"]
    for kind in dict.fromkeys(r.case.kind for r in runs):
        part = [r for r in runs if r.case.kind == kind]
        counts = " | ".join(str(sum(r.level == level for r in part)) for level in Level)
        worth = f"{_three([r.cone.rms for r in part])} | {_three([over(r.cone) for r in part])}"
        lines.append(f"| {kind} | {len(part)} | {counts} | {worth} |")
    failed = Counter(name for r in runs for name in r.failed)
    wrong = Counter(name for r in runs if r.cone.rms < GOOD for name in r.failed)
    lines += ["", "checks that failed (of cameras that are good in the cone): "]
    lines[-1] += ", ".join(f"{name} {count} ({wrong[name]})" for name, count in failed.most_common())
    lines.append(f"seconds, median: {np.median([r.seconds for r in runs]):.2f}")
    return "\n".join(lines)


FIGURES: tuple[Callable[[Run], float], ...] = (
    lambda r: r.cone.rms,
    lambda r: r.field.rms,
    lambda r: r.cone.rms_deg,
)


def over(error: Error) -> float:
    """Return the ratio of the true error to the predicted one."""
    return error.rms / max(error.stated, 1e-9)


def _three(values: Sequence[float]) -> str:
    return ", ".join(f"{v:.2g}" for v in (np.median(values), np.quantile(values, 0.9), np.max(values)))


def main(arguments: list[str] | None = None) -> None:
    """Calibrate the cases and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks verdict", description=__doc__)
    parser.add_argument("--seeds", type=int, default=9, help="number of sets of each kind")
    parser.add_argument(
        "--part", choices=("all", "tuned", "aside"), default="all", help="tuned: even seeds; aside: odd seeds"
    )
    parser.add_argument("--only", help="part of the name of the cases to run")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    chosen = parser.parse_args(arguments)
    cases = [Case(kind, seed) for seed in range(chosen.seeds) for kind in KINDS]
    cases = [c for c in cases if chosen.only is None or chosen.only in str(c)]
    start, runs = time.perf_counter(), list[Run]()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for done in pool.map(run, cases, chunksize=4):
            runs.append(done)
            print(done, flush=True)
            if len(cases) == 1:
                print("\n".join(f"  - {reason}" for reason in done.reasons))
    for part, first in (("tuned", 0), ("aside", 1)):
        some = [r for r in runs if r.case.seed % 2 == first]
        if some and chosen.part in ("all", part):
            print(f"\n{part} ({'even' if first == 0 else 'odd'} seeds)\n\n{table(some)}")
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
