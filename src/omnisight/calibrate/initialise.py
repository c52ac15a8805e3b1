"""Finding a camera to start from, with no guess of focal length or field of view and no pinhole plane."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.pose import plane_poses
from omnisight.calibrate.refine import State, refine
from omnisight.calibrate.views import BoardViews
from omnisight.models import CameraModel, model_class

Array = NDArray[np.float64]

# Ideal projections, and the angle from the axis that the farthest corner may be at.
FAMILIES = ("equidistant", "equisolid", "stereographic")
REACH_DEG = (15, 25, 35, 45, 55, 65, 75, 85, 95, 105, 120, 135, 150)
NARROW_DEG = (15, 25, 35, 45, 55, 65)
# Models that together bend to every lens and mirror with few parameters.
SCOUTS = ("kannala_brandt", "unified")
# What a calibration does not estimate unless told to must not come from the start either.
STILL = ("skew",)
SETTLED, SCOUTED = 6, 2
# Pictures that are enough to find the camera; the others are posed from it.
ENOUGH = 40


def initialise(views: BoardViews, size: tuple[int, int]) -> State:
    """Find a camera and board poses near the best, for pictures of plane boards.

    Every ideal projection is tried with every field of view: each poses all boards from bearings, and the few that
    explain the corners best are refined, first as they are, then as models that bend to any lens. The best by robust
    cost is kept.

    Parameters
    ----------
    views
        The corners; boards in their plane z = 0.
    size
        (width, height) of the pictures, px.

    Raises
    ------
    ValueError
        If no start poses the boards.
    """
    if len(views) > ENOUGH:
        few = np.unique(np.linspace(0, len(views) - 1, ENOUGH).round().astype(np.intp))
        return posed(initialise(views.subset(few), size).model, views)
    ranked = sorted(_ideal_starts(views, size), key=lambda start: _score(start, views))
    if not ranked:
        raise ValueError("no camera explains these corners: are they corners of one flat board, in order?")
    settled = [refine(start, views, iterations=8, tolerance=1e-3, loss="squared").state for start in ranked[:SETTLED]]
    best: State | None = None
    for start in sorted(settled, key=lambda state: _score(state, views))[:SCOUTED]:
        for name in SCOUTS:
            scout = restart(start, model_class(name), views)
            if scout is None:
                continue
            scout = refine(scout, views, iterations=25, tolerance=1e-5).state
            scout = refine(repose(scout, views), views, iterations=25, tolerance=1e-5).state
            if best is None or _score(scout, views) < _score(best, views):
                best = scout
    if best is None:
        raise ValueError("no camera explains these corners: are they corners of one flat board, in order?")
    return best


def restart(state: State, cls: type[CameraModel], views: BoardViews) -> State | None:
    """Give the state with another camera model, fitted to the directions of the corners; None where it cannot be."""
    points, _ = state.points(views)
    lengths = state.lengths(views)
    good = lengths <= max(4 * float(np.median(lengths)), 1e-3)
    try:
        model = cls.fit(points[good], views.pixels[good], fixed=STILL)
    except (ValueError, np.linalg.LinAlgError):
        return None
    return State(model, state.rotations, state.translations)


def repose(state: State, views: BoardViews) -> State:
    """Pose every board anew from its bearings, and keep what is better: heals a board stuck behind or turned over."""
    bearings, _ = state.model.unproject_numpy(views.pixels)
    rotations, translations = plane_poses(views, bearings)
    posed = np.isfinite(rotations).all((1, 2))
    rotations[~posed], translations[~posed] = state.rotations[~posed], state.translations[~posed]
    fresh = State(state.model, rotations, translations)
    starts = [g.start for g in views.groups]
    old, new = (np.add.reduceat(np.minimum(s.lengths(views), 50.0), starts) for s in (state, fresh))
    better = new < old
    return State(
        state.model,
        np.where(better[:, None, None], rotations, state.rotations),
        np.where(better[:, None], translations, state.translations),
    )


def _ideal_starts(views: BoardViews, size: tuple[int, int]) -> Iterator[State]:
    centre = (np.array(size, float) - 1) / 2
    reach = np.linalg.norm(views.pixels - centre, axis=1).max()
    for family, degrees in [(f, d) for f in FAMILIES for d in REACH_DEG] + [("pinhole", d) for d in NARROW_DEG]:
        cls = model_class(family)
        theta = np.radians(degrees)
        radius, _ = cls.from_dict({"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}).project_numpy(
            np.array([[np.sin(theta), 0.0, np.cos(theta)]])
        )
        focal = reach / radius[0, 0]
        yield posed(cls.from_dict({"fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1]}), views)


def posed(model: CameraModel, views: BoardViews) -> State:
    """Pose every board from its bearings."""
    bearings, _ = model.unproject_numpy(views.pixels)
    rotations, translations = plane_poses(views, bearings)
    # A board that cannot be posed stands far ahead until the camera is better known.
    lost = ~np.isfinite(rotations).all((1, 2))
    rotations[lost], translations[lost] = np.eye(3), (0.0, 0.0, 1e3)
    return State(model, rotations, translations)


def _score(state: State, views: BoardViews) -> float:
    return float(np.minimum(state.lengths(views), 50.0).mean())
