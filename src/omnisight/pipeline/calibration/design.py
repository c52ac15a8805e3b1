"""Design of a mirror camera: the counterpart of `omnisight design`."""

import math
from dataclasses import dataclass

import numpy as np

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.optics.design.mirror_design import MirrorDesign, design_mirror
from omnisight.optics.design.performance import Performance, evaluate_design
from omnisight.optics.design.specification import MirrorSpecification
from omnisight.pipeline.calibration.design_options import DesignOptions
from omnisight.pipeline.calibration.provenance import tool_provenance
from omnisight.ray_camera import RayCamera


@dataclass(frozen=True)
class DesignResult(Displayed):
    """A designed mirror camera.

    Attributes
    ----------
    mirror_design
        The mirror, the lens and their distance.
    performance
        Blind spot, resolution, viewpoint and sensitivity to misalignment, by ray tracing.
    camera
        The unified model for a design with a single viewpoint; otherwise the lens and its mirror.
    """

    mirror_design: MirrorDesign
    performance: Performance
    camera: Camera | RayCamera


def design(options: DesignOptions | None = None) -> DesignResult:
    """Design a camera that looks into a mirror above it and sees all around.

    Parameters
    ----------
    options
        Field of view, sensor, and the sizes that are fixed.

    Raises
    ------
    ValueError
        If the requirements are impossible; the message has the reason and the remedy.
    """
    options = options or DesignOptions()
    specification = MirrorSpecification(
        options.kind,
        float(np.radians(options.up)),
        float(np.radians(options.down)),
        options.sensor,
        options.pixel,
        focal=options.focal,
        diameter=options.diameter,
        distance=options.distance,
        body=options.body,
        working_distance=options.working_distance,
    )
    mirror_design = design_mirror(specification)
    performance = evaluate_design(mirror_design)
    return DesignResult(mirror_design, performance, _camera(mirror_design, performance))


def _camera(mirror_design: MirrorDesign, performance: Performance) -> Camera | RayCamera:
    """Return the camera of a design with its field of view."""
    specification = mirror_design.specification
    provenance = tool_provenance() | {"source": f"omnisight design mirror --kind {specification.kind}"}
    near, far = performance.blind.theta, specification.theta
    if mirror_design.central:
        model = mirror_design.model()
        return Camera(model, specification.size, theta_min=near, theta_max=far, provenance=provenance)
    # In the lens frame, whose z points up into the mirror.
    return RayCamera(
        mirror_design.system(),
        specification.size,
        theta_min=math.pi - far,
        theta_max=math.pi - near,
        provenance=provenance,
    )
