"""Scaramuzza's own way of calibrating, step by step as published: a method to compare with, not the one we use."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.state import State
from omnisight.models.ocam import Ocam
from omnisight.optim.gauss_newton import gauss_newton
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

FEWEST_CORNERS = 6  # six unknowns up to scale, one equation a corner; one to spare
# The search for the centre as OCamCalib makes it: 6 x 6 places over half the image, nine times ever closer.
PLACES = 6
ROUNDS = 9
ALTERNATIONS = 100
SETTLED = 1e-6  # share of the rms by which a round of the refinement must still lower it


@dataclass(frozen=True)
class Reprojection:
    """Length of the residuals after a step: root mean square and mean over all corners, px."""

    rms: float
    mean: float

    @classmethod
    def of(cls, state: State, views: Observations) -> "Reprojection":
        """Measure it."""
        lengths = state.lengths(views)
        return cls(float(np.sqrt((lengths**2).mean())), float(lengths.mean()))


@dataclass(frozen=True)
class OcamCalibResult:
    """What Scaramuzza's method finds.

    Attributes
    ----------
    state
        The camera and cam_from_board of every image.
    linear
        Reprojection after the linear steps about the first centre.
    centred
        The same about the centre that the search found.
    refined
        The same after the refinement: what the method reaches.
    """

    state: State
    linear: Reprojection
    centred: Reprojection
    refined: Reprojection

    def errors(self) -> dict[str, dict[str, float]]:
        """Return rms and mean (px) after each step, by its name."""
        return {name: asdict(getattr(self, name)) for name in ("linear", "centred", "refined")}

    @property
    def model(self) -> Ocam:
        """The camera."""
        assert isinstance(self.state.model, Ocam)
        return self.state.model


def calibrate_ocamcalib(
    views: Observations,
    size: tuple[int, int],
    *,
    degree: int = 4,
    centre: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> OcamCalibResult:
    """Calibrate as OCamCalib does: two linear steps, a search for the centre, and a refinement by turns.

    All corners count alike, and the pixels are taken to be square until the refinement.

    Parameters
    ----------
    views
        The corners of every image, of all or part of the board; boards in their plane z = 0.
    size
        (width, height) of the images, px.
    degree
        Of the polynomial; OCamCalib takes 4 unless told otherwise.
    centre
        (u, v) of the distortion, px, if it is known; else it is searched for from the image's middle.
    progress
        Called with a stage, how much of it is done, and how much there is.

    Raises
    ------
    ValueError
        If an image has too few corners, or the linear steps give no camera.

    Notes
    -----
    Scaramuzza, Martinelli and Siegwart: A flexible technique for accurate omnidirectional camera calibration and
    structure from motion, ICVS 2006 (the linear steps); A toolbox for easily calibrating omnidirectional cameras, IROS
    2006 (centre and refinement). Their camera looks along -z, with x along the rows; here x is right, y down, z
    forward, so that the polynomial has the other sign.
    """
    if not len(views):
        raise ValueError("no image with a board to calibrate from")
    if degree < 2:
        raise ValueError(f"the polynomial must be of degree 2 or more, got {degree}")
    for name, rows in zip(views.names, views.groups, strict=True):
        if rows.stop - rows.start < FEWEST_CORNERS:
            raise ValueError(
                f"{name}: {rows.stop - rows.start} corners, the linear steps need {FEWEST_CORNERS}: leave it out"
                f" (--drop {name})"
            )
    report = progress or (lambda stage, done, total: None)
    middle = (np.array(size, float) - 1) / 2
    begun = linear_steps(views, middle if centre is None else np.array(centre, float), degree)
    found = search_centre(begun, views, size, degree, report) if centre is None else begun
    if found is None:
        raise ValueError("no centre gives a camera: are these corners of one flat board, in order?")
    refined = refine_by_turns(found, views, report)
    nothing = Reprojection(np.inf, np.inf)
    return OcamCalibResult(
        refined,
        Reprojection.of(begun, views) if begun else nothing,
        Reprojection.of(found, views),
        Reprojection.of(refined, views),
    )


def linear_steps(views: Observations, centre: Array, degree: int) -> State | None:
    """Give camera and poses about a centre (2,), by the two linear steps; None where they give no camera."""
    plane = views.pixels - centre
    columns = extrinsics_up_to_scale(views, plane)
    a, depths, signs = polynomial_and_depths(views, plane, columns, degree)
    if not (np.isfinite(a).all() and a[0] > 0):
        return None
    columns[:, 2, :2] *= signs[:, None]
    columns[:, 2, 2] = depths
    r1, r2, t = np.moveaxis(columns, -1, 0)
    rotations = np.stack([r1, r2, np.cross(r1, r2)], -1)
    return State(Ocam(float(centre[0]), float(centre[1]), 1.0, 0.0, 0.0, a=tuple(map(float, a))), rotations, t)


def extrinsics_up_to_scale(views: Observations, plane: Array) -> Array:
    """Give [r1 r2 t] of every image (V, 3, 3) but for t3 (nought here) and the sign of r31 and r32.

    A corner (X, Y, 0) seen at (x, y) from the centre has (x, y, f) along [r1 r2 t] (X, Y, 1), and of the three
    equations of that cross product one holds no f:

        x (r21 X + r22 Y + t2) - y (r11 X + r12 Y + t1) = 0,

    linear in six unknowns up to scale. r1 and r2 are of one length and at right angles, which gives r31 and r32 up to
    a common sign, and the scale (ICVS 2006, solving for the extrinsic parameters).
    """
    columns = np.zeros((len(views), 3, 3))
    for i, rows in enumerate(views.groups):
        X, Y = views.points[rows, :2].T
        x, y = plane[rows].T
        unit = np.hypot(X, Y).max() or 1.0
        one = np.full_like(X, unit)
        design = np.stack([-y * X, -y * Y, -y * one, x * X, x * Y, x * one], -1)
        upper = np.linalg.svd(design, full_matrices=False)[2][-1].reshape(2, 3)
        upper[:, 2] *= unit
        # A corner is seen towards where it is: the sign of the whole.
        seen = x * (upper[0] @ (X, Y, np.ones_like(X))) + y * (upper[1] @ (X, Y, np.ones_like(X)))
        upper *= np.sign(seen.sum()) or 1.0
        r31, r32 = third_row(*upper[:, 0], *upper[:, 1])
        scale = np.sqrt(upper[0, 0] ** 2 + upper[1, 0] ** 2 + r31**2) or 1.0
        columns[i, :2], columns[i, 2, :2] = upper / scale, (r31 / scale, r32 / scale)
    return columns


def third_row(r11: float, r21: float, r12: float, r22: float) -> tuple[float, float]:
    """Give (r31, r32), up to a common sign, that make r1 and r2 equally long and orthogonal.

    r31 r32 = -(r11 r12 + r21 r22) and r32^2 - r31^2 = |r1|^2 - |r2|^2 over the first two rows: a quadratic equation in
    r32^2 with one root that is not negative.
    """
    product = -(r11 * r12 + r21 * r22)
    difference = (r11**2 + r21**2) - (r12**2 + r22**2)
    length = np.hypot(difference, 2 * product)
    r31, r32 = np.sqrt((length - difference) / 2), np.sqrt((length + difference) / 2)
    return float(r31), float(np.copysign(r32, product))


def polynomial_and_depths(views: Observations, plane: Array, columns: Array, degree: int) -> tuple[Array, Array, Array]:
    """Give a0, a2 ... aN of f(r) (degree,), t3 of every image (V,), and the sign (V,) of its r31 and r32.

    The other two equations of the cross product are linear in what is left:

        f(r) (r21 X + r22 Y + t2) - t3 y = y (r31 X + r32 Y)
        f(r) (r11 X + r12 Y + t1) - t3 x = x (r31 X + r32 Y)

    (ICVS 2006, solving for the intrinsic parameters). t3 is in one image's equations only, and is eliminated there.
    The other sign of r31 and r32 turns the right side round, and so f: the sign is right if the angle from the axis
    grows with r, which is f - r f' > 0, first by a parabola through each image alone, then by the f of all.
    """
    radius = np.hypot(*plane.T)
    largest = float(radius.max()) or 1.0
    powers = np.array((0, *range(2, degree + 1)))
    count = len(views)
    normal, right = np.empty((count, degree, degree)), np.empty((count, degree))
    left_out: list[tuple[Array, Array, Array]] = []
    signs = np.empty(count)
    for i, rows in enumerate(views.groups):
        flat = np.concatenate([views.points[rows, :2], np.ones((rows.stop - rows.start, 1))], -1)
        ahead = flat @ (columns[i, 2] * (1, 1, 0))
        design = np.concatenate([flat @ columns[i, k] for k in (1, 0)])[:, None]
        design = design * np.tile(radius[rows] / largest, 2)[:, None] ** powers
        depth = np.concatenate([plane[rows, 1], plane[rows, 0]]) / largest
        known = np.concatenate([plane[rows, 1] * ahead, plane[rows, 0] * ahead]) / largest
        share = depth / (depth @ depth)  # share @ (...) is the t3 that fits best
        left_out.append((share, design, known))
        rest, target = design - depth[:, None] * (share @ design), known - depth * (share @ known)
        normal[i], right[i] = rest.T @ rest, rest.T @ target
        a0, a2 = np.linalg.lstsq(normal[i, :2, :2], right[i, :2], rcond=None)[0]
        signs[i] = 1.0 if a0 - a2 * np.mean((radius[rows] / largest) ** 2) >= 0 else -1.0
    total = normal.sum(0)
    scaled = np.linalg.lstsq(total, signs @ right, rcond=None)[0]
    for _ in range(count):
        turned = np.where(right @ scaled >= 0, 1.0, -1.0)
        if (turned == signs).all():
            break
        signs = turned
        scaled = np.linalg.lstsq(total, signs @ right, rcond=None)[0]
    parts = zip(left_out, signs, strict=True)
    depths = np.array([share @ (design @ scaled - sign * known) for (share, design, known), sign in parts])
    return scaled * largest / largest**powers, depths, signs


def search_centre(
    begun: State | None, views: Observations, size: tuple[int, int], degree: int, report: Progress
) -> State | None:
    """Give the linear steps' camera about the centre with the least sum of squared residuals (IROS 2006).

    A grid of places around the image's middle is tried, then a smaller one about the best so far, and so on. It
    begins with the camera about the middle itself, `begun`, which is no place of the grid.
    """
    best, least = begun, _cost(begun, views)
    centre, reach = (np.array(size, float) - 1) / 2, np.array(size, float) / 4
    for done in range(ROUNDS):
        report("search centre", done, ROUNDS)
        steps = np.linspace(-1, 1, PLACES)
        for place in centre + reach * np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2):
            state = linear_steps(views, place, degree)
            if (cost := _cost(state, views)) < least:
                best, least, centre = state, cost, place
        reach = reach * 2 / (PLACES - 1)
    report("search centre", ROUNDS, ROUNDS)
    return best


def _cost(state: State | None, views: Observations) -> float:
    return np.inf if state is None else float((state.lengths(views) ** 2).sum())


def refine_by_turns(state: State, views: Observations, report: Progress) -> State:
    """Lower the sum of squared residuals by turns: every board's pose, then the camera (IROS 2006).

    The pixels' stretch moves with the camera. By turns is how OCamCalib does it; it is slow where camera and poses hang
    together, and stops a little above the least that moving them at once would find.
    """
    rms = Reprojection.of(state, views).rms
    for turn in range(ALTERNATIONS):
        report("refine by turns", turn, ALTERNATIONS)
        posed = refine(state, views, free_parameters=FreeParameters.none(state.model), loss="squared").state
        state = replace(posed, model=camera_of(posed, views))
        before, rms = rms, Reprojection.of(state, views).rms
        if before - rms <= SETTLED * before:
            break
    report("refine by turns", ALTERNATIONS, ALTERNATIONS)
    return state


def camera_of(state: State, views: Observations) -> Ocam:
    """Give the camera with the least squared residuals while the boards stand still."""
    points, _ = state.points(views)
    model = state.model
    shown = model.project_numpy(points)[1]  # what lies outside the domain cannot tell how it should move

    def linearize(params: Array) -> tuple[Array, Array]:
        pixels, _, _, d_params = model.with_params(params).project_with_jacobians(points[shown])
        return (pixels - views.pixels[shown]).ravel(), d_params.reshape(-1, params.size)

    found = model.with_params(gauss_newton(linearize, model.params.copy(), tolerance=1e-8).state)
    assert isinstance(found, Ocam)
    return found
