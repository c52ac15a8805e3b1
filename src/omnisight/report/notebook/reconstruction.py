"""HTML of a reconstruction: its images from above."""

import numpy as np

from omnisight.reconstructions import up_direction
from omnisight.report.notebook._summary import plan, summary
from omnisight.sfm.reconstruction import Reconstruction


def html(reconstruction: Reconstruction) -> str:
    """Return the numbers of images and points and a plan of the images."""
    unit = "m" if reconstruction.has_scale else "units"
    figures = {
        "images": str(len(reconstruction)),
        "cameras": ", ".join(camera.model.name for camera in reconstruction.rig.cameras),
        "points": str(len(reconstruction.points)),
        "observations": str(len(reconstruction.observations)),
        "scale": "metric" if reconstruction.has_scale else "unknown",
    }
    poses = {name: reconstruction.world_from_cam(i) for i, name in enumerate(reconstruction.names)}
    up = up_direction(reconstruction)
    # Any two directions across the vertical span the plan.
    right = np.asarray(np.cross(up, np.eye(3)[np.argmin(np.abs(up))]), float)
    right /= np.linalg.norm(right)
    forward = np.asarray(np.cross(up, right), float)
    return summary("Reconstruction", figures, plan(poses, unit, (right, forward)) if poses else None)
