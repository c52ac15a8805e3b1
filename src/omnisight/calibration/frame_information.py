"""Selection of the views that together contain most information about a camera (a D-optimal design)."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.resection import resect
from omnisight.calibration.state import State
from omnisight.optim.tolerances import COMPARISON_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Views from which a preliminary camera is estimated.
MAX_PRELIMINARY_VIEWS = 16
# Median displacement of the corners, relative to the image width, below which two views repeat each other: their errors
# are correlated, so they do not count as independent.
MIN_DISPLACEMENT = 0.01
# Prior information relative to that of all views.
PRIOR_INFORMATION = 1e-6
# Mean relative reduction of the parameters' standard deviations that a further view must bring, and number of views.
MIN_GAIN, MAX_SELECTED = 0.012, 40
# Residual of a view, relative to the median and in px, above which the preliminary camera does not fit it.
MAX_RESIDUAL_RATIO, MAX_RESIDUAL_PX = 6.0, 1.0
# Share of a board's motion between frames that a rolling shutter adds to its corners beyond an equivalent pose, and
# standard deviation (px) of a corner without motion.
ROLLING_SHUTTER_SHARE, STATIC_SIGMA_PX = 0.1, 0.1
# Motion between frames, px, that adds as much error as there is without motion.
MOTION_OF_NOISE_PX = STATIC_SIGMA_PX / ROLLING_SHUTTER_SHARE


def select_informative_views(observations: Observations, motion: Array) -> list[int]:
    """Select views one after another, each the one that adds most information to the previous ones.

    With J the Jacobian of a view's corners by the camera parameters, and Q an orthonormal basis of the derivatives by
    its pose, its information is J^T (I - Q Q^T) J. The view that maximizes the determinant of the sum is selected next
    (Fedorov, Theory of optimal experiments, 1972; for calibration Richardson, Strom and Olson, AprilCal, IROS 2013, and
    Rojtberg and Kuijper, ISMAR 2018, with other criteria).

    Parameters
    ----------
    observations
        The views, in temporal order.
    motion
        (V,) displacement of each board since the previous frame, px.

    Returns
    -------
    list of int
        The selected views, the most informative first, without repeated views and views that the preliminary camera
        does not fit.
    """
    displacement, threshold = view_displacements(observations), MIN_DISPLACEMENT * observations.size[0]
    distinct = _distinct_views(displacement, threshold)
    try:
        preliminary = estimate_initial_camera(observations.subset(distinct[:MAX_PRELIMINARY_VIEWS])).central_model
    except ValueError:  # the calibration will report the reason
        return distinct[:MAX_SELECTED]
    state = refine(resect(preliminary, observations), observations, iterations=10, tolerance=COMPARISON_TOLERANCE).state
    lengths = state.lengths(observations)
    residual = np.array([np.median(lengths[rows]) for rows in observations.groups])
    information = view_information(state, observations)
    information /= (1 + (motion / MOTION_OF_NOISE_PX) ** 2)[:, None, None]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(information.sum(0)), 1e-300))
    information *= scale[:, None] * scale
    available = residual <= max(MAX_RESIDUAL_PX, MAX_RESIDUAL_RATIO * float(np.median(residual)))
    total, selected = PRIOR_INFORMATION * np.eye(len(scale)), list[int]()
    while available.any() and len(selected) < MAX_SELECTED:
        gain = np.where(available, np.linalg.slogdet(total + information)[1], -np.inf) - np.linalg.slogdet(total)[1]
        best = int(gain.argmax())
        if selected and gain[best] < sufficient_gain(len(scale)):
            break
        selected.append(best)
        total = total + information[best]
        available &= displacement[best] > threshold
    return selected


def sufficient_gain(parameters: int) -> float:
    """Return the least increase of the logarithm of the determinant of the information by an informative view."""
    return 2 * parameters * MIN_GAIN


def view_information(state: State, observations: Observations) -> Array:
    """Return the information of each view about the free camera parameters, its pose eliminated (V, P, P), px^-2."""
    points, rotated = state.points(observations)
    _, valid, d_point, d_params = state.model.project_with_jacobians(points)
    usable = valid & np.isfinite(d_params).all((1, 2)) & np.isfinite(d_point).all((1, 2))
    # As in the bundle adjustment: x_c = exp(w) R x + t + v with a rotation w and a translation v.
    d_pose = np.concatenate([np.cross(rotated[:, None, :], d_point), d_point], -1)
    free = [parameter.free for parameter in state.model.parameters]
    information: list[Array] = []
    for rows in observations.groups:
        good = usable[rows]
        j = d_params[rows][good][..., free].reshape(-1, sum(free))
        q, _ = np.linalg.qr(d_pose[rows][good].reshape(-1, 6))
        j = j - q @ (q.T @ j)
        information.append(j.T @ j)
    return np.array(information)


def view_displacements(observations: Observations) -> Array:
    """Return the median displacement (V, V), px, of the corners that two views share; inf if they share none."""
    corners, index = np.unique(observations.points.round(9), axis=0, return_inverse=True)
    pixels = np.full((len(observations), len(corners), 2), np.nan)
    pixels[observations.view_of_row, index.ravel()] = observations.pixels
    displacement = np.full((len(observations), len(observations)), np.inf)
    for i in range(len(observations)):
        distance = np.linalg.norm(pixels - pixels[i], axis=2)
        shared = np.isfinite(distance).any(1)
        displacement[i, shared] = np.nanmedian(distance[shared], axis=1)
    return displacement


def _distinct_views(displacement: Array, threshold: float) -> list[int]:
    """Return views in an order in which each is the farthest from all previous ones, without repeated ones."""
    selected, nearest = [0], displacement[0].copy()
    while nearest.max() > threshold:
        selected.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, displacement[selected[-1]])
    return selected
