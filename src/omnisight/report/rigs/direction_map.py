"""All directions around a rig as an equirectangular map."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.rig import Rig
from omnisight.rig_overlap import FAR_BASELINES

Bools = NDArray[np.bool_]

# Size of the map, px: half a degree per pixel.
MAP_WIDTH, MAP_HEIGHT = 720, 360


def visible_directions(rig: Rig) -> Bools:
    """Return (C, H, W) which cameras see each direction of an equirectangular map of the rig frame, far away."""
    longitude = np.radians((np.arange(MAP_WIDTH) + 0.5) / MAP_WIDTH * 360 - 180)
    latitude = np.radians(90 - (np.arange(MAP_HEIGHT) + 0.5) / MAP_HEIGHT * 180)[:, None]
    bearings = np.stack(
        [
            np.sin(longitude) * np.cos(latitude),
            np.broadcast_to(-np.sin(latitude), (MAP_HEIGHT, MAP_WIDTH)),
            np.cos(longitude) * np.cos(latitude),
        ],
        -1,
    )
    centres = [pose.inverse().translation for pose in rig.sensor_from_rig]
    distance = FAR_BASELINES * max(float(np.linalg.norm(centres, axis=1).max()), 1.0)
    return rig.in_view(distance * bearings)


def share_of_sphere(mask: Any) -> float:
    """Return the share of the sphere of a mask (H, W) of an equirectangular map."""
    latitude = np.radians(90 - (np.arange(mask.shape[0]) + 0.5) / mask.shape[0] * 180)
    return float((mask.mean(1) * np.cos(latitude)).sum() / np.cos(latitude).sum())
