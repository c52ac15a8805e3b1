"""Compare the stated uncertainty with the true error under weak data: `python -m benchmarks model_choice`.

Four cameras are calibrated from 20 simulated images of a 9x6 board with corner noise of 0.3 px. The standard deviation
of the board tilt goes from 2° to 25°: with little tilt, several camera models fit the corners equally well but differ
by pixels elsewhere. Boards are tilted from facing the camera (even seeds) or from parallel to the sensor (odd seeds).
Errors are root mean squares over the calibrated field of view after the best rotation, in px of an image 1000 px wide.
"""

import argparse
import warnings
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.convergence_scenes import LENSES, Array
from benchmarks.verdict import Run, judged, over
from benchmarks.verdict_scenes import Case, GroundTruth, scaled
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import polar
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.quality.evidence import Level
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations

BOARD = Checkerboard(9, 6)
SIZE = (1280, 960)
NOISE_PX = 0.3
TILTS_DEG = (2, 4, 6, 8, 10, 15, 25)
CAMERAS = {
    "kannala_brandt": 184,
    "double_sphere": 220,
    "equisolid": 150,
    "unified": 200,
}
SHAPES = {"unified": {"xi": 0.9}}
# Radius of the image circle, px.
RIM_PX = 470.0
# Angular width of a board, degrees, and least number of visible corners.
MIN_WIDTH_DEG, MAX_WIDTH_DEG, MIN_CORNERS = 25.0, 55.0, 40


@dataclass(frozen=True)
class Trial:
    """One image set; its text is the seed of its random numbers."""

    camera: str
    tilt_deg: float
    seed: int
    images: int = 20

    def __str__(self) -> str:
        return f"{self.camera}/{self.tilt_deg:g}/{self.seed}" + ("" if self.images == 20 else f"/{self.images}")


def run(trial: Trial) -> Run:
    """Calibrate one image set and compare the camera with the truth."""
    truth, observations = scene(trial)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return judged(Case(str(trial), trial.seed), NOISE_PX, truth, calibrate(observations))


def scene(trial: Trial, bend: Callable[[Array], Array] = np.asarray) -> tuple[GroundTruth, Observations]:
    """Simulate the corners of a trial; deterministic. `bend` moves the points (N, 3) of the board in each view."""
    rng = np.random.default_rng(zlib.crc32(str(trial).encode()))
    fov = CAMERAS[trial.camera]
    half = np.radians(fov / 2)
    lenses = {name: lens for every in LENSES.values() for name, lens in every.items()}
    model = scaled(lenses[trial.camera], float(half), RIM_PX, rng)
    truth = GroundTruth(f"{trial.camera} {fov}", model, 0.0, float(half))
    views = [_view(truth, trial, bend, rng) for _ in range(trial.images)]
    return truth, Observations.from_arrays(*zip(*views, strict=True), size=SIZE)


def _view(
    truth: GroundTruth, trial: Trial, bend: Callable[[Array], Array], rng: np.random.Generator
) -> tuple[Array, Array]:
    """Place a board in view and simulate its corners: board points (N, 3) and pixels (N, 2)."""
    points = bend(BOARD.points - BOARD.points.mean(0))
    while True:
        width = np.radians(rng.uniform(MIN_WIDTH_DEG, MAX_WIDTH_DEG))
        facing = trial.seed % 2 == 0
        reach = truth.half - 0.3 * width if facing else np.radians(60.0)
        theta, phi = reach * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        tilt = so3.exp(np.append(np.radians(trial.tilt_deg) * rng.normal(size=2), rng.uniform(-0.5, 0.5)))
        towards = so3.exp(theta * np.array([-np.sin(phi), np.cos(phi), 0.0])) if facing else np.eye(3)
        distance = float(np.ptp(points[:, 0])) / 2 / np.tan(width / 2)
        position = distance * polar(np.array(theta), np.array(phi)) / (1.0 if facing else np.cos(theta))
        pixels, use = truth.project(points @ (towards @ tilt).T + position)
        if use.sum() >= MIN_CORNERS:
            return BOARD.points[use], pixels[use] + NOISE_PX * rng.normal(size=(int(use.sum()), 2))


def table(runs: Sequence[Run]) -> str:
    """Return the verdicts, the largest error per verdict and the ratio of true to stated error, by tilt."""
    lines = ["| tilt | sets | good (worst px) | usable (worst px) | do not use | true/stated: median, 95 %, worst |"]
    lines += ["|---|---|---|---|---|---|"]
    for tilt in dict.fromkeys(r.case.kind.split("/")[1] for r in runs):
        part = [r for r in runs if r.case.kind.split("/")[1] == tilt]
        columns = [_level([r for r in part if r.level == level]) for level in Level]
        ratios = np.quantile([over(r.cone) for r in part], (0.5, 0.95, 1.0))
        lines.append(f"| {tilt}° | {len(part)} | {' | '.join(columns)} | {', '.join(f'{q:.2f}' for q in ratios)} |")
    precise = [r for r in runs if r.cone.rms < 0.5]
    lines.append(f"\nerror below 0.5 px: {len(precise)}, of them good: {sum(r.level == Level.GOOD for r in precise)}")
    ratios = np.array([over(r.cone) for r in runs])
    lines.append(f"true/stated at most 2: {100 * np.mean(ratios <= 2):.1f} %")
    return "\n".join(lines)


def _level(runs: Sequence[Run]) -> str:
    return f"{len(runs)}" + (f" ({max(r.cone.rms for r in runs):.2f})" if runs else "")


def main(arguments: list[str] | None = None) -> None:
    """Calibrate the trials and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks model_choice", description=__doc__)
    parser.add_argument("--seeds", type=int, default=30, help="number of sets of each camera and tilt")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--tilts", type=float, nargs="*", default=TILTS_DEG, help="standard deviations, degrees")
    parser.add_argument("--images", type=int, default=20, help="images per set")
    parser.add_argument("--only", help="part of the name of the trials to run")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    trials = [Trial(name, tilt, seed, chosen.images) for tilt in chosen.tilts for seed in seeds for name in CAMERAS]
    trials = [trial for trial in trials if chosen.only is None or chosen.only in str(trial)]
    runs = list[Run]()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for done in pool.map(run, trials):
            runs.append(done)
            print(done, flush=True)
            if len(trials) == 1:
                print("\n".join(f"  - {reason}" for reason in done.reasons))
    print(table(runs))


if __name__ == "__main__":
    main()
