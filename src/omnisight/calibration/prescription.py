"""Cameras whose optical prescription is known: a lens and a mirror as designed, refined where they really stand."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import linear_board_poses, refine_board_poses
from omnisight.calibration.state import State
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.mirrors.plane import Plane
from omnisight.optics.ray_model import RayModel
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Share of the corners for which a prescription must have rays; below, it belongs to another camera.
MIN_VISIBLE_SHARE = 0.8
# Factor by which the mirror is enlarged during the refinement.
APERTURE_MARGIN = 1.25
# Iterations that refine the poses with the camera constant.
POSE_ITERATIONS = 30
# Relative margin of a radius, with which the outermost corner stays visible after rounding.
ROUNDING = 1e-6


def with_wide_aperture(model: RayModel, observations: Observations) -> RayModel:
    """Return a camera of one mirror with a larger rim and no hole, any other camera unchanged.

    If the mirror does not stand exactly as designed, corners near its rim lie beyond the designed rim: they would be
    invisible and could not move the mirror to where they are visible.
    """
    if not isinstance(model, Catadioptric) or len(model.mirrors) != 1:
        return model
    mirror = model.mirrors[0].mirror
    rim = mirror.rim if np.isfinite(mirror.rim) else _radii(model, model.rays(observations.pixels)[0]).max(initial=0.0)
    return _with_aperture(model, APERTURE_MARGIN * rim, 0.0) if rim > 0 else model


def with_designed_aperture(refined: RayModel, design: RayModel, points: Array) -> RayModel:
    """Return the refined camera with rim and hole of the design, as far as points (N, 3) remain visible."""
    if not (isinstance(design, Catadioptric) and isinstance(refined, Catadioptric) and len(design.mirrors) == 1):
        return refined
    mirror, radii = design.mirrors[0].mirror, _radii(refined, refined.reflection_points(points)[0][:, 0])
    rim = max(mirror.rim, float(radii.max(initial=0.0)) * (1 + ROUNDING))
    return _with_aperture(refined, rim, min(mirror.hole, float(radii.min(initial=np.inf)) * (1 - ROUNDING)))


def resect_prescription(model: RayModel, observations: Observations) -> State:
    """Estimate every board pose for a non-central camera, started as if all rays met in their mean origin.

    Raises
    ------
    ValueError
        If the camera has rays for too few corners of all views, or of one view.
    """
    origins, bearings, valid = model.rays(observations.pixels)
    if valid.mean() < MIN_VISIBLE_SHARE:
        raise ValueError(
            f"{model.name}: the given design has rays for {valid.mean():.0%} of the corners: its focal length, image"
            " size or mirror distance does not match these images"
        )
    centre = origins[valid].mean(0)
    rotations, translations = linear_board_poses(observations, bearings)
    if not (posed := np.isfinite(translations).all(1)).all():
        name = observations.names[int(np.argmin(posed))]
        raise ValueError(f"{model.name}: the given design has rays for too few corners of {name}; leave the image out")
    rotations, translations = refine_board_poses(observations, bearings, rotations, translations)
    state = State(model, rotations, translations + centre)
    fixed = FreeParameters.none(model)
    return refine(state, observations, free_parameters=fixed, iterations=POSE_ITERATIONS).state


def unobservable_parameters(model: RayModel) -> tuple[str, ...]:
    """Return the mirror parameters without effect: the rotation of a sphere, and a plane's translation in itself."""
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


def _with_aperture(model: Catadioptric, rim: float, hole: float) -> Catadioptric:
    values = {"mirror_rim": float(rim), "mirror_hole": float(hole)}
    return model.with_params([values.get(n, float(p)) for n, p in zip(model.param_names, model.params, strict=True)])


def _radii(model: Catadioptric, points: Array) -> Array:
    """Return the distances of mirror points (N, 3), in the lens's frame, from the mirror's axis; without NaN."""
    local = model.mirrors[0].lens_from_mirror.inverse() @ points
    radii = np.hypot(local[:, 0], local[:, 1])
    return radii[np.isfinite(radii)]
