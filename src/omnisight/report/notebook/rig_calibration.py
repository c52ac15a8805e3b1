"""HTML of the calibration of a rig: its verdict and its cameras from above."""

from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration
from omnisight.report.notebook import rig as rig_html
from omnisight.report.notebook._summary import summary


def html(calibration: RigCalibration) -> str:
    """Return the verdict with its reasons, the residuals of each camera and a plan of the cameras."""
    figures = {"verdict": str(calibration.verdict), "rms": f"{calibration.rms:.3f} px"}
    for name in calibration.rig.names:
        held_out = calibration.camera_held_out_rms(name)
        figures[name] = (
            f"{calibration.images_of(name)} images, rms {calibration.camera_rms(name):.3f} px, held-out error"
            f" {'unknown' if held_out is None else f'{held_out:.3f} px'}"
        )
    return summary("RigCalibration", figures, rig_html.drawing(calibration.rig), calibration.reasons)
