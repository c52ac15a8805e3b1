"""Compiled loops of the resection over board points.

Chords are between bearings and the directions of posed points. A pose is an array (3, 4), [R | t]; the point X has the
direction of R X + t.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.optim.levenberg_marquardt import DAMPING_GROWTH, INITIAL_DAMPING, MAX_DAMPING, MIN_DAMPING
from omnisight.optim.tolerances import COARSE_TOLERANCE
from omnisight.twoview._absolute_pose_kernel import derivatives_along, direction
from omnisight.twoview._small_vectors_kernel import copy_elements, dot, rotate_and_translate, times

# Scale of the Geman-McClure weights relative to the median chord: a point this far off has a quarter of the weight.
ROBUST_SCALE = 3.0
# Chord (rad) below which all points have full weight: rounding.
MIN_CHORD_RAD = 1e-9
# Iterations of the refinement while the robust scale is re-estimated once, and with the final scale.
REFINEMENT_ITERATIONS = 3, 5
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@njit_driver
def squared_chords(points, view, rotations, translations, bearings):
    """Return the squared chords (N,) of points posed by their view."""
    squares = np.empty(len(points))
    for n in range(len(points)):
        k, b = view[n], bearings[n]
        p, _ = direction(times(rotations[k], points[n]), translations[k])
        squares[n] = (p[0] - b[0]) ** 2 + (p[1] - b[1]) ** 2 + (p[2] - b[2]) ** 2
    return squares


@njit_driver
def refine_poses(points, bearings, starts, poses, others):
    """Refine poses (V, 3, 4), and replace them by those refined from others if these are better, in place.

    The rows of view k are `starts[k]` to `starts[k + 1]`.
    """
    for k in range(len(poses)):
        x, b = points[starts[k] : starts[k + 1]], bearings[starts[k] : starts[k + 1]]
        if not len(x):
            continue
        _refine(poses[k], x, b)
        _refine(others[k], x, b)
        if _is_better(x, b, others[k], poses[k]):
            copy_elements(poses[k], others[k])


@njit_helper
def _median(values):
    """Return the lower median of values, which are reordered, by Hoare's selection."""
    low, high, wanted = 0, len(values) - 1, (len(values) - 1) // 2
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            break
    return values[wanted]


@njit_helper
def _robust_scale(squares, scratch):
    """Return the squared scale of the Geman-McClure weights of squared chords (N,)."""
    for n in range(len(squares)):
        scratch[n] = squares[n]
    return ROBUST_SCALE**2 * _median(scratch) + MIN_CHORD_RAD**2


@njit_helper
def _is_better(x, b, pose, other):
    """Return whether a pose has a smaller robust cost than another one."""
    squares, others, scratch = np.empty(len(x)), np.empty(len(x)), np.empty(len(x))
    _square_chords(pose, x, b, squares)
    _square_chords(other, x, b, others)
    scale = min(_robust_scale(squares, scratch), _robust_scale(others, scratch))
    difference = 0.0
    for n in range(len(x)):
        difference += squares[n] / (squares[n] + scale) - others[n] / (others[n] + scale)
    return difference < 0.0


@njit_helper
def _square_chords(pose, x, b, squares):
    """Compute the squared chords (N,) between bearings and the directions of posed points."""
    translation = pose[0, 3], pose[1, 3], pose[2, 3]
    for n in range(len(x)):
        p, _ = direction(times(pose, x[n]), translation)
        squares[n] = (p[0] - b[n, 0]) ** 2 + (p[1] - b[n, 1]) ** 2 + (p[2] - b[n, 2]) ** 2


@njit_helper
def _refine(pose, x, b):
    """Minimize the Geman-McClure cost of the chords in place."""
    squares, scratch = np.empty(len(x)), np.empty(len(x))
    for iterations in REFINEMENT_ITERATIONS:
        _square_chords(pose, x, b, squares)
        _minimize(pose, x, b, _robust_scale(squares, scratch), iterations)


@njit_helper
def _minimize(pose, x, b, scale, iterations):
    """Minimize the cost with a constant scale in place, as `gauss_newton_batch` does."""
    hessian, new_hessian, gradient, new_gradient = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6)
    damping, growth, moved = INITIAL_DAMPING, DAMPING_GROWTH, np.empty((3, 4))
    cost, accepted = _linearize(pose, x, b, scale, hessian, gradient), 0
    while accepted < iterations and damping <= MAX_DAMPING:
        step = _step(hessian, gradient, damping)
        predicted = _decrease(hessian, gradient, step)
        if predicted == 0.0 and gradient.any():  # singular
            damping, growth = damping * growth, growth * DAMPING_GROWTH
            continue
        if predicted <= COARSE_TOLERANCE * cost:
            return
        copy_elements(moved, pose)
        rotate_and_translate(moved, step)
        new_cost = _linearize(moved, x, b, scale, new_hessian, new_gradient)
        fall = cost - new_cost
        ratio = fall / predicted
        if not ratio > 0.0:
            damping, growth = damping * growth, growth * DAMPING_GROWTH
            continue
        # The remaining decrease is about what the linearization missed plus what the damping withheld.
        remaining = min(abs(1.0 - ratio), 1.0) * fall
        if remaining <= COARSE_TOLERANCE * new_cost:
            full = _decrease(hessian, gradient, _step(hessian, gradient, 0.0))
            remaining += abs(full - predicted)
        copy_elements(pose, moved)
        if remaining <= COARSE_TOLERANCE * new_cost:
            return
        copy_elements(hessian, new_hessian)
        for i in range(6):
            gradient[i] = new_gradient[i]
        cost, accepted = new_cost, accepted + 1
        damping, growth = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), MIN_DAMPING), DAMPING_GROWTH


@njit_helper
def _linearize(pose, x, b, scale, hessian, gradient):
    """Compute hessian (6, 6), its lower triangle, and gradient (6,) by a step of the pose; return the cost."""
    cost = 0.0
    for i in range(6):
        gradient[i] = 0.0
        for j in range(i + 1):
            hessian[i, j] = 0.0
    translation = pose[0, 3], pose[1, 3], pose[2, 3]
    for n in range(len(x)):
        rotated = times(pose, x[n])
        p, inverse = direction(rotated, translation)
        chord = p[0] - b[n, 0], p[1] - b[n, 1], p[2] - b[n, 2]
        square = dot(chord, chord)
        share = scale / (scale + square)
        cost += 0.5 * share * square
        weight = share * share
        for i in range(3):
            (j0, j1, j2), (j3, j4, j5) = derivatives_along(AXES[i], p, inverse, rotated)
            jacobian = j0, j1, j2, j3, j4, j5
            for r in range(6):
                weighted = weight * jacobian[r]
                gradient[r] += weighted * chord[i]
                for c in range(r + 1):
                    hessian[r, c] += weighted * jacobian[c]
    return cost


@njit_helper
def _step(hessian, gradient, damping):
    """Return the step (6,) for a damping relative to the diagonal; zero where the system is singular."""
    damped, right = np.empty((6, 6)), np.empty(6)
    for i in range(6):
        for j in range(i):
            damped[i, j] = hessian[i, j]
        damped[i, i] = (1.0 + damping + 1e-15) * hessian[i, i] if hessian[i, i] > 0.0 else 1.0
        right[i] = -gradient[i]
    return solve_symmetric(damped, right)


@njit_helper
def _decrease(hessian, gradient, step):
    """Return the decrease of the quadratic model along a step (6,)."""
    total = 0.0
    for r in range(6):
        along = 0.5 * hessian[r, r] * step[r]
        for c in range(r):
            along += hessian[r, c] * step[c]
        total -= (gradient[r] + along) * step[r]
    return total
