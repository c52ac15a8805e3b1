"""Cameras that are nearly known: a lens and its mirror as they were drawn."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.board_pose import linear_board_poses, refine_board_poses
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.state import State
from omnisight.models import CameraModel
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.ray_model import RayModel
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Of the corners a camera to start from shows so many, or is another.
SHOWN = 0.8
# By so much is a mirror drawn wider while it is sought where it stands.
WIDER = 1.25


def whole(model: RayModel, views: Observations) -> RayModel:
    """Give a lens and its one mirror with the mirror wider, and no hole in it.

    Where the mirror does not stand as it was drawn, the corners of boards near its rim lie beyond the drawn one: what
    shows them no more cannot be led to where it does.
    """
    if not isinstance(model, Catadioptric) or len(model.mirrors) != 1:
        return model
    mirror = model.mirrors[0].mirror
    rim = mirror.rim if np.isfinite(mirror.rim) else _distances(model, model.rays(views.pixels)[0]).max(initial=0.0)
    return _ending(model, WIDER * rim, 0.0) if rim > 0 else model


def as_drawn(found: RayModel, model: RayModel, points: Array) -> RayModel:
    """Give a camera that was found the rim and the hole of the drawing, as far as these leave points (N, 3) shown."""
    if not (isinstance(model, Catadioptric) and isinstance(found, Catadioptric) and len(model.mirrors) == 1):
        return found
    mirror, seen = model.mirrors[0].mirror, _distances(found, found.reflection_points(points)[0][:, 0])
    rim = max(mirror.rim, float(seen.max(initial=0.0)) * (1 + 1e-6))
    return _ending(found, rim, min(mirror.hole, float(seen.min(initial=np.inf)) * (1 - 1e-6)))


def _ending(model: Catadioptric, rim: float, hole: float) -> Catadioptric:
    ends = {"mirror_rim": float(rim), "mirror_hole": float(hole)}
    return model.with_params([ends.get(n, float(p)) for n, p in zip(model.param_names, model.params, strict=True)])


def _distances(model: Catadioptric, points: Array) -> Array:
    """Give the distances from the mirror's axis of points (N, 3) of it, in the lens's frame, but those that are NaN."""
    there = model.mirrors[0].lens_from_mirror.inverse() @ points
    rho = np.hypot(there[:, 0], there[:, 1])
    return rho[np.isfinite(rho)]


def placed(model: RayModel, views: Observations) -> State:
    """Pose every board for a camera that is nearly known, as if its rays began where they do in the mean.

    Raises
    ------
    ValueError
        If the camera's rays explain too few of the corners of an image.
    """
    origins, bearings, valid = model.rays(views.pixels)
    if valid.mean() < SHOWN:
        raise ValueError(
            f"{model.name}: the camera to start from shows {valid.mean():.0%} of the corners: its focal length, image"
            " size or the distance of its mirror is not that of these images"
        )
    centre = origins[valid].mean(0)
    rotations, translations = linear_board_poses(views, bearings)
    if not (known := np.isfinite(translations).all(1)).all():
        name = views.names[int(np.argmin(known))]
        raise ValueError(f"{model.name}: the camera to start from has rays for too few corners of {name}; leave it out")
    rotations, translations = refine_board_poses(views, bearings, rotations, translations)
    state = State(cast(CameraModel, model), rotations, translations + centre)
    return refine(state, views, freedom=FreeParameters.none(state.model), iterations=30).state


def idle(model: RayModel) -> tuple[str, ...]:
    """Give what moves a mirror and changes nothing: a sphere turned, as its centre can move, and a plane in itself."""
    if not isinstance(model, Catadioptric):
        return ()
    names = Catadioptric.coefficient_names(len(model.mirrors), "mirrors")
    found: list[str] = []
    for name, placed in zip(names, model.mirrors, strict=True):
        if isinstance(placed.mirror, Conic) and placed.mirror.eccentricity == 0:
            found += [f"{name}_tilt_x", f"{name}_tilt_y"]
        elif isinstance(placed.mirror, Plane):
            found += [f"{name}_tx", f"{name}_ty"]
    return tuple(found)
