"""HTML of an evaluation: its statistics, and its corners over the image."""

import numpy as np

from omnisight.calibration.evaluation import Evaluation
from omnisight.report.notebook._summary import corner_map, summary


def html(evaluation: Evaluation) -> str:
    """Return the residual lengths, over all corners and by angle, and the corners; outliers are red."""
    statistics, outliers = evaluation.statistics(), evaluation.outliers
    pixels = evaluation.observations.pixels
    figures = {
        "camera": evaluation.camera.model.name,
        "images": str(len(evaluation.observations)),
        "corners": f"{len(pixels)}, {int(outliers.sum())} outliers (red)",
        "rms": f"{statistics.rms:.3f} px",
        "median": f"{statistics.median:.3f} px",
        "largest": f"{statistics.worst:.3f} px",
    }
    for ring in evaluation.rings():
        angles = f"{np.degrees(ring.start):.0f}° to {np.degrees(ring.stop):.0f}°"
        figures[angles] = f"{ring.statistics.rms:.3f} px rms, {ring.statistics.corners} corners"
    drawing = corner_map(evaluation.camera.size, {"#1f77b4": pixels[~outliers], "#d62728": pixels[outliers]})
    return summary("Evaluation", figures, drawing)
