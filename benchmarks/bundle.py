"""Bundle adjustment of many poses and points, beside that of pycolmap from the same start.

Equirectangular cameras on a loop see points all around it. Both solvers minimize the squared pixel residuals, with
fixed intrinsics; the whitened tangents of omnisight are the derivatives of the pixels. The gauge of pycolmap is that of
two cameras. Each runs in its own process, after a small problem in another one, so that no code is compiled. The first
table lists the time until the cost is within 1e-4 of the lowest cost of both, and the peak memory, the second the cost
after each iteration, relative to the lowest.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.own_process import run_module
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]

SOLVERS = ("omnisight", "pycolmap")
# Width of the images, standard deviation of the keypoints, px, and largest latitude, below which pixels are regular.
WIDTH, SIGMA_PX, MAX_LATITUDE = 2000, 0.5, np.radians(60)
# Errors of the start: rotations, radians; positions and points relative to their distances.
ROTATION_ERROR, POSITION_ERROR, POINT_ERROR = np.radians(1.0), 0.1, 0.05
# Radius of the loop, standard deviation of the distances of points from it, and least distance of a point, metres.
RADIUS, DISTANCE, MIN_DISTANCE = 20.0, 5.0, 2.0
CLOSE = 1e-4


@dataclass(frozen=True)
class Size:
    """Number of poses, points, and observations of each point."""

    poses: int
    points: int
    track: int


def write_problem(size: Size, file: Path) -> None:
    """Write poses, points and their observations, with a start that differs from the truth."""
    rng = np.random.default_rng(0)
    angles = 2 * np.pi * np.arange(size.poses) / size.poses
    centers = RADIUS * np.column_stack([np.cos(angles), 0.02 * np.sin(5 * angles), np.sin(angles)])
    rotations = so3.exp(rng.normal(0, 1, (size.poses, 3)) * (0.1, 1.0, 0.1))
    place = rng.integers(0, size.poses, size.points)
    points = centers[place] + rng.normal(0, DISTANCE, (size.points, 3)) * (1.0, 0.4, 1.0)
    frame = _observing(rng, centers, rotations, points, size.track)
    point = np.repeat(np.arange(size.points), frame.shape[1])
    frame = frame.ravel()
    pixels = project(rotations, centers, points, frame, point) + rng.normal(0, SIGMA_PX, (len(point), 2))
    scale = np.linalg.norm(np.roll(centers, -1, axis=0) - centers, axis=1).mean()
    np.savez(
        file,
        rotations=so3.exp(rng.normal(0, ROTATION_ERROR, (size.poses, 3))) @ rotations,
        centers=centers + rng.normal(0, POSITION_ERROR * scale, centers.shape),
        points=points + rng.normal(0, POINT_ERROR * DISTANCE, points.shape),
        frame=frame,
        point=point,
        pixels=pixels,
    )


def _observing(
    rng: np.random.Generator, centers: Array, rotations: Array, points: Array, track: int
) -> NDArray[np.intp]:
    """Return for each point the frames (P, L) that observe it: some of the nearest, away from the poles."""
    found = np.empty((len(points), track), np.intp)
    for start in range(0, len(points), 4096):
        some = slice(start, start + 4096)
        offsets = points[some, None] - centers
        distances = np.linalg.norm(offsets, axis=2)
        latitude = np.arcsin(np.einsum("fj,pfj->pf", rotations[:, 1], offsets) / distances)
        distances[(np.abs(latitude) > MAX_LATITUDE) | (distances < MIN_DISTANCE)] = np.inf
        nearest = np.argsort(distances, axis=1)[:, : 3 * track]
        chosen = np.argsort(rng.random(nearest.shape), axis=1)[:, :track]
        found[some] = np.take_along_axis(nearest, chosen, axis=1)
    return np.sort(found, axis=1)


def project(rotations: Array, centers: Array, points: Array, frame: NDArray[np.intp], point: NDArray[np.intp]) -> Array:
    """Return the pixels (M, 2) of observations in equirectangular images, in COLMAP's convention."""
    x = np.einsum("mij,mj->mi", rotations[frame], points[point] - centers[frame])
    latitude = np.arctan2(x[:, 1], np.hypot(x[:, 0], x[:, 2]))
    return WIDTH * np.column_stack([np.arctan2(x[:, 0], x[:, 2]) / (2 * np.pi) + 0.5, latitude / (2 * np.pi) + 0.25])


def cost(file: Path, state: Path) -> float:
    """Return half the sum of the squared pixel residuals of a solution."""
    problem, solution = np.load(file), np.load(state)
    poses = solution["poses"]
    centers = -np.einsum("fji,fj->fi", poses[:, :, :3], poses[:, :, 3])
    residuals = project(poses[:, :, :3], centers, solution["points"], problem["frame"], problem["point"])
    residuals -= problem["pixels"]
    residuals[:, 0] -= WIDTH * np.round(residuals[:, 0] / WIDTH)
    return 0.5 * float((residuals**2).sum())


@dataclass(frozen=True)
class Run:
    """Costs after the iterations and their times, the cost of the result in pixels, and the peak memory."""

    seconds: Array
    costs: Array
    final: float
    megabytes: float

    def seconds_to(self, limit: float) -> float:
        """Return the time until the cost is below a limit; NaN if it never is."""
        below = np.flatnonzero(self.costs <= limit)
        return float(self.seconds[below[0]]) if len(below) else float("nan")


def run(solver: str, file: Path) -> Run:
    """Run a solver in its own process."""
    state = file.with_name(f"{solver}.npz")
    rows = run_module("benchmarks.bundle_solvers", [solver, str(file), str(state)])
    trace = np.array([found for row in rows if (found := _seconds_and_cost(row)) is not None])
    megabytes = next(float(row[1]) for row in rows if row[0] == "megabytes")
    return Run(trace[:, 0], trace[:, 1], cost(file, state), megabytes)


def _seconds_and_cost(row: Sequence[str]) -> tuple[float, float] | None:
    """Return the numbers of a line of `bundle_solvers`, or of the table of Ceres; None for other lines."""
    if row[0] == "cost":
        return float(row[1]), float(row[2])
    return (float(row[9]), float(row[1])) if len(row) == 10 and row[0].isdigit() else None


def main(arguments: Sequence[str]) -> None:
    """Print the tables of both solvers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks bundle", description=__doc__)
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--points", type=int, default=50_000)
    parser.add_argument("--track", type=int, default=6, help="observations of each point")
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=SOLVERS)
    options = parser.parse_args(arguments)
    size = Size(options.poses, options.points, options.track)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.npz"
        for warm_up in (Size(10, 100, 4), size):
            write_problem(warm_up, file)
            runs = {solver: run(solver, file) for solver in options.solvers}
    best = min(each.costs.min() for each in runs.values())
    print(f"{size.poses} poses, {size.points} points, {size.points * size.track} observations\n")
    print(
        "| solver | time to within 1e-4 | iterations | end | final cost, px² | peak memory |\n|---|---|---|---|---|---|"
    )
    for solver, each in runs.items():
        times = f"{each.seconds_to(best * (1 + CLOSE)):.1f} s | {len(each.costs) - 1} | {each.seconds[-1]:.1f} s"
        print(f"| {solver} | {times} | {each.final:.2f} | {each.megabytes:.0f} MB |")
    print("\n| solver | iteration | time | cost above the lowest |\n|---|---|---|---|")
    for solver, each in runs.items():
        for k, (seconds, value) in enumerate(zip(each.seconds, each.costs, strict=True)):
            print(f"| {solver} | {k} | {seconds:.2f} s | {value / best - 1:.2e} |")


if __name__ == "__main__":
    main(sys.argv[1:])
