"""HTML of a calibration: its verdict, its camera and its figures."""

from omnisight.camera import Camera
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.report.notebook import camera as camera_html
from omnisight.report.notebook import ray_camera as ray_camera_html
from omnisight.report.notebook._summary import summary


def html(calibration: Calibration) -> str:
    """Return the verdict with its reasons, the residuals and the camera."""
    camera, held_out = calibration.camera, calibration.held_out_rms
    figures = {
        "verdict": str(calibration.verdict),
        "rms": f"{calibration.rms:.3f} px",
        "held-out error": "unknown: too few images" if held_out is None else f"{held_out:.3f} px",
        "images": f"{len(calibration.observations)}",
        "corners": f"{len(calibration.observations.pixels)}, {int(calibration.outliers.sum())} outliers",
    }
    if isinstance(camera, Camera):
        figures |= camera_html.figures(camera)
        drawing = camera_html.drawing(camera)
    else:
        figures |= ray_camera_html.figures(camera)
        drawing = ray_camera_html.drawing(camera)
    return summary(f"Calibration, {calibration.best.name}", figures, drawing, calibration.reasons)
