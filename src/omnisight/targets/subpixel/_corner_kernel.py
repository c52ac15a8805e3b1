"""Compiled part of `corner_fit`: one nonlinear least-squares fit of nine parameters per corner."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper
from omnisight.targets.subpixel._corner_model import (
    AMPLITUDE,
    ANGLE_0,
    ANGLE_1,
    LOG_BLUR,
    NUM_PARAMETERS,
    U,
    V,
    edge_geometry,
    evaluate,
    initialize_light,
)

# Half the side, px, of the largest window that is collected.
MAX_REACH_PX = 15
MAX_SIDE_PX = 2 * MAX_REACH_PX + 1
# Pixels of a window below which nine parameters are not estimated.
MIN_PIXELS = 20
# Part of a window that must lie in the image: less no longer separates the corner from the light.
MIN_WINDOW_SHARE = 0.6
# Iteration after which the fit must explain half of the variance, as every corner does: what does not is no corner.
EARLY_CHECK, EARLY_EXPLAINED = 4, 0.5
# Largest step of an edge's direction (rad), of the logarithm of the blur and of the corner (px) per iteration.
MAX_ANGLE_STEP, MAX_LOG_BLUR_STEP, MAX_CORNER_STEP = 0.2, 0.4, 1.0
# Movement of the corner, px, up to which the window stays as it is.
MAX_WINDOW_OFFSET = 0.25
# Side, px, of the blocks of pixels that are taken to share their noise.
BLOCK_PX = 4
BLOCKS = MAX_SIDE_PX // BLOCK_PX + 1


class Window(NamedTuple):
    """Gray levels of a window and where they are, relative to the reference pixel."""

    values: Any
    x: Any
    y: Any


class Workspace(NamedTuple):
    """Arrays that all corners share: (9,) and (9, 9), of which the lower half is used."""

    normal: Any
    gradient: Any
    trial_normal: Any
    trial_gradient: Any
    factor: Any
    step: Any
    theta: Any
    trial: Any
    row: Any
    solved: Any
    pulls: Any
    shares: Any


def new_window() -> Window:
    """Return the memory of a window."""
    return Window(*np.empty((3, MAX_SIDE_PX**2)))


def new_workspace() -> Workspace:
    """Return the memory that all corners share."""
    n, blocks = NUM_PARAMETERS, BLOCKS * BLOCKS
    matrix, vector = partial(np.empty, (n, n)), partial(np.empty, n)
    work = Workspace(*(matrix() if k in (0, 2, 4) else vector() for k in range(len(Workspace._fields))))
    return work._replace(pulls=np.empty((blocks, 2)), shares=np.empty((blocks, 2, n)))


# Memory and arrays come from Python: their allocation takes numba 1 s to compile, and reference counts take another.
@partial(njit_driver, **STREAMLINED)
def fit_corners(gray, pixels, steps, bends, shares, usable, limits, window, work, fits, power):
    """Fit the usable corners.

    Parameters
    ----------
    gray
        (H, W) image of uint8.
    pixels
        (N, 2) starts.
    steps
        (N, 2, 2) sides of the windows, px.
    bends
        (N, 2) curvatures of both edges, 1/px.
    shares
        (N, 2) halves of the windows' sides over `steps`.
    usable
        (N,) of bool.
    limits
        The step, px and rad, that ends a fit; whether the fit is only a test, without noise statistics; the largest
        number of iterations; the smallest variance of a window; the smallest and largest blur, px; the variance of
        rounding; the width, px, of the image's border in which nothing is measured.
    window, work
        Memory: `new_window`, `new_workspace`.
    fits
        The arrays of `PointFits`, to be filled.
    power
        (2,) observed and expected power of the noise, to which `_add_block_noise` adds.
    """
    for k in range(len(pixels)):
        if usable[k]:
            _fit_corner(k, gray, pixels[k], steps[k], bends[k], shares[k], limits, window, work, fits, power)


@njit_helper
def _fit_corner(k, gray, start, steps, bend, share, limits, window, work, fits, power):
    """Fit a corner, in a window that follows it once, and write it into row `k` of `fits` if it is one."""
    _, rough, _, min_variance, _, _, rounding_variance, border = limits
    theta = work.theta
    u0, v0 = round(start[0]), round(start[1])
    theta[ANGLE_0] = math.atan2(steps[0, 1], steps[0, 0])
    theta[ANGLE_1] = math.atan2(steps[1, 1], steps[1, 0])
    theta[LOG_BLUR] = 0.0
    theta[U], theta[V] = start[0] - u0, start[1] - v0
    cost, variation, count = np.inf, 1.0, 0
    for _attempt in range(2):
        u, v = theta[U], theta[V]
        count = _collect(gray, u0, v0, u, v, steps, share, window)
        if count < MIN_PIXELS:
            return
        variation = initialize_light(theta, bend, window, count)
        if variation < min_variance * count:
            return
        cost = _gauss_newton(bend, window, count, variation, limits, work)
        if cost == np.inf:
            return
        if max(abs(theta[U] - u), abs(theta[V] - v)) < MAX_WINDOW_OFFSET:
            break
    if not np.isfinite(cost) or not _is_inside(gray, u0, v0, start, steps, share, count, theta, border):
        return
    if not _solve(work.normal, work.gradient, 1e-9, work.factor, work.step):
        return
    noise = max(cost / (count - NUM_PARAMETERS), rounding_variance)
    _write(k, fits, u0, v0, theta, work.factor, noise, 1 - cost / variation)
    if not rough:
        _add_block_noise(bend, window, count, noise, work, power)


@njit_helper
def _gauss_newton(bend, window, count, variation, limits, work):
    """Minimize the squared residuals over `work.theta` by damped Gauss-Newton; return them, inf if there is no corner.

    `work.normal` and `work.gradient` are left as of the last step that was accepted.
    """
    tolerance, _, max_iterations, _, min_blur, max_blur, _, _ = limits
    theta, trial, step = work.theta, work.trial, work.step
    cost, damping = np.inf, 1e-3
    for i in range(NUM_PARAMETERS):
        trial[i] = theta[i]
    for iteration in range(max_iterations):
        trial_cost = _linearize(trial, bend, window, count, work)
        accepted = trial_cost <= cost
        if accepted:
            cost = trial_cost
            _accept(work)
        damping *= 0.1 if accepted else 20.0
        if iteration == EARLY_CHECK and cost > EARLY_EXPLAINED * variation:
            return np.inf
        if damping > 1e6 or not _solve(work.normal, work.gradient, damping, work.factor, step):
            break
        scale = _step_scale(step)
        for i in range(NUM_PARAMETERS):
            trial[i] = theta[i] + scale * step[i]
        trial[LOG_BLUR] = min(max(trial[LOG_BLUR], math.log(min_blur)), math.log(max_blur))
        if accepted and scale == 1.0 and _is_short(step, tolerance):
            for i in range(NUM_PARAMETERS):
                theta[i] = trial[i]  # so short a step needs no evaluation
            break
    return cost


@njit_helper
def _accept(work):
    """Copy the trial, in loops: an assignment of arrays takes numba seconds to compile."""
    for i in range(NUM_PARAMETERS):
        work.theta[i] = work.trial[i]
        work.gradient[i] = work.trial_gradient[i]
        for j in range(NUM_PARAMETERS):
            work.normal[i, j] = work.trial_normal[i, j]


@njit_helper
def _step_scale(step):
    """Return the factor, at most 1, that keeps a step within the limits."""
    angle = MAX_ANGLE_STEP / max(abs(step[ANGLE_0]), abs(step[ANGLE_1]), 1e-12)
    blur = MAX_LOG_BLUR_STEP / max(abs(step[LOG_BLUR]), 1e-12)
    corner = MAX_CORNER_STEP / max(abs(step[U]), abs(step[V]), 1e-12)
    return min(1.0, angle, blur, corner)


@njit_helper
def _is_short(step, tolerance):
    """Return whether a step ends the fit; the blur need not be as exact as the corner."""
    corner = max(abs(step[ANGLE_0]), abs(step[ANGLE_1]), abs(step[U]), abs(step[V]))
    return corner < tolerance and abs(step[LOG_BLUR]) < 4 * tolerance


@njit_helper
def _is_inside(gray, u0, v0, start, steps, share, count, theta, border):
    """Return whether a corner is near its start, and its window far enough inside the image."""
    u, v = u0 + theta[U], v0 + theta[V]
    half_side = 0.0
    for i in range(2):
        half_side = max(half_side, share[i] * math.hypot(steps[i, 0], steps[i, 1]))
    rim = min(u, v, gray.shape[1] - 1 - u, gray.shape[0] - 1 - v)
    determinant = steps[0, 0] * steps[1, 1] - steps[0, 1] * steps[1, 0]
    full_count = 4 * share[0] * share[1] * abs(determinant)
    if rim < border or (rim < half_side and count < MIN_WINDOW_SHARE * full_count):
        return False
    return math.hypot(u - start[0], v - start[1]) <= 0.6 * half_side + 1


@njit_helper
def _write(k, fits, u0, v0, theta, factor, noise, explained):
    """Write a fit into row `k`; the covariance is noise (L L^T)^-1 of the Cholesky factor's last 2x2 block L."""
    pixels, covariance, amplitude, blur, explained_shares = fits
    a, b, c = factor[U, U], factor[V, U], factor[V, V]
    pixels[k, 0], pixels[k, 1] = u0 + theta[U], v0 + theta[V]
    covariance[k, 0, 0] = noise * (1 / (a * a) + (b * b) / (a * a * c * c))
    covariance[k, 0, 1] = covariance[k, 1, 0] = -noise * b / (a * c * c)
    covariance[k, 1, 1] = noise / (c * c)
    # The quadrant ahead, between both steps, is on opposite sides of the two edges.
    amplitude[k], blur[k] = -theta[AMPLITUDE], math.exp(theta[LOG_BLUR])
    explained_shares[k] = explained


@njit_helper
def _collect(gray, u0, v0, u, v, steps, share, window):
    """Collect the pixels of the parallelogram of both steps around the corner; return their number."""
    a, b, c, d = steps[0, 0], steps[1, 0], steps[0, 1], steps[1, 1]
    determinant = a * d - b * c
    reach_u = abs(a) * share[0] + abs(b) * share[1]
    reach_v = abs(c) * share[0] + abs(d) * share[1]
    low_u, low_v = max(math.ceil(u - reach_u), -MAX_REACH_PX, -u0), max(math.ceil(v - reach_v), -MAX_REACH_PX, -v0)
    high_u = min(math.floor(u + reach_u), MAX_REACH_PX, gray.shape[1] - 1 - u0)
    high_v = min(math.floor(v + reach_v), MAX_REACH_PX, gray.shape[0] - 1 - v0)
    count = 0
    for y in range(low_v, high_v + 1):
        for x in range(low_u, high_u + 1):
            p = (d * (x - u) - b * (y - v)) / determinant
            q = (a * (y - v) - c * (x - u)) / determinant
            if abs(p) <= share[0] and abs(q) <= share[1]:
                window.values[count], window.x[count], window.y[count] = gray[v0 + y, u0 + x], x, y
                count += 1
    return count


@njit_helper
def _linearize(theta, bend, window, count, work):
    """Set the normal matrix J^T J and the gradient J^T r of the trial; return the sum of squared residuals r."""
    normal, gradient, row = work.trial_normal, work.trial_gradient, work.row
    normal[:] = 0.0
    gradient[:] = 0.0
    edges = edge_geometry(theta)
    cost = 0.0
    for i in range(count):
        model = evaluate(window.x[i] - theta[U], window.y[i] - theta[V], theta, edges, bend, row)
        residual = window.values[i] - model
        cost += residual * residual
        for j in range(NUM_PARAMETERS):
            gradient[j] += row[j] * residual
            for k in range(j + 1):
                normal[j, k] += row[j] * row[k]
    return cost


@njit_helper
def _solve(normal, gradient, damping, factor, step):
    """Solve (normal + damping diag(normal)) step = gradient by Cholesky; return whether the matrix is definite."""
    n = NUM_PARAMETERS
    for j in range(n):
        for k in range(j + 1):
            total = normal[j, k]
            if j == k:
                total = total * (1 + damping) + 1e-9
            for i in range(k):
                total -= factor[j, i] * factor[k, i]
            if j == k:
                if total <= 1e-12 * normal[j, j]:
                    return False
                factor[j, j] = math.sqrt(total)
            else:
                factor[j, k] = total / factor[k, k]
    _forward_substitute(factor, gradient, step)
    for j in range(n - 1, -1, -1):
        total = step[j]
        for k in range(j + 1, n):
            total -= factor[k, j] * step[k]
        step[j] = total / factor[j, j]
    return True


@njit_helper
def _forward_substitute(factor, right, solution):
    """Solve L solution = right for the lower triangle L of a factor."""
    for j in range(NUM_PARAMETERS):
        total = right[j]
        for k in range(j):
            total -= factor[j, k] * solution[k]
        solution[j] = total / factor[j, j]


@njit_helper
def _add_block_noise(bend, window, count, noise, work, power):
    """Add the observed power of the noise in blocks of pixels to power[0], and that of independent noise to power[1].

    Residuals of neighbouring pixels that agree pull the corner together. With J the Jacobian, r the residuals and B a
    block, the pull is J_B^T r_B. If noise is independent between pixels, the expectation of its square is
    noise (J_B^T J_B - J_B^T J (J^T J)^-1 J^T J_B): the fit has taken its share.
    """
    theta, pulls, shares, row, solved = work.theta, work.pulls, work.shares, work.row, work.solved
    pulls[:] = 0.0
    shares[:] = 0.0
    edges = edge_geometry(theta)
    for n in range(count):
        model = evaluate(window.x[n] - theta[U], window.y[n] - theta[V], theta, edges, bend, row)
        residual = window.values[n] - model
        block = int(window.y[n] + MAX_REACH_PX) // BLOCK_PX * BLOCKS + int(window.x[n] + MAX_REACH_PX) // BLOCK_PX
        for i in range(2):
            pulls[block, i] += row[U + i] * residual
            for j in range(NUM_PARAMETERS):
                shares[block, i, j] += row[U + i] * row[j]
    for block in range(BLOCKS * BLOCKS):
        for i in range(2):
            expected = shares[block, i, U + i]
            if expected == 0.0:
                continue
            _forward_substitute(work.factor, shares[block, i], solved)
            for j in range(NUM_PARAMETERS):
                expected -= solved[j] * solved[j]
            power[0] += pulls[block, i] * pulls[block, i]
            power[1] += noise * expected
