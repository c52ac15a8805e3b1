"""Up to which angle other programs read an exported camera as it is."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel

WHOLE_SPHERE_DEG = 180.0
# Samples of the angle, 0.05 degrees apart.
LIMIT_SAMPLES = 1801
# The image may exceed the limit of its reader by this angle: rounding of the outermost samples.
ANGLE_TOLERANCE_DEG = 1e-6


@dataclass(frozen=True)
class Reader:
    """A program that reads a format, and the angle up to which it projects like the camera in the file.

    Attributes
    ----------
    name
        The program, and its version if the limit was measured.
    theta_max_deg
        Largest angle from the axis at which it is exact; 180 if it has no limit of its own.
    beyond
        What it does at larger angles.
    max_radius
        Largest image radius, in focal lengths, at which it is exact.
    """

    name: str
    theta_max_deg: float = WHOLE_SPHERE_DEG
    beyond: str = ""
    max_radius: float = np.inf

    def limit_deg(self, model: CameraModel) -> float:
        """Return the largest angle from the axis at which the program is exact for a model."""
        if self.max_radius == np.inf:
            return self.theta_max_deg
        theta = np.linspace(0, np.radians(self.theta_max_deg), LIMIT_SAMPLES)
        pixels, valid = model.project_numpy(np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1))
        values = model.to_dict()
        exact = valid & ((pixels[:, 0] - values["cx"]) / values["fx"] <= self.max_radius)
        return float(np.degrees(theta[exact].max()))


def reader_note(camera: Camera, readers: Mapping[str, Reader]) -> str:
    """Return where the reader of a format stops or errs, and how far the camera reaches."""
    reached = f"this camera reaches {_reach_deg(camera):.1f} degrees"
    reader = readers.get(camera.model.name)
    if reader is None:
        return f"reader: no program that reads this model was measured; check points past 90 degrees, {reached}"
    limit_deg = reader.limit_deg(camera.model)
    if limit_deg >= WHOLE_SPHERE_DEG:
        return f"reader: {reader.name} reads this model at every angle"
    limit = f"reader: {reader.name} is right up to {limit_deg:.3g} degrees off-axis"
    if _reach_deg(camera) <= limit_deg + ANGLE_TOLERANCE_DEG:
        return f"{limit}, {reached}"
    return f"{limit}; beyond, it {reader.beyond}. Do not use it there: {reached}"


def _reach_deg(camera: Camera) -> float:
    """Return the largest angle from the axis in the calibrated field of view, or in the image."""
    bearings = camera.samples()[0] if all(camera.size) else np.empty((0, 3))
    theta = angle_from_axis(bearings).max() if len(bearings) else camera.theta_max or camera.model.theta_max
    return float(np.degrees(theta))
