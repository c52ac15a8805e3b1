"""Relative and absolute poses and points from bearings with noise and outliers; pycolmap, PoseLib.

`python -m benchmarks twoview` prints the tables of docs/guide/twoview.md and docs/twoview-results.md. All methods get
the same pairs and the true noise. PoseLib sees them as pixels of a pinhole camera, up to 120 degrees.
"""

import argparse
import itertools
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pycolmap

import omnisight as om
from benchmarks import twoview_methods as methods
from benchmarks.twoview_methods import WIDEST, Tally
from benchmarks.twoview_scenes import COUNT, FIELDS_DEG, MOTIONS, OUTLIERS, SIGMAS_DEG, Cell, known_points, seen_points

# Our time should be at most this fraction of that of pycolmap.
TIME_GOAL = 0.2


class Result(NamedTuple):
    """The tallies of one cell: ours, pycolmap's and PoseLib's, those that take part."""

    cell: Cell
    tallies: dict[str, Tally]

    @property
    def ours(self) -> Tally:
        return self.tallies["ours"]

    @property
    def time_ratio(self) -> float:
        """Our processor time over that of pycolmap."""
        return float(np.sum(self.ours.cpu) / np.sum(self.tallies["pycolmap"].cpu))

    @property
    def lost(self) -> list[str]:
        """In what a peer is better, or we are not fast enough."""
        others = [tally for name, tally in self.tallies.items() if name != "ours"]
        lost = ["success"] if any(tally.success > self.ours.success for tally in others) else []
        for k, name in enumerate(("rotation", "direction")):
            lost += [name] if any(tally.medians[k] < self.ours.medians[k] for tally in others) else []
        return lost + (["time"] if self.time_ratio > TIME_GOAL else [])


def run_cell(cell: Cell, pairs: int) -> Result:
    peers = {"ours": methods.ours, "pycolmap": methods.colmap}
    if cell.fov_deg <= WIDEST:
        peers["PoseLib"] = methods.poselib_relative
    tallies = {name: Tally() for name in peers}
    for seed in range(pairs):
        a, b, truth = cell.pair(seed)
        for name, method in peers.items():
            tallies[name].add(lambda m=method, a=a, b=b: m(a, b, cell.sigma_deg), truth, 5)
    return Result(cell, tallies)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    print("\n| " + " | ".join(header) + " |\n" + "|---" * len(header) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def joined(result: Result, value: Callable[[Tally], str]) -> str:
    return " / ".join(value(tally) for tally in result.tallies.values())


def cell_row(result: Result) -> tuple[str, ...]:
    cell = result.cell
    return (
        f"{cell.motion}, {cell.fov_deg:g}°, {100 * cell.outliers:.0f} %, {cell.sigma_deg:g}°",
        joined(result, lambda t: f"{100 * t.success:.1f}"),
        joined(result, lambda t: f"{t.medians[0]:.4f}"),
        joined(result, lambda t: f"{t.medians[1]:.3f}"),
        joined(result, lambda t: f"{np.mean(t.cpu):.1f}"),
        joined(result, lambda t: f"{np.mean(t.wall):.1f}"),
        f"{result.time_ratio:.2f}",
        f"{np.mean(result.ours.squares):.2f}",
        ", ".join(result.lost),
    )


def relative_table(cells: Sequence[Cell], pairs: int) -> list[Result]:
    print(f"\nRelative pose, {pairs} pairs per cell: ours / pycolmap / PoseLib (up to {WIDEST:g}°)")
    results = []

    def rows() -> Iterable[Sequence[str]]:
        for cell in cells:
            results.append(run_cell(cell, pairs))
            yield cell_row(results[-1])

    header = ("motion, field of view, outliers, noise", "success %", "rotation °", "direction °", "CPU ms", "wall ms")
    table((*header, "CPU / pycolmap's", "error²/covariance", "a peer is better"), rows())
    return results


def summary_table(title: str, results: Sequence[Result], key: Callable[[Cell], str]) -> None:
    """Print success and normalized errors over all cells of a kind, and means over cells of the medians."""
    print(f"\n{title}: ours / pycolmap / PoseLib")
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result.cell), []).append(result)

    def mean(group: list[Result], value: Callable[[Tally], float], digits: int) -> str:
        names = [name for name in group[0].tallies if all(name in result.tallies for result in group)]
        return " / ".join(f"{np.mean([value(result.tallies[name]) for result in group]):.{digits}f}" for name in names)

    rows = [
        (
            name,
            mean(group, lambda t: 100 * t.success, 1),
            mean(group, lambda t: t.medians[0], 3),
            mean(group, lambda t: t.medians[1], 2),
            mean(group, lambda t: float(np.mean(t.cpu)), 0),
            f"{np.median([result.time_ratio for result in group]):.2f}",
            f"{np.mean(np.concatenate([result.ours.squares for result in group])):.2f}",
        )
        for name, group in groups.items()
    ]
    table(("", "success %", "rotation °", "direction °", "CPU ms", "CPU / pycolmap's", "error²/covariance"), rows)


def lost_table(results: Sequence[Result]) -> None:
    names = ("success", "rotation", "direction", "time")
    counts = [f"{sum(name in result.lost for result in results)} of {len(results)}" for name in names]
    print(f"\nCells in which a peer is better, or our time more than {TIME_GOAL:g} of pycolmap's")
    table(names, [counts])


def unknown_noise_table(pairs: int) -> None:
    print(f"\nRelative pose with unknown noise, ours, general motion, 30 % outliers, {pairs} pairs per cell")

    def row(fov_deg: float, sigma_deg: float) -> tuple[str, ...]:
        cell, tally = Cell("general", fov_deg, 0.3, sigma_deg), Tally()
        sigmas = []
        for seed in range(pairs):
            a, b, truth = cell.pair(seed)
            tally.add(lambda a=a, b=b: methods.ours(a, b, None), truth, 5)
            sigmas.append(om.relative_pose(a, b).sigma_deg)
        return f"{fov_deg:g}°, {sigma_deg:g}°", f"{np.mean(sigmas):.4f}", *own_values(tally)

    header = ("field of view, noise", "estimated noise °", "success %", "rotation °", "direction °", "CPU ms")
    table((*header, "error²/covariance"), (row(*cell) for cell in itertools.product(FIELDS_DEG, SIGMAS_DEG)))


def own_values(tally: Tally) -> tuple[str, ...]:
    rotation, direction = tally.medians
    errors = f"{rotation:.4f}", f"{direction:.3f}"
    return f"{100 * tally.success:.1f}", *errors, f"{np.mean(tally.cpu):.1f}", f"{np.mean(tally.squares):.2f}"


def absolute_table(pairs: int) -> None:
    print(f"\nAbsolute pose, points at 2 to 10 units, noise 0.1°, {pairs} images per cell: ours / PoseLib")

    def row(fov_deg: float, outliers: float) -> tuple[str, ...]:
        peers = {"ours": methods.ours_absolute} | ({"P": methods.poselib_absolute} if fov_deg <= WIDEST else {})
        tallies = {name: Tally() for name in peers}
        for seed in range(pairs):
            points, bearings, truth = known_points(fov_deg, outliers, 0.1, seed)
            for name, method in peers.items():
                tallies[name].add(lambda m=method, p=points, b=bearings: m(p, b, 0.1), truth, 6)
        errors = [" / ".join(f"{t.medians[k]:.4f}" for t in tallies.values()) for k in range(2)]
        cpu = " / ".join(f"{np.mean(t.cpu):.1f}" for t in tallies.values())
        return f"{fov_deg:g}°, {100 * outliers:.0f} %", *errors, cpu, f"{np.mean(tallies['ours'].squares):.2f}"

    cells = itertools.product((60, 120, 360), (0.0, 0.3, 0.7))
    header = "field of view, outliers", "rotation °", "position", "CPU ms", "error²/covariance"
    table(header, (row(*cell) for cell in cells))


def triangulation_table(pairs: int) -> None:
    print(f"\nTriangulation, cameras one unit apart, 500 points at 2 to 10 units all around, {pairs} scenes per row")
    header = "views, noise, method", "median error, units", "CPU µs per point", "error²/covariance"
    cells = itertools.product((2, 5), SIGMAS_DEG)
    table(header, itertools.chain.from_iterable(triangulation_rows(*cell, pairs) for cell in cells))


def triangulation_rows(views: int, sigma_deg: float, pairs: int) -> Iterable[tuple[str, ...]]:
    """Yield the rows of both methods, for the points with a valid result of ours."""
    errors, peer_errors, squares, cpu = [], [], [], np.zeros(2)
    for seed in range(pairs):
        poses, bearings, points = seen_points(views, sigma_deg, seed)
        start = time.process_time()
        found = om.triangulate(poses, bearings, sigma_deg=sigma_deg)
        middle = time.process_time()
        peer = colmap_points(poses, bearings)
        cpu += middle - start, time.process_time() - middle
        step = (found.points - points)[found.valid]
        errors.append(np.linalg.norm(step, axis=1))
        peer_errors.append(np.linalg.norm((peer - points)[found.valid], axis=1))
        squares.append(np.einsum("ni,nij,nj->n", step, np.linalg.inv(found.covariance[found.valid]), step) / 3)
    cpu *= 1e6 / (pairs * COUNT)
    name = f"{views}, {sigma_deg:g}°"
    mean = np.mean(np.concatenate(squares))
    yield f"{name}, ours", f"{np.median(np.concatenate(errors)):.4f}", f"{cpu[0]:.1f}", f"{mean:.2f}"
    yield f"{name}, pycolmap", f"{np.median(np.concatenate(peer_errors)):.4f}", f"{cpu[1]:.1f}", ""


def colmap_points(poses: Sequence[om.Pose], bearings: np.ndarray) -> np.ndarray:
    """Return points of pycolmap; NaN where it finds none."""
    matrices = [np.column_stack([pose.rotation, pose.translation]) for pose in poses]
    if len(poses) == 2:
        found = [pycolmap.triangulate_point(matrices[0], matrices[1], a, b) for a, b in zip(*bearings, strict=True)]
    else:
        found = [pycolmap.triangulate_multi_view_point(matrices, rays) for rays in bearings.swapaxes(0, 1)]
    return np.array([np.full(3, np.nan) if point is None else point for point in found])


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks twoview", description=__doc__)
    parser.add_argument("--pairs", type=int, default=20, help="pairs per cell")
    parser.add_argument("--quick", action="store_true", help="4 pairs in a seventh of the cells")
    options = parser.parse_args(arguments)
    pairs = 4 if options.quick else options.pairs
    cells = [Cell(*cell) for cell in itertools.product(MOTIONS, FIELDS_DEG, OUTLIERS, SIGMAS_DEG)]
    cells = cells[::7] if options.quick else cells
    # Compiles, or reads compiled code.
    run_cell(cells[0], 1)
    bearings, _, _ = cells[0].pair(0)
    methods.ours(bearings, bearings, 0.1)  # of a rotation, which cells with few inliers have
    methods.ours_absolute(*known_points(60, 0, 0.1, 0)[:2], 0.1)
    om.triangulate(*seen_points(2, 0.1, 0)[:2])
    results = relative_table(cells, pairs)
    summary_table("By motion and field of view", results, lambda c: f"{c.motion}, {c.fov_deg:g}°")
    summary_table("By outliers and noise", results, lambda c: f"{100 * c.outliers:.0f} %, {c.sigma_deg:g}°")
    lost_table(results)
    unknown_noise_table(pairs)
    absolute_table(pairs)
    triangulation_table(pairs)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
