"""HTML of a stitched sphere: the sphere and the measures of its seams."""

import numpy as np

from omnisight.pipeline.stitching.stitch import StitchResult
from omnisight.report.notebook._summary import photo_url, summary


def html(result: StitchResult) -> str:
    """Return the sphere, its size and the disparity of each seam."""
    distance = "infinite" if np.isinf(result.distance) else f"{result.distance:.3g} {result.rig.unit}"
    figures = {
        "size": f"{result.camera.width} x {result.camera.height} px",
        "cameras": ", ".join(result.rig.names),
        "covered": f"{result.covered:.1%} of the sphere",
        "distance": distance,
        "spheres": str(result.frames),
    }
    for k, seam in enumerate(result.seams, 1):
        figures[f"seam {k}"] = f"disparity {seam.disparity_deg:.2f}°, overlap {seam.overlap_deg:.1f}°"
    notes = [result.warning] if result.warning else []
    return summary("StitchResult", figures, photo_url(result.image), notes)
