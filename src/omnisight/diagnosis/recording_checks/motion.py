"""Check of the motion: parallax determines positions."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 80

# Median parallax of a run of images over its noise: below, the camera turns or does not move.
MIN_PARALLAX_SIGMAS = 3.0
# Share of the runs with a parallax, and share of the patches that the next image shows.
MIN_MOVING_SHARE, MIN_KEPT = 0.3, 0.5


def check(recording: Recording) -> Finding:
    """Check that the camera moves, and that consecutive images have enough in common."""
    runs = [run for run in recording.runs if np.isfinite(run.parallax_sigmas)]
    if not recording.steps:
        return Finding("motion", Level.UNKNOWN, "not measured without a calibrated camera and consecutive images")
    kept = float(np.median([step.kept for step in recording.steps]))
    rates = np.array([step.turn_rate_deg for step in recording.steps])
    rates = rates[np.isfinite(rates)]
    figure = f"{kept:.0%} of the patches are in the next image (median)"
    if len(rates):
        figure = f"turns {np.median(rates):.0f}°/s (median), up to {rates.max():.0f}°/s; {figure}"
    if not runs:
        return Finding(
            "motion", Level.FAILED, figure, "images have too little in common: record more images per second"
        )
    moving = [run for run in runs if run.parallax_sigmas > MIN_PARALLAX_SIGMAS]
    parallax, seconds = np.median([run.parallax_deg for run in runs]), np.median([run.seconds for run in runs])
    figure = f"parallax {parallax:.2f}° in {seconds:.2g} s (median); {figure}"
    if not moving:
        return Finding("motion", Level.FAILED, figure, "the camera only turns or does not move: carry it sideways")
    if kept < MIN_KEPT:
        return Finding("motion", Level.WARNING, figure, "record more images per second, or move more slowly")
    if len(moving) < MIN_MOVING_SHARE * len(runs):
        advice = f"it moves in {len(moving)} of {len(runs)} parts: positions need motion"
        return Finding("motion", Level.WARNING, figure, advice)
    return Finding("motion", Level.OK, figure)
