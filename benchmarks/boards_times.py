"""Time of the detectors in large images, and in images without a board."""

import multiprocessing as mp
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as Late

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.boards_detectors import DETECTORS, timed
from benchmarks.boards_scene import BOARD, Shot, lenses, shoot

SIZES = {1: (1155, 866), 5: (2582, 1936), 12: (4000, 3000)}
PATIENCE = 60.0  # seconds


def measure(sizes: tuple[int, ...] = tuple(SIZES)) -> dict[str, dict[str, float]]:
    """Return seconds by image and detector; infinity past a minute."""
    rows: dict[str, dict[str, float]] = {}
    for megapixels in sizes:
        for kind in ("board", "black", "white", "noise"):
            rows[f"{kind}, {megapixels} MP"] = {name: _patiently(name, kind, megapixels) for name in DETECTORS}
    return rows


def _patiently(name: str, kind: str, megapixels: int) -> float:
    with ProcessPoolExecutor(1, mp.get_context("spawn")) as pool:
        try:
            return pool.submit(_measure, name, kind, megapixels).result(PATIENCE + 10)
        except Late:
            for process in mp.active_children():
                process.terminate()
            return float("inf")


def _measure(name: str, kind: str, megapixels: int) -> float:
    cv2.setNumThreads(2)
    timed(name, shoot(Shot("fisheye 100", 0.0, 0.0, 40.0, 0)).image, BOARD)  # compiled and warm
    image = _test_image(kind, megapixels)
    start = time.perf_counter()
    timed(name, image, BOARD)
    return time.perf_counter() - start


def _test_image(kind: str, megapixels: int) -> NDArray[np.uint8]:
    size = SIZES[megapixels]
    if kind == "noise":
        return np.random.default_rng(0).integers(0, 256, size[::-1], np.uint8)
    if kind in ("black", "white"):
        return np.full(size[::-1], 255 if kind == "white" else 0, np.uint8)
    scale = size[0] / 1000
    shot = Shot("fisheye 180", 0.0, 30.0, 36.0 * scale, 0)
    return shoot(shot, lenses(scale)[shot.lens]).image[: size[1]]


def table(rows: dict[str, dict[str, float]]) -> str:
    lines = [f"| seconds | {' | '.join(DETECTORS)} |", "|---|" + "---|" * len(DETECTORS)]
    for row, by_name in rows.items():
        times = [f"{t:.3f}" if np.isfinite(t) else f"over {PATIENCE:.0f}" for t in by_name.values()]
        lines.append(f"| {row} | {' | '.join(times)} |")
    return "\n".join(lines)
