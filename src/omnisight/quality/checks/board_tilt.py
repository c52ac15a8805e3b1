"""Check that the boards are tilted against each other."""

import numpy as np

from omnisight.calibration.state import State
from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.identifiability import focal_relative_sigma

PRIORITY = 1

# Largest angle between two boards below which they count as parallel, and as little tilted. Cameras calibrated from
# parallel boards were up to 35 times farther off than stated; from 20° on they were off as stated.
PARALLEL_DEG, MIN_TILT_DEG = 10.0, 20.0
# Relative standard deviation of the focal length up to which it is determined: 2 % of the image radius at the edge.
MAX_FOCAL_SIGMA = 0.02
# Relative standard deviation above which its value is not printed.
MAX_PRINTED_SIGMA = 10


def check(evidence: Evidence) -> Check:
    """Check that the boards are tilted: parallel boards determine only focal length divided by distance."""
    state, camera = evidence.candidate.state, evidence.camera
    tilt = largest_tilt_deg(state)
    if len(evidence.observations) < 2 or tilt >= MIN_TILT_DEG or not evidence.observations.is_planar:
        return Check("board tilt")
    # Parallel boards that are tilted against the optical axis determine the focal length of a wide lens.
    off_axis = float(np.degrees(np.arccos(np.clip(np.abs(state.rotations[:, 2, 2]), 0, 1))).max())
    sigma = focal_relative_sigma(camera)
    determined = off_axis >= MIN_TILT_DEG and sigma is not None and sigma < MAX_FOCAL_SIGMA
    percent = ""
    if sigma is not None and sigma >= MAX_FOCAL_SIGMA:
        percent = f" (±{100 * sigma:.0f} %)" if sigma < MAX_PRINTED_SIGMA else f" (above ±{100 * MAX_PRINTED_SIGMA} %)"
    consequence = (
        "so only the distortion of the lens determines the focal length"
        if determined
        else f"which does not determine the focal length{percent}"
    )
    return Check(
        "board tilt",
        Level.DO_NOT_USE if tilt < PARALLEL_DEG and not determined else Level.USABLE,
        f"The boards are tilted by only {tilt:.0f}° against each other, {consequence}: take images with the board"
        " tilted by 30° to 45° in both directions.",
    )


def largest_tilt_deg(state: State) -> float:
    """Return the largest angle (degrees) between the planes of two boards."""
    normals = state.rotations[:, :, 2]
    return float(np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T), 0, 1))).max())
