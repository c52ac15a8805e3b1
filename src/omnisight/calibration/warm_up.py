"""Compile the calibration loops before they are needed."""

import threading

import numpy as np

from omnisight.compilation import start_processes

# What is compiled by a process each.
PARTS = "omnisight.calibration.warm_up:compile_detection", "omnisight.calibration.warm_up:warm_up"


def start_warm_up() -> threading.Thread:
    """Start a daemon thread that prepares the calibration loops while images are read and boards detected.

    The first run on a machine compiles them in other processes, because a process compiles one function at a time.
    """
    thread = threading.Thread(target=_prepare, name="omnisight-warm-up", daemon=True)
    thread.start()
    return thread


def _prepare() -> None:
    from omnisight.calibration._bundle_kernel import normal_equation_blocks
    from omnisight.compiled import has_code

    if not has_code(normal_equation_blocks):
        for process in start_processes(*PARTS):
            process.wait()
    warm_up()


def compile_detection() -> None:
    """Compile what detection and redetection need and their first steps do not compile."""
    from omnisight.targets.subpixel.corner_fit import fit_corners

    corner = np.kron(np.eye(2, dtype=np.uint8), np.full((50, 50), 255, np.uint8))
    fit_corners(corner, np.full((1, 2), 49.5), 20.0 * np.eye(2)[None], np.zeros((1, 2, 2)))


def warm_up() -> None:
    """Run a minimal calibration, which compiles its loops or loads them from the cache.

    Takes seconds on the first run on a machine, tenths of a second afterwards.
    """
    from omnisight.calibration.bundle_adjustment import refine
    from omnisight.calibration.resection import resect
    from omnisight.geometry import rotation as so3
    from omnisight.models.equidistant import Equidistant
    from omnisight.targets import Checkerboard
    from omnisight.targets.observations import Observations

    model = Equidistant.example()
    board = Checkerboard(4, 3).points
    rotations = so3.exp([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (-0.3, 0.0, 0.2)])
    pixels = [model.project_numpy(board @ r.T + (-1.5, -1.0, 4.0))[0] for r in rotations]
    observations = Observations.from_arrays([board] * len(pixels), pixels, size=(960, 963))
    refine(resect(model, observations), observations, iterations=1)
