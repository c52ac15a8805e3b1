"""HTML of a camera: its figures and its radial profile."""

import numpy as np

from omnisight.camera import Camera
from omnisight.pipeline.conversion.inspect import extrapolated_beyond_deg, radial_profile
from omnisight.report.drawings.radial_profile import profile_svg
from omnisight.report.notebook._summary import summary


def html(camera: Camera) -> str:
    """Return the model, the size, the field of view and the profile of a camera."""
    return summary("Camera", figures(camera), drawing(camera))


def figures(camera: Camera) -> dict[str, str]:
    """Return the figures of a camera by name."""
    ends = "beyond the model" if all(camera.size) else "unknown"
    sides = [f"{angle:.1f}°" if np.isfinite(angle) else ends for angle in camera.fov]
    calibrated = camera.theta_max
    limit = extrapolated_beyond_deg(camera, camera.fov)
    note = "" if limit is None else f", extrapolated beyond {limit:.1f}°"
    return {
        "model": camera.model.name,
        "image size": f"{camera.width} x {camera.height} px" if all(camera.size) else "unknown",
        "field of view": f"{sides[0]} horizontal, {sides[1]} vertical, {sides[2]} diagonal{note}",
        "focal length": f"{camera.focal:.2f} px per radian on the axis",
        "calibrated": "unknown" if calibrated is None else f"to {np.degrees(calibrated):.1f}° off-axis",
        "uncertainty": "unknown" if camera.covariance is None else "known: om.plot_uncertainty(camera)",
    }


def drawing(camera: Camera) -> str | None:
    """Return the radial profile as SVG; None if no direction is visible."""
    profile = radial_profile(camera)
    return profile_svg(profile) if len(profile.theta_deg) else None
