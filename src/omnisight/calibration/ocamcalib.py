"""Scaramuzza's original calibration method, step by step as published; for comparison."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.models.ocam import Ocam
from omnisight.optim.gauss_newton import gauss_newton
from omnisight.optim.tolerances import FINAL_TOLERANCE
from omnisight.progress import Progress, no_progress
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Corners per image: the linear step has six unknowns up to scale, one equation per corner, and one corner more.
MIN_CORNERS = 6
# Search for the centre as in OCamCalib: a 6x6 grid over half the image, refined nine times.
GRID_SIZE, GRID_ROUNDS = 6, 9
# Alternations between poses and camera, and relative decrease of the rms at which they stop.
MAX_ALTERNATIONS, RMS_TOLERANCE = 100, 1e-6


@dataclass(frozen=True)
class ReprojectionError(Displayed):
    """Root mean square and mean residual length over all corners, px."""

    rms: float
    mean: float

    @classmethod
    def of(cls, state: State, observations: Observations) -> "ReprojectionError":
        """Return the error of a state."""
        lengths = state.lengths(observations)
        return cls(float(np.sqrt((lengths**2).mean())), float(lengths.mean()))


@dataclass(frozen=True)
class OcamCalibResult(Displayed):
    """The result of Scaramuzza's method.

    Attributes
    ----------
    state
        The camera and cam_from_board of every view.
    linear
        Reprojection error after the linear steps about the image centre.
    centred
        Reprojection error after the search for the centre.
    refined
        Reprojection error after the nonlinear refinement.
    """

    state: State
    linear: ReprojectionError
    centred: ReprojectionError
    refined: ReprojectionError

    def errors(self) -> dict[str, dict[str, float]]:
        """Return rms and mean (px) after each step, by its name."""
        return {name: asdict(getattr(self, name)) for name in ("linear", "centred", "refined")}

    @property
    def model(self) -> Ocam:
        """The camera."""
        assert isinstance(self.state.model, Ocam)
        return self.state.model


def calibrate_ocamcalib(
    observations: Observations,
    size: tuple[int, int],
    *,
    degree: int = 4,
    centre: tuple[float, float] | None = None,
    progress: Progress = no_progress,
) -> OcamCalibResult:
    """Calibrate as OCamCalib does: two linear steps, a search for the centre, and an alternating refinement.

    All corners have the same weight, and pixels are square until the refinement.

    Parameters
    ----------
    observations
        Board points, in the plane z = 0, and pixels of every view.
    size
        (width, height) of the images, px.
    degree
        Degree of the polynomial; the default of OCamCalib is 4.
    centre
        (u, v) centre of distortion, px; searched around the image centre if omitted.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If a view has too few corners, or the linear steps fail for every centre.

    Notes
    -----
    Scaramuzza, Martinelli and Siegwart: A flexible technique for accurate omnidirectional camera calibration and
    structure from motion, ICVS 2006 (the linear steps); A toolbox for easily calibrating omnidirectional cameras, IROS
    2006 (centre and refinement). Their camera looks along -z and x is along the rows; here x is right, y down and z
    forward, so the polynomial has the opposite sign.
    """
    if not len(observations):
        raise ValueError("no image with a board to calibrate from")
    if degree < 2:
        raise ValueError(f"the polynomial must be of degree 2 or more, got {degree}")
    for name, rows in zip(observations.names, observations.groups, strict=True):
        if rows.stop - rows.start < MIN_CORNERS:
            raise ValueError(
                f"{name}: {rows.stop - rows.start} corners, but the linear steps need {MIN_CORNERS}: leave it out"
                f" (--drop {name})"
            )
    middle = (np.array(size, float) - 1) / 2
    initial = linear_steps(observations, middle if centre is None else np.array(centre, float), degree)
    centred = search_centre(initial, observations, size, degree, progress) if centre is None else initial
    if centred is None:
        raise ValueError(
            "the linear steps fail for every centre: check that these are corners of one flat board, in order"
        )
    refined = refine_alternating(centred, observations, progress)
    failed = ReprojectionError(np.inf, np.inf)
    return OcamCalibResult(
        refined,
        ReprojectionError.of(initial, observations) if initial else failed,
        ReprojectionError.of(centred, observations),
        ReprojectionError.of(refined, observations),
    )


def linear_steps(observations: Observations, centre: Array, degree: int) -> State | None:
    """Estimate camera and poses for a centre (2,) by the two linear steps; None if they fail."""
    plane = observations.pixels - centre
    columns = extrinsics_up_to_scale(observations, plane)
    a, depths, signs = polynomial_and_depths(observations, plane, columns, degree)
    if not (np.isfinite(a).all() and a[0] > 0):
        return None
    columns[:, 2, :2] *= signs[:, None]
    columns[:, 2, 2] = depths
    r1, r2, t = np.moveaxis(columns, -1, 0)
    rotations = np.stack([r1, r2, np.cross(r1, r2)], -1)
    return State(Ocam(float(centre[0]), float(centre[1]), 1.0, 0.0, 0.0, a=tuple(map(float, a))), rotations, t)


def extrinsics_up_to_scale(observations: Observations, plane: Array) -> Array:
    """Return [r1 r2 t] of every view (V, 3, 3) up to t3 (0 here) and the sign of r31 and r32.

    For a corner (X, Y, 0) at (x, y) from the centre, (x, y, f) is parallel to [r1 r2 t] (X, Y, 1). One of the three
    equations of their cross product does not contain f:

        x (r21 X + r22 Y + t2) - y (r11 X + r12 Y + t1) = 0,

    linear in six unknowns up to scale. r1 and r2 are orthogonal and of equal length, which determines r31 and r32 up
    to a common sign, and the scale (ICVS 2006, solving for the extrinsic parameters).
    """
    columns = np.zeros((len(observations), 3, 3))
    for i, rows in enumerate(observations.groups):
        X, Y = observations.points[rows, :2].T
        x, y = plane[rows].T
        unit = np.hypot(X, Y).max() or 1.0
        one = np.full_like(X, unit)
        design = np.stack([-y * X, -y * Y, -y * one, x * X, x * Y, x * one], -1)
        upper = np.linalg.svd(design, full_matrices=False)[2][-1].reshape(2, 3)
        upper[:, 2] *= unit
        # The sign is positive if corners lie in the direction in which they are observed.
        direction = x * (upper[0] @ (X, Y, np.ones_like(X))) + y * (upper[1] @ (X, Y, np.ones_like(X)))
        upper *= np.sign(direction.sum()) or 1.0
        r31, r32 = third_row(*upper[:, 0], *upper[:, 1])
        scale = np.sqrt(upper[0, 0] ** 2 + upper[1, 0] ** 2 + r31**2) or 1.0
        columns[i, :2], columns[i, 2, :2] = upper / scale, (r31 / scale, r32 / scale)
    return columns


def third_row(r11: float, r21: float, r12: float, r22: float) -> tuple[float, float]:
    """Return (r31, r32), up to a common sign, that make r1 and r2 orthogonal and of equal length.

    r31 r32 = -(r11 r12 + r21 r22) and r32^2 - r31^2 = |r1|^2 - |r2|^2 over the first two rows: a quadratic equation in
    r32^2 with one non-negative root.
    """
    product = -(r11 * r12 + r21 * r22)
    difference = (r11**2 + r21**2) - (r12**2 + r22**2)
    length = np.hypot(difference, 2 * product)
    r31, r32 = np.sqrt((length - difference) / 2), np.sqrt((length + difference) / 2)
    return float(r31), float(np.copysign(r32, product))


def polynomial_and_depths(
    observations: Observations, plane: Array, columns: Array, degree: int
) -> tuple[Array, Array, Array]:
    """Return a0, a2 ... aN of f(r) (degree,), t3 of every view (V,), and the sign (V,) of its r31 and r32.

    The other two equations of the cross product are linear in the remaining unknowns:

        f(r) (r21 X + r22 Y + t2) - t3 y = y (r31 X + r32 Y)
        f(r) (r11 X + r12 Y + t1) - t3 x = x (r31 X + r32 Y)

    (ICVS 2006, solving for the intrinsic parameters). t3 only occurs in the equations of one view and is eliminated
    there. The sign of r31 and r32 is correct if the angle from the axis increases with r, that is f - r f' > 0; it is
    determined first from a parabola for each view, then from the common f.
    """
    radius = np.hypot(*plane.T)
    largest = float(radius.max()) or 1.0
    powers = np.array((0, *range(2, degree + 1)))
    count = len(observations)
    normal, right = np.empty((count, degree, degree)), np.empty((count, degree))
    eliminated: list[tuple[Array, Array, Array]] = []
    signs = np.empty(count)
    for i, rows in enumerate(observations.groups):
        flat = np.concatenate([observations.points[rows, :2], np.ones((rows.stop - rows.start, 1))], -1)
        ahead = flat @ (columns[i, 2] * (1, 1, 0))
        design = np.concatenate([flat @ columns[i, k] for k in (1, 0)])[:, None]
        design = design * np.tile(radius[rows] / largest, 2)[:, None] ** powers
        depth = np.concatenate([plane[rows, 1], plane[rows, 0]]) / largest
        known = np.concatenate([plane[rows, 1] * ahead, plane[rows, 0] * ahead]) / largest
        share = depth / (depth @ depth)  # share @ (...) is the best t3
        eliminated.append((share, design, known))
        rest, target = design - depth[:, None] * (share @ design), known - depth * (share @ known)
        normal[i], right[i] = rest.T @ rest, rest.T @ target
        a0, a2 = np.linalg.lstsq(normal[i, :2, :2], right[i, :2], rcond=None)[0]
        signs[i] = 1.0 if a0 - a2 * np.mean((radius[rows] / largest) ** 2) >= 0 else -1.0
    total = normal.sum(0)
    scaled = np.linalg.lstsq(total, signs @ right, rcond=None)[0]
    for _ in range(count):
        updated = np.where(right @ scaled >= 0, 1.0, -1.0)
        if (updated == signs).all():
            break
        signs = updated
        scaled = np.linalg.lstsq(total, signs @ right, rcond=None)[0]
    parts = zip(eliminated, signs, strict=True)
    depths = np.array([share @ (design @ scaled - sign * known) for (share, design, known), sign in parts])
    return scaled * largest / largest**powers, depths, signs


def search_centre(
    initial: State | None, observations: Observations, size: tuple[int, int], degree: int, progress: Progress
) -> State | None:
    """Return the result of the linear steps for the centre with the least squared residuals (IROS 2006).

    A grid of centres around the image centre is tried, then a smaller one around the best, and so on. `initial` is the
    result for the image centre itself, which is not on the grid.
    """
    best, least = initial, _cost(initial, observations)
    centre, reach = (np.array(size, float) - 1) / 2, np.array(size, float) / 4
    for done in range(GRID_ROUNDS):
        progress("search centre", done, GRID_ROUNDS)
        steps = np.linspace(-1, 1, GRID_SIZE)
        for candidate in centre + reach * np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2):
            state = linear_steps(observations, candidate, degree)
            if (cost := _cost(state, observations)) < least:
                best, least, centre = state, cost, candidate
        reach = reach * 2 / (GRID_SIZE - 1)
    progress("search centre", GRID_ROUNDS, GRID_ROUNDS)
    return best


def _cost(state: State | None, observations: Observations) -> float:
    return np.inf if state is None else float((state.lengths(observations) ** 2).sum())


def refine_alternating(state: State, observations: Observations, progress: Progress) -> State:
    """Minimize the squared residuals alternately over all poses and over the camera, as OCamCalib does (IROS 2006).

    Alternation converges slowly if camera and poses are correlated, and stops slightly above the joint minimum.
    """
    rms = ReprojectionError.of(state, observations).rms
    for round_ in range(MAX_ALTERNATIONS):
        progress("refine", round_, MAX_ALTERNATIONS)
        posed = refine(state, observations, free_parameters=FreeParameters.none(state.model), loss="squared").state
        state = replace(posed, model=fit_camera(posed, observations))
        before, rms = rms, ReprojectionError.of(state, observations).rms
        if before - rms <= RMS_TOLERANCE * before:
            break
    progress("refine", MAX_ALTERNATIONS, MAX_ALTERNATIONS)
    return state


def fit_camera(state: State, observations: Observations) -> Ocam:
    """Return the camera that minimizes the squared residuals for constant poses."""
    points, _ = state.points(observations)
    model = state.model
    valid = model.project_numpy(points)[1]

    def linearize(params: Array) -> tuple[Array, Array]:
        pixels, _, _, d_params = model.with_params(params).project_with_jacobians(points[valid])
        return (pixels - observations.pixels[valid]).ravel(), d_params.reshape(-1, params.size)

    fitted = model.with_params(gauss_newton(linearize, model.params.copy(), tolerance=FINAL_TOLERANCE).state)
    assert isinstance(fitted, Ocam)
    return fitted
