"""HTML of a non-central camera: its figures and its radial profile for a distant scene."""

from omnisight.ray_camera import RayCamera
from omnisight.report.notebook import camera as camera_html
from omnisight.report.notebook._summary import summary


def html(camera: RayCamera) -> str:
    """Return the model, the size, the field of view and the profile of a camera."""
    return summary("RayCamera", figures(camera), drawing(camera), ["Figures and profile are those of a distant scene."])


def figures(camera: RayCamera) -> dict[str, str]:
    """Return the figures of a camera by name."""
    return camera_html.figures(camera.central_limit) | {"model": f"{camera.model.name}, non-central"}


def drawing(camera: RayCamera) -> str | None:
    """Return the radial profile for a distant scene as SVG; None if no direction is visible."""
    return camera_html.drawing(camera.central_limit)
