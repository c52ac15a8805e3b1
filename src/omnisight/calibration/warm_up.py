"""Compile the calibration loops before they are needed."""

import threading


def start_warm_up() -> threading.Thread:
    """Start a daemon thread that runs `warm_up`, for the time in which images are read or boards detected."""
    thread = threading.Thread(target=warm_up, name="omnisight-warm-up", daemon=True)
    thread.start()
    return thread


def warm_up() -> None:
    """Run a minimal calibration, so that its loops are compiled or loaded from the cache.

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
