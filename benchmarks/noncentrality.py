"""Rates of false and true claims of the non-central test: `python -m benchmarks noncentrality --cameras 200`.

Central cameras of all kinds are calibrated from simulated corners, every other one with a model that does not fit its
lens; none may be called non-central. The same lenses with an entrance pupil that shifts along the axis are calibrated
with `--model auto`; the detection rate is printed by the size of the effect, the rms displacement (px) of the corners
that the shift causes after the best central camera of the same lens model is subtracted.
"""

import argparse
import warnings
import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchmarks.verdict_scenes import BOARDS, Session, camera, observe
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.calibration.state import State
from omnisight.models import CameraModel
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.quality.evidence import Level
from omnisight.targets.observations import Observations

# Models that fit few lenses well.
POOR_MODELS = ("radial_polynomial", "unified", "equidistant", "division", "stereographic")
# Shift of the pupil at 90 degrees, squares: from invisible to that of a mirror.
MIN_SHIFT, MAX_SHIFT = 0.02, 1.0
# Effects of the shift (corner noise is 1) between which the detection rate is printed.
EFFECTS = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, np.inf)


@dataclass(frozen=True)
class Trial:
    """One image set; its text is the seed of its random numbers."""

    is_central: bool
    number: int

    def __str__(self) -> str:
        return f"{'central' if self.is_central else 'non-central'}/{self.number}"


@dataclass(frozen=True)
class Outcome:
    """What was simulated and found; `effect` is the displacement of the corners in units of the corner noise."""

    trial: Trial
    lens: str
    model: str
    shift: float
    effect: float
    is_claimed: bool
    is_undecided: bool
    is_advised: bool
    level: Level

    def __str__(self) -> str:
        finding = "non-central" if self.is_claimed else "undecided" if self.is_undecided else "central"
        truth = f"shift {self.shift:.3f} squares, {self.effect:.2f} of the noise" if self.shift else "central"
        return f"{self.trial!s:16s} {self.lens:22s} {self.model:18s} {truth}: {finding}, {self.level}"


def run(trial: Trial) -> Outcome:
    """Calibrate one image set and compare the result of the non-central test with the truth."""
    rng = np.random.default_rng(zlib.crc32(str(trial).encode()))
    session = Session(int(rng.integers(8, 26)), float(np.exp(rng.uniform(np.log(0.05), np.log(0.3)))))
    model = "auto"
    if trial.is_central:
        model = str(rng.choice(POOR_MODELS)) if trial.number % 2 else "auto"
    else:
        session = replace(session, pupil=float(np.exp(rng.uniform(np.log(MIN_SHIFT), np.log(MAX_SHIFT)))))
    truth = camera(session, rng)
    board = BOARDS[int(rng.integers(len(BOARDS)))]
    exact = observe(replace(session, noise=0.0), truth, board, deepcopy(rng))
    observations = observe(session, truth, board, rng)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        found = calibrate(observations, CalibrateOptions(model=model))
        effect = 0.0 if trial.is_central else _displacement(truth.model, exact) / session.noise
    test = found.quality.noncentrality
    claimed = test is not None and test.is_noncentral
    undecided = test is not None and test.is_inconclusive
    advised = any("--model axial" in reason for reason in found.reasons)
    return Outcome(
        trial, truth.name, found.best.name, session.pupil, effect, claimed, undecided, advised, found.verdict.level
    )


def _displacement(model: CameraModel, exact: Observations) -> float:
    """Return the rms of a coordinate (px) that remains of the shift after a central camera is fitted."""
    start: State = resect(model, exact)
    return Candidate.fit("central", start, exact, FreeParameters.of(model), loss="squared").rms / float(np.sqrt(2))


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the rate of false claims and the detection rate by effect."""
    lines = ["| cameras | effect / noise | sets | non-central | undecided | --model axial advised |", "|---" * 6 + "|"]
    central = [o for o in outcomes if o.trial.is_central]
    lines += [_row("central, auto", "0", [o for o in central if o.trial.number % 2 == 0])]
    lines += [_row("central, poor model", "0", [o for o in central if o.trial.number % 2])]
    for low, high in pairwise(EFFECTS):
        part = [o for o in outcomes if not o.trial.is_central and low <= o.effect < high]
        shifts = [o.shift for o in part]
        name = f"shift {min(shifts):.2f} to {max(shifts):.2f} squares" if part else "shift"
        lines.append(_row(name, f"{low:g} to {high:g}", part))
    false = sum(o.is_claimed for o in central)
    lines.append(
        f"\nfalse claims: {false} of {len(central)} central cameras ({100 * false / max(len(central), 1):.1f} %)"
    )
    return "\n".join(lines)


def _row(name: str, effect: str, part: Sequence[Outcome]) -> str:
    rates = [
        f"{100 * np.mean(values):.0f} %" if part else ""
        for values in ([o.is_claimed for o in part], [o.is_undecided for o in part], [o.is_advised for o in part])
    ]
    return f"| {name} | {effect} | {len(part)} | {' | '.join(rates)} |"


def main(arguments: list[str] | None = None) -> None:
    """Calibrate the cameras and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks noncentrality", description=__doc__)
    parser.add_argument("--cameras", type=int, default=200, help="number of central cameras, and of non-central ones")
    parser.add_argument("--first", type=int, default=0, help="number of the first camera")
    parser.add_argument("--only", help="part of the name of the trials to run")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    chosen = parser.parse_args(arguments)
    numbers = range(chosen.first, chosen.first + chosen.cameras)
    trials = [Trial(is_central, number) for number in numbers for is_central in (True, False)]
    outcomes = list[Outcome]()
    with ProcessPoolExecutor(chosen.workers) as pool:
        for outcome in pool.map(run, [t for t in trials if chosen.only is None or chosen.only in str(t)]):
            outcomes.append(outcome)
            print(outcome, flush=True)
    print(table(outcomes))


if __name__ == "__main__":
    main()
