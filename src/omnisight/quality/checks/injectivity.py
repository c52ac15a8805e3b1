"""Check that the model is injective beyond the corners."""

import numpy as np

from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 9

# Factor by which the fold angle must exceed the angle of the outermost corners.
MIN_FOLD_MARGIN = 1.1
# Angles (radians) this close to pi are the whole sphere.
WHOLE_SPHERE_RAD = 1e-6


def check(evidence: Evidence) -> Check:
    """Check that the model is injective beyond the corners, up to the edge of the image."""
    camera = evidence.camera
    fold, reach = camera.model.fold_angle, camera.theta_max or 0.0
    covers_image = camera.model.unproject_numpy(camera.border())[1].all()
    if fold >= MIN_FOLD_MARGIN * reach or fold >= np.pi - WHOLE_SPHERE_RAD or covers_image:
        return Check("injectivity")
    return Check(
        "injectivity",
        Level.USABLE,
        f"The model is not injective beyond {np.degrees(fold):.0f}° off-axis, and corners reach"
        f" {np.degrees(reach):.0f}°: put the board farther out.",
    )
