"""HTML of a rig: its cameras from above."""

from omnisight.report.notebook._summary import plan, summary
from omnisight.rig import Rig


def html(rig: Rig) -> str:
    """Return the cameras of a rig and a plan of their positions and view directions."""
    figures = {
        name: f"{camera.model.name}, {camera.width} x {camera.height} px"
        for name, camera in zip(rig.names, rig.cameras, strict=True)
    }
    return summary(f"Rig, {len(rig)} cameras", figures, drawing(rig))


def drawing(rig: Rig) -> str:
    """Return a plan of the positions and view directions of the cameras as SVG."""
    poses = {name: pose.inverse() for name, pose in zip(rig.names, rig.sensor_from_rig, strict=True)}
    return plan(poses, rig.unit)
