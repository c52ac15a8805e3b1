"""Boards in rendered images: how much of them the detectors find, and how well, as the images get worse.

One factor is varied at a time from a base of 1 px blur and 2 % noise; the hard mix draws all of them at random.
Each cell holds five poses for each of five cameras.
"""

import multiprocessing as mp
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.boards_detectors import DETECTORS, Found, Score, score, summary, timed
from benchmarks.boards_scene import BOARD, LENSES, Scene, Shot, shoot

POSES = ((0.0, 15.0, 40.0), (0.35, 35.0, 26.0), (0.6, 50.0, 20.0), (0.8, 25.0, 30.0), (0.95, 60.0, 14.0))
"""Place, tilt, and square of the poses that each camera has."""

FACTORS: dict[str, tuple[float, ...]] = {
    "blur": (0.0, 2.0),
    "noise": (0.0, 5.0),
    "jpeg": (95, 80, 60),
    "light": (3.0,),
    "visible": (0.8, 0.6, 0.4, 0.2),
    "square": (8.0, 12.0, 20.0, 60.0),
    "tilt": (0.0, 60.0, 75.0),
}
UNITS = {"blur": "{:g} px", "noise": "{:g} %", "jpeg": "{:g}", "light": "factor {:g}", "visible": "{:.0%}"}
UNITS |= {"square": "{:g} px", "tilt": "{:g} deg"}
MIXED = 60


@dataclass(frozen=True, eq=False)
class Result:
    """One image's scores, and what was found, by detector."""

    cell: str
    shot: Shot
    scores: dict[str, Score]
    found: dict[str, Found]


def cells(only: Iterable[str] = (), *, quick: bool = False) -> dict[str, list[Shot]]:
    """Return the images of each cell; `only` names factors, "base" and "mix"; quick takes two poses per camera."""
    only = set(only)
    if unknown := only - {"base", "mix", *FACTORS}:
        raise ValueError(f"unknown cells {', '.join(sorted(unknown))}; there are base, mix, {', '.join(FACTORS)}")
    poses = list(enumerate(POSES))[1::3] if quick else list(enumerate(POSES))
    base = [Shot(lens, *pose, seed=i) for lens in LENSES for i, pose in poses]
    made = {"base": base} if not only or "base" in only else {}
    for factor, values in FACTORS.items():
        if not only or factor in only:
            for value in values:
                made[f"{factor} {UNITS[factor].format(value)}"] = [replace(s, **{factor: value}) for s in base]
    if not only or "mix" in only:
        made["mix"] = list(_mixed(MIXED // 5 if quick else MIXED))
    return made


def _mixed(count: int) -> Iterator[Shot]:
    rng = np.random.default_rng(7)
    for i in range(count):
        yield Shot(
            lens=list(LENSES)[i % len(LENSES)],
            place=round(rng.uniform(0, 0.95), 3),
            tilt=round(rng.uniform(0, 60), 1),
            square=round(float(np.exp(rng.uniform(np.log(12), np.log(60)))), 1),
            seed=1000 + i,
            blur=float(rng.choice([0.0, 1.0, 2.0])),
            noise=float(rng.choice([0.0, 2.0, 5.0])),
            jpeg=int(rng.choice([0, 95, 80, 60])),
            light=float(rng.choice([1.0, 3.0])),
            visible=float(rng.choice([1.0, 1.0, 0.8, 0.6, 0.4])),
        )


def measure(only: Iterable[str] = (), *, quick: bool = False, names: Iterable[str] = tuple(DETECTORS)) -> list[Result]:
    """Run the detectors over the images, two processes of one thread each."""
    names = tuple(names)
    jobs = [(cell, shot, names) for cell, shots in cells(only, quick=quick).items() for shot in shots]
    results: list[Result] = []
    with ProcessPoolExecutor(2, mp.get_context("spawn"), _prepare, (names,)) as pool:
        for result in pool.map(judge, jobs, chunksize=2):
            results.append(result)
            print(f"\r{len(results)} of {len(jobs)} images", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return results


def _prepare(names: tuple[str, ...]) -> None:
    cv2.setNumThreads(1)
    os.environ["NUMBA_NUM_THREADS"] = "1"  # read when it is first imported, which is below
    easy = shoot(Shot("fisheye 100", 0.0, 0.0, 40.0, 0)).image
    for name in names:  # compiled and warm
        timed(name, easy, BOARD)


def judge(job: tuple[str, Shot, tuple[str, ...]]) -> Result:
    """Take an image and judge what the detectors find in it."""
    cell, shot, names = job
    scene = shoot(shot)
    found = {name: timed(name, scene.image, BOARD) for name in names}
    return Result(cell, shot, {name: rate(name, f, scene) for name, f in found.items()}, found)


def rate(name: str, found: Found, scene: Scene) -> Score:
    """Score a detector; only ours promises what id a corner has."""
    ids = true_ids(scene.corners) if name == "omnisight" else None
    return score(found, scene.corners, scene.visible, ids, strict=found.located)


def true_ids(corners: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the ids (54,) that corners have in the order clockwise as seen: a mirror turns the rows around."""
    grid = corners.reshape(BOARD.rows, BOARD.columns, 2)
    right, down = np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1]
    turn = np.nanmedian(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])
    ids = np.arange(BOARD.size).reshape(BOARD.rows, BOARD.columns)
    return (ids if turn > 0 else ids[::-1]).ravel()


def figures(results: list[Result]) -> dict[str, dict[str, dict[str, float]]]:
    """Sum up by cell, then by camera over all cells, and by detector."""
    rows: dict[str, list[Result]] = {}
    for result in results:
        rows.setdefault(result.cell, []).append(result)
    for result in results:
        rows.setdefault(f"all, {result.shot.lens}", []).append(result)
    rows["all"] = results
    return {
        row: {name: summary(r.scores[name] for r in members) for name in members[0].scores}
        for row, members in rows.items()
    }


def table(rows: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the figures as a Markdown table, the detectors side by side in each cell."""
    names = list(next(iter(rows.values())))
    lines = [
        f"| {' / '.join(names)} | recall, % | precision, % | rms, px | 95 % below, px | NEES mean, median | ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for row, by_name in rows.items():
        each = [by_name[name] for name in names]
        mine = by_name.get("omnisight", {"nees": np.nan, "nees_median": np.nan})
        nees = f"{mine['nees']:.2f}, {mine['nees_median']:.2f}" if np.isfinite(mine["nees"]) else "-"
        columns = [
            " / ".join(_number(100 * e["recall"], ".1f") for e in each),
            " / ".join(_number(100 * e["precision"], ".1f") for e in each),
            " / ".join(_number(e["rms"], ".3f") for e in each),
            " / ".join(_number(e["p95"], ".3f") for e in each),
            nees,
            " / ".join(_number(1e3 * e["seconds"], ".0f") for e in each),
        ]
        lines.append(f"| {row} | {' | '.join(columns)} |")
    return "\n".join(lines)


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"


def worst(results: list[Result], name: str = "omnisight", count: int = 40) -> list[Result]:
    """Return the images in which a detector misses or errs most, the worst first."""

    def loss(result: Result) -> float:
        s = result.scores[name]
        far = float(np.sqrt((s.errors**2).sum(1).max())) if s.right else 0.0
        return 2 * (s.reported - s.right) + (s.visible - s.right) + far

    bad = [r for r in results if not r.scores[name].clean]
    return sorted(bad, key=loss, reverse=True)[:count]
