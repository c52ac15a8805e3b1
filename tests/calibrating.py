"""Calibration of simulated corners by the functions that a user calls."""

import omnisight as om
from omnisight.progress import no_progress

SIZE = (960, 960)


def observe(views, size=SIZE, names=None, **options):
    """Return the observations of one (board points, pixels) or (board points, pixels, covariance) per view."""
    board_points, pixels, *covariance = zip(*views, strict=True) if views else ((), ())
    return om.Observations.from_arrays(board_points, pixels, *covariance, size=size, names=names, **options)


def calibrate(observations, *, progress=no_progress, **options):
    """Calibrate with the given `CalibrateOptions`."""
    return om.calibrate(observations, om.CalibrateOptions(**options), progress=progress)
