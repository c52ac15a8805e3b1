"""Check of the calibration file."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 0


def check(recording: Recording) -> Finding:
    """Check that there is a calibrated camera, its field of view, its verdict, and that the images agree with it."""
    camera = recording.camera
    if camera is None:
        return Finding("calibration", Level.FAILED, recording.camera_reason, "calibrate it: omnisight calibrate")
    view = camera.theta_max if camera.theta_max is not None else camera.model.theta_max
    figure = f"{camera.model.name}, {camera.width}x{camera.height} px, {2 * np.degrees(view):.0f}° field of view"
    if (change := recording.focal_length_change) and change.is_suspicious:
        figure += f"; the images agree best with {change.description}"
        advice = "does the file belong to this camera, its zoom and resolution? Otherwise calibrate it again"
        return Finding("calibration", Level.WARNING, figure, advice)
    verdict = str(camera.calibration.get("verdict", ""))
    if verdict:
        figure += f", verdict {verdict}"
    if verdict == "do not use":
        reasons = [str(reason) for reason in camera.calibration.get("reasons", ())]
        return Finding("calibration", Level.WARNING, figure, " ".join(reasons) or "calibrate it again")
    if camera.theta_max is None and camera.model.period is None:
        advice = "the file does not state up to which angle it was calibrated: calibrate it with omnisight calibrate"
        return Finding("calibration", Level.WARNING, f"{figure} (of the model)", advice)
    return Finding("calibration", Level.OK, figure)
