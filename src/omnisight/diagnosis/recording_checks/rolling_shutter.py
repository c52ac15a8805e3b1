"""Check of the readout of the sensor."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 70

# Standard deviation of the readout time (seconds) above which it is not determined: a quarter of that of a phone.
MAX_SIGMA_S = 0.005
# Significance of a rolling shutter, and the readout time below which it does not matter.
MIN_SIGMAS, MIN_READOUT_S = 4.0, 0.002


def check(recording: Recording) -> Finding:
    """Check whether rows are read one after the other, if the camera turns fast enough to show it."""
    readout = recording.readout
    if readout is None or not readout.sigma < MAX_SIGMA_S:
        measured = "" if readout is None else f"readout known to {1e3 * readout.sigma:.0f} ms (1σ): "
        return Finding("rolling shutter", Level.UNKNOWN, f"{measured}the camera must turn faster to show it")
    figure = f"readout {1e3 * readout.seconds:.1f} ± {1e3 * readout.sigma:.1f} ms (1σ)"
    rate = float(np.nanmax([step.turn_rate_deg for step in recording.steps]))
    if readout.seconds < max(MIN_SIGMAS * readout.sigma, MIN_READOUT_S):
        return Finding("rolling shutter", Level.OK, f"{figure}: global, or too fast to matter")
    figure += f": rolling; rows differ by up to {rate * readout.seconds:.2f}° at {rate:.0f}°/s"
    return Finding("rolling shutter", Level.WARNING, figure, "turn slowly, or use a camera with a global shutter")
