"""Choosing the boards that together say most about a camera."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.resection import resect
from omnisight.calibration.state import State
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Boards that a rough camera is made from.
ROUGH = 16
# Share of the image's width by which a board must have moved, at half of its corners, to be another one: what is
# wrong with an image is wrong with one that shows the same, so the two are not two witnesses.
SAME = 0.01
# What is known before the first board, as a share of what all of them say.
BEFORE = 1e-6
# Share by which a board must make the parameters better known, in the mean, to be worth its time; and boards at most.
LEAST_GAIN = 0.012
MOST = 40
# Times the median by which a board may miss the rough camera, and px that it may miss it in any case.
OFF, OFF_PX = 6.0, 1.0
# Share of a board's motion from one image to the next that bends it: what a rolling shutter does to it beyond turning
# and shearing it as another pose would; and how far a corner that stands still is off, px.
BENT, STILL_PX = 0.1, 0.1


def select_informative_frames(views: Observations, size: tuple[int, int], motion: Array) -> list[int]:
    """Choose boards one after another, each the one that adds most to what the others say (a D-optimal design).

    A rough camera tells what each board says about the camera's parameters: with J its corners' Jacobian by these, and
    Q an orthonormal basis of what the board's unknown pose may do, the information is J^T (I - Q Q^T) J. It adds up
    over boards. The board next taken is the one that raises the determinant of the sum most (Fedorov, Theory of optimal
    experiments, 1972; for calibration Richardson, Strom and Olson, AprilCal, IROS 2013, and Rojtberg and Kuijper, ISMAR
    2018, with other criteria).

    Parameters
    ----------
    views
        Boards to choose from, in the order they were seen.
    size
        (width, height) of the images, px.
    motion
        (V,) by how much each board moved since the image before, px.

    Returns
    -------
    list of int
        Which views, the first chosen first; boards that repeat another one, or that no camera explains together with
        the others, are left out.
    """
    apart = _apart(views)
    same = SAME * size[0]
    varied = _varied(apart, same)
    try:
        rough = estimate_initial_camera(views.subset(varied[:ROUGH]), size).model
    except ValueError:  # the calibration will say why
        return varied[:MOST]
    state = refine(resect(rough, views), views, iterations=10, tolerance=1e-4).state
    lengths = state.lengths(views)
    miss = np.array([np.median(lengths[rows]) for rows in views.groups])
    said = _information(state, views) / (1 + (BENT * motion / STILL_PX) ** 2)[:, None, None]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(said.sum(0)), 1e-300))
    said *= scale[:, None] * scale
    left = miss <= max(OFF_PX, OFF * float(np.median(miss)))
    known = BEFORE * np.eye(len(scale))
    chosen: list[int] = []
    while left.any() and len(chosen) < MOST:
        gain = np.where(left, np.linalg.slogdet(known + said)[1], -np.inf) - np.linalg.slogdet(known)[1]
        best = int(gain.argmax())
        if chosen and gain[best] < 2 * len(scale) * LEAST_GAIN:
            break
        chosen.append(best)
        known = known + said[best]
        left &= apart[best] > same
    return chosen


def _information(state: State, views: Observations) -> Array:
    """Give what each board says about the camera's free parameters, its own pose unknown (V, P, P), px^-2."""
    points, turned = state.points(views)
    _, valid, d_point, d_params = state.model.project_with_jacobians(points)
    usable = valid & np.isfinite(d_params).all((1, 2)) & np.isfinite(d_point).all((1, 2))
    # As in a bundle: the pose moves by a turn w and a shift v, x_c = exp(w) R x + t + v.
    d_pose = np.concatenate([np.cross(turned[:, None, :], d_point), d_point], -1)
    free = [parameter.free for parameter in state.model.parameters]
    said: list[Array] = []
    for rows in views.groups:
        good = usable[rows]
        j = d_params[rows][good][..., free].reshape(-1, sum(free))
        q, _ = np.linalg.qr(d_pose[rows][good].reshape(-1, 6))
        j = j - q @ (q.T @ j)
        said.append(j.T @ j)
    return np.array(said)


def _apart(views: Observations) -> Array:
    """Give by how many px boards differ (V, V): the median over the corners that both show; inf if they share none."""
    corners, which = np.unique(views.points.round(9), axis=0, return_inverse=True)
    pixels = np.full((len(views), len(corners), 2), np.nan)
    pixels[views.view_of_row, which.ravel()] = views.pixels
    apart = np.full((len(views), len(views)), np.inf)
    for i in range(len(views)):
        away = np.linalg.norm(pixels - pixels[i], axis=2)
        shared = np.isfinite(away).any(1)
        apart[i, shared] = np.nanmedian(away[shared], axis=1)
    return apart


def _varied(apart: Array, same: float) -> list[int]:
    """Order boards so that each is the one farthest from all before it, as long as there is another one."""
    chosen, nearest = [0], apart[0].copy()
    while nearest.max() > same:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, apart[chosen[-1]])
    return chosen
