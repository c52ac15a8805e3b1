"""Finding a camera to start from, with no guess of focal length or field of view and no pinhole plane."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.pose import plane_poses, settled_poses
from omnisight.calibrate.refine import refine
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.models import CameraModel, model_class

Array = NDArray[np.float64]

# Ideal projections, and the angle from the axis that the farthest corner may be at.
FAMILIES = ("equidistant", "equisolid", "stereographic")
REACH_DEG = (15, 25, 35, 45, 55, 65, 75, 85, 95, 105, 120, 135, 150)
NARROW_DEG = (15, 25, 35, 45, 55, 65)
# Models that together bend to every lens and mirror with few parameters.
SCOUTS = ("kannala_brandt", "unified")
# What a lens has next to nothing of: a start that took it from noise would be a start of its own.
STILL = ("skew", "p1", "p2", "s1", "s2", "s3", "s4")
SETTLED, SCOUTED = 4, 2
# Pictures that are enough to tell a good start from a bad one, and to find the camera; the others are posed from it.
SKETCH, ENOUGH = 10, 40
# Angles from the axis, and around it, at which a camera is sampled.
CONE = 16


def initialise(views: BoardViews, size: tuple[int, int]) -> State:
    """Find a camera and board poses near the best, for pictures of plane boards.

    Every ideal projection is tried with every field of view: each poses some of the boards from bearings, and the few
    that explain the corners best are refined, first as they are, then as models that bend to any lens. The best by
    robust cost is kept.

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
        return posed(initialise(_some(views, ENOUGH), size).model, views)
    sketch = _some(views, SKETCH)
    ranked = sorted(_ideal_starts(sketch, size), key=lambda start: _score(start, sketch))
    settled = [_settled(posed(start.model, sketch), sketch, 8, 1e-3) for start in ranked[:SETTLED]]
    scouts = list[State]()
    names: tuple[str, ...] = SCOUTS
    for start in sorted(settled, key=lambda state: _score(state, sketch))[:SCOUTED]:
        scouts += [scout for name in names if (scout := _scout(start, name, sketch)) is not None]
        if scouts:  # the other bends less well to this lens
            names = (min(scouts, key=lambda state: _score(state, sketch)).model.name,)
    if not scouts:
        raise ValueError("no camera explains these corners: are they corners of one flat board, in order?")
    best = min(scouts, key=lambda state: _score(state, sketch))
    best = _settled(posed(best.model, views), views, 25, 1e-5)
    return _settled(repose(best, views), views, 25, 1e-5)


def _scout(start: State, name: str, views: BoardViews) -> State | None:
    """Refine the start as a model that bends to more lenses, with all boards posed anew on the way."""
    lengths = start.lengths(views)
    good = lengths <= max(4 * float(np.median(lengths)), 1e-3)
    try:
        model = model_class(name).fit(start.points(views)[0][good], views.pixels[good], fixed=STILL)
    except (ValueError, np.linalg.LinAlgError):
        return None
    rough = _settled(replace(start, model=model), views, 15, 1e-4)
    return _settled(repose(rough, views), views, 15, 1e-4)


def restart(state: State, cls: type[CameraModel], views: BoardViews) -> State | None:
    """Give the state with another camera model, fitted to its own; None where it cannot be."""
    try:
        return replace(state, model=cls.fit(*pairs(state, views), fixed=STILL))
    except (ValueError, np.linalg.LinAlgError):
        return None


def pairs(state: State, views: BoardViews) -> tuple[Array, Array]:
    """Give directions (M, 3), the corners' and all others as far from the axis, and their pixels in the state's camera.

    What another camera is fitted to: a rich one fitted to the corners themselves would start from their noise, and
    bend as it likes where there are none.
    """
    points, _ = state.points(views)
    farthest = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]).max(initial=0.0)
    theta, phi = (np.arange(CONE) + 0.5)[:, None] / CONE * farthest, np.linspace(0, 2 * np.pi, CONE, endpoint=False)
    parts = np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    points = np.concatenate([points, np.stack(parts, -1).reshape(-1, 3)])
    pixels, valid = state.model.project_numpy(points)
    return points[valid], pixels[valid]


def repose(state: State, views: BoardViews) -> State:
    """Pose every board anew from its bearings, and keep what is better: heals a board stuck behind or turned over."""
    fresh = posed(state.model, views)
    starts = [g.start for g in views.groups]
    old, new = (np.add.reduceat(np.minimum(s.lengths(views), 50.0), starts) for s in (state, fresh))
    better = new < old
    return replace(
        state,
        rotations=np.where(better[:, None, None], fresh.rotations, state.rotations),
        translations=np.where(better[:, None], fresh.translations, state.translations),
    )


def posed(model: CameraModel, views: BoardViews) -> State:
    """Pose every board from its bearings."""
    bearings, _ = model.unproject_numpy(views.pixels)
    rough = _posed_roughly(model, views)
    return State(model, *settled_poses(views, bearings, rough.rotations, rough.translations))


def _posed_roughly(model: CameraModel, views: BoardViews) -> State:
    bearings, _ = model.unproject_numpy(views.pixels)
    rotations, translations = plane_poses(views, bearings)
    # A board that cannot be posed stands far ahead until the camera is better known.
    lost = ~np.isfinite(rotations).all((1, 2))
    rotations[lost], translations[lost] = np.eye(3), (0.0, 0.0, 1e3)
    return State(model, rotations, translations)


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
        model = cls.from_dict({"fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1]})
        yield _posed_roughly(model, views)


def _settled(state: State, views: BoardViews, iterations: int, tolerance: float) -> State:
    """Refine with the corners counting as they do at the state."""
    spread = Spread.of(state, views)
    return refine(state, views, spread=spread, iterations=iterations, tolerance=tolerance).state


def _some(views: BoardViews, count: int) -> BoardViews:
    """Give that many of the views, or all if there are fewer."""
    if len(views) <= count:
        return views
    return views.subset(np.linspace(0, len(views) - 1, count).round().astype(np.intp))


def _score(state: State, views: BoardViews) -> float:
    return float(np.minimum(state.lengths(views), 50.0).mean())
