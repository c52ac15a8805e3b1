"""The compiled part of `crossing`: one small least-squares problem per corner.

Unknowns, in this order: light (level, slope along u and v), amplitude, directions of both edges, logarithm of the
blur, and the corner (u, v) relative to a whole pixel. The corner comes last, so that its covariance is read off the
last rows of the normal matrix's Cholesky factor.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

import numpy as np

from omnisight.compiled import inner, outer

FIGURES = 8
"""u, v, the covariance's three entries, amplitude, blur, explained share."""

_REACH = 15
_SIDE = 2 * _REACH + 1
_ROUNDS = 12
_TRIAL, _HOPELESS = 4, 0.5  # after so many rounds, what is left of the variation says that no edges cross here
_LEAST_SAMPLES = 20
_FEATURELESS = 4.0  # variance in a window, gray levels squared, below which there is nothing to fit
_LEAST_WINDOW = 0.6  # part of the window that must lie in the image
_RIM = 1.5  # px from the image's edge within which nothing is measured
_BLUR = (math.log(0.3), math.log(8.0))
_BLOCK = 4  # px: pixels this near share their noise, if they do
_BLOCKS = _SIDE // _BLOCK + 1
_ROUNDING = 1 / 12  # variance of a gray level rounded to a whole one


@outer
def fit(gray, pixels, steps, bend, share, usable, settled, rough, figures):
    """Fit the usable corners into `figures` (N, FIGURES); give what `_told_apart` adds up, zero if `rough`.

    The fit ends with a step below `settled` px and radians.
    """
    values = np.empty(_SIDE * _SIDE)
    xs = np.empty(_SIDE * _SIDE)
    ys = np.empty(_SIDE * _SIDE)
    pulls = np.empty((_BLOCKS * _BLOCKS, 2))
    shares = np.empty((_BLOCKS * _BLOCKS, 2, 9))
    normal = np.empty(81)  # (9, 9), its lower half
    factor = np.empty(81)
    gradient = np.empty(9)
    step = np.empty(9)
    theta = np.empty(9)
    best = np.empty(9)
    power = np.zeros(2)
    for k in range(len(pixels)):
        if not usable[k]:
            continue
        u0, v0 = round(pixels[k, 0]), round(pixels[k, 1])
        theta[4] = math.atan2(steps[k, 0, 1], steps[k, 0, 0])
        theta[5] = math.atan2(steps[k, 1, 1], steps[k, 1, 0])
        theta[6] = 0.0
        theta[7], theta[8] = pixels[k, 0] - u0, pixels[k, 1] - v0
        cost, variation, count = np.inf, 1.0, 0
        for _attempt in range(2):
            u, v = theta[7], theta[8]
            count = _window(gray, u0, v0, u, v, steps[k], share[k], values, xs, ys)
            if count < _LEAST_SAMPLES:
                break
            variation = _light(theta, bend[k], values, xs, ys, count)
            if variation < _FEATURELESS * count:
                count = 0
                break
            cost = np.inf
            damping = 1e-3
            for turn in range(_ROUNDS):
                now = _linearise(theta, bend[k], values, xs, ys, count, factor, step)
                if now <= cost:
                    cost = now
                    _copy(best, theta, 9)
                    _copy(normal, factor, 81)
                    _copy(gradient, step, 9)
                    damping *= 0.1
                else:
                    damping *= 20.0
                if turn == _TRIAL and cost > _HOPELESS * variation:
                    cost = np.inf
                    break
                if damping > 1e6 or not _solve(normal, gradient, damping, factor, step):
                    break
                shrink = 1.0
                for i, limit in ((4, 0.2), (5, 0.2), (6, 0.4), (7, 1.0), (8, 1.0)):
                    shrink = min(shrink, limit / max(abs(step[i]), 1e-12))
                for i in range(9):
                    theta[i] = best[i] + shrink * step[i]
                theta[6] = min(max(theta[6], _BLUR[0]), _BLUR[1])
                short = max(abs(step[4]), abs(step[5]), abs(step[7]), abs(step[8])) < settled
                if shrink == 1.0 and now <= cost and short and abs(step[6]) < 4 * settled:
                    _copy(best, theta, 9)  # so short a step needs no further look
                    break
            if cost == np.inf:
                break
            _copy(theta, best, 9)
            moved = max(abs(best[7] - u), abs(best[8] - v))
            if moved < 0.25:
                break
        if count < _LEAST_SAMPLES or not np.isfinite(cost):
            continue
        away = math.hypot(u0 + best[7] - pixels[k, 0], v0 + best[8] - pixels[k, 1])
        room = 0.0
        for i in range(2):
            room = max(room, share[k, i] * math.hypot(steps[k, i, 0], steps[k, i, 1]))
        u, v = u0 + best[7], v0 + best[8]
        rim = min(u, v, gray.shape[1] - 1 - u, gray.shape[0] - 1 - v)
        determinant = steps[k, 0, 0] * steps[k, 1, 1] - steps[k, 0, 1] * steps[k, 1, 0]
        whole = 4 * share[k, 0] * share[k, 1] * abs(determinant)
        if rim < _RIM or (rim < room and count < _LEAST_WINDOW * whole):
            continue
        if away > 0.6 * room + 1 or not _solve(normal, gradient, 1e-9, factor, step):
            continue
        noise = max(cost / (count - 9), _ROUNDING)
        # The inverse's last 2x2 block is (L L^T)^-1 of the factor's last block.
        a, b, c = factor[70], factor[79], factor[80]
        figures[k, 0], figures[k, 1] = u0 + best[7], v0 + best[8]
        figures[k, 2] = noise * (1 / (a * a) + (b * b) / (a * a * c * c))
        figures[k, 3] = -noise * b / (a * c * c)
        figures[k, 4] = noise / (c * c)
        # Ahead, between both steps, is on opposite sides of the two edges.
        figures[k, 5], figures[k, 6] = -best[3], math.exp(best[6])
        figures[k, 7] = 1 - cost / variation
        if not rough:
            _told_apart(best, bend[k], values, xs, ys, count, factor, noise, pulls, shares, power)
    return power


@inner
def _window(gray, u0, v0, u, v, steps, share, values, xs, ys):
    """Collect the pixels of the parallelogram of both steps around the corner; give their number."""
    a, b, c, d = steps[0, 0], steps[1, 0], steps[0, 1], steps[1, 1]
    determinant = a * d - b * c
    reach_u = abs(a) * share[0] + abs(b) * share[1]
    reach_v = abs(c) * share[0] + abs(d) * share[1]
    low_u, low_v = max(math.ceil(u - reach_u), -_REACH, -u0), max(math.ceil(v - reach_v), -_REACH, -v0)
    high_u = min(math.floor(u + reach_u), _REACH, gray.shape[1] - 1 - u0)
    high_v = min(math.floor(v + reach_v), _REACH, gray.shape[0] - 1 - v0)
    count = 0
    for y in range(low_v, high_v + 1):
        for x in range(low_u, high_u + 1):
            p = (d * (x - u) - b * (y - v)) / determinant
            q = (a * (y - v) - c * (x - u)) / determinant
            if abs(p) <= share[0] and abs(q) <= share[1]:
                values[count], xs[count], ys[count] = gray[v0 + y, u0 + x], x, y
                count += 1
    return count


@inner
def _edges(theta):
    """Give cosine and sine of both directions, the blur, and the correlation of its parts across the two edges."""
    c0, s0, c1, s1 = math.cos(theta[4]), math.sin(theta[4]), math.cos(theta[5]), math.sin(theta[5])
    return c0, s0, c1, s1, math.exp(theta[6]), c0 * c1 + s0 * s1


@inner
def _shape(x, y, edges, bend):
    """Give the blurred product of both signs, its derivatives along the distances across, those, and those along.

    Distances across are in standard deviations of the blur. For edges at right angles it is the product of their error
    functions. Otherwise the blurs across them correlate by r, which adds 4 int_0^r density(x, y; q) dq (R. L. Plackett,
    A reduction formula for normal multivariate integrals, Biometrika 1954), here by the midpoint rule.
    """
    c0, s0, c1, s1, blur, r = edges
    along0, along1 = c0 * x + s0 * y, c1 * x + s1 * y
    a = (c0 * y - s0 * x - bend[0] * along0 * along0) / blur
    b = (c1 * y - s1 * x - bend[1] * along1 * along1) / blur
    e0, w0 = _step(a)
    e1, w1 = _step(b)
    shape, d0, d1 = e0 * e1, w0 * e1, w1 * e0
    if w0 != 0.0 and w1 != 0.0:
        q = r / 2
        rest = 1 - q * q
        bump = 2 * r / (math.pi * math.sqrt(rest)) * math.exp(-(a * a - 2 * q * a * b + b * b) / (2 * rest))
        shape += bump
        d0 -= bump * (a - q * b) / rest
        d1 -= bump * (b - q * a) / rest
    return shape, d0, d1, a, b, along0, along1


@inner
def _step(t):
    """Give a blurred sign and its derivative; far from the edge there is none to compute."""
    if t > 4.0:
        return 1.0, 0.0
    if t < -4.0:
        return -1.0, 0.0
    return math.erf(t * math.sqrt(0.5)), math.sqrt(2 / math.pi) * math.exp(-0.5 * t * t)


@inner
def _light(theta, bend, values, xs, ys, count):
    """Set level and amplitude to fit the window as it stands, no slopes; give the sum of squares about its mean."""
    edges = _edges(theta)
    mean = shape = product = square = power = 0.0
    for i in range(count):
        m = _shape(xs[i] - theta[7], ys[i] - theta[8], edges, bend)[0]
        mean += values[i]
        shape += m
        product += m * values[i]
        square += m * m
        power += values[i] * values[i]
    mean, shape = mean / count, shape / count
    theta[3] = (product / count - mean * shape) / max(square / count - shape * shape, 1e-9)
    theta[0], theta[1], theta[2] = mean - theta[3] * shape, 0.0, 0.0
    return power - count * mean * mean


@inner
def _row(x, y, theta, edges, bend, row):
    """Set the derivatives (9,) of the model at a pixel; give the model."""
    c0, s0, c1, s1, blur, _ = edges
    shape, d0, d1, a, b, along0, along1 = _shape(x, y, edges, bend)
    d0, d1 = theta[3] * d0, theta[3] * d1
    row[0], row[1], row[2], row[3] = 1.0, x, y, shape
    row[4], row[5] = -d0 * along0 / blur, -d1 * along1 / blur
    row[6] = -d0 * a - d1 * b
    row[7] = (d0 * s0 + d1 * s1) / blur - theta[1]
    row[8] = -(d0 * c0 + d1 * c1) / blur - theta[2]
    return theta[0] + theta[1] * x + theta[2] * y + theta[3] * shape


@inner
def _linearise(theta, bend, values, xs, ys, count, normal, gradient):
    """Set normal matrix (81,) and gradient (9,) of the fit at theta; give the sum of squared residuals."""
    for j in range(9):
        gradient[j] = 0.0
        for k in range(9):
            normal[9 * j + k] = 0.0
    row = np.empty(9)
    edges = _edges(theta)
    cost = 0.0
    for i in range(count):
        left = values[i] - _row(xs[i] - theta[7], ys[i] - theta[8], theta, edges, bend, row)
        cost += left * left
        for j in range(9):
            gradient[j] += row[j] * left
            for k in range(j + 1):
                normal[9 * j + k] += row[j] * row[k]
    return cost


@inner
def _solve(normal, gradient, damping, factor, step):
    """Solve (normal + damping diag) step = gradient by Cholesky into `factor` and `step`; whether it has one."""
    for j in range(9):
        for k in range(j + 1):
            total = normal[9 * j + k]
            if j == k:
                total = total * (1 + damping) + 1e-9
            for i in range(k):
                total -= factor[9 * j + i] * factor[9 * k + i]
            if j == k:
                if total <= 1e-12 * normal[10 * j]:
                    return False
                factor[10 * j] = math.sqrt(total)
            else:
                factor[9 * j + k] = total / factor[10 * k]
    for j in range(9):
        total = gradient[j]
        for k in range(j):
            total -= factor[9 * j + k] * step[k]
        step[j] = total / factor[10 * j]
    for j in range(8, -1, -1):
        total = step[j]
        for k in range(j + 1, 9):
            total -= factor[9 * k + j] * step[k]
        step[j] = total / factor[10 * j]
    return True


@inner
def _copy(to, origin, count):
    for i in range(count):
        to[i] = origin[i]


@inner
def _told_apart(theta, bend, values, xs, ys, count, factor, noise, pulls, shares, power):
    """Add up what blocks of pixels pull the corner, squared, and what they would if the noise in pixels were its own.

    Residuals of neighbouring pixels that agree pull together. With J the rows of derivatives, r the residuals and B a
    block, its pull is J_B^T r_B, and for noise of its own in each pixel the expectation of its square is
    noise (J_B^T J_B - J_B^T J (J^T J)^-1 J^T J_B), for the fit has taken its share.
    """
    for b in range(_BLOCKS * _BLOCKS):
        for i in range(2):
            pulls[b, i] = 0.0
            for j in range(9):
                shares[b, i, j] = 0.0
    row, solved = np.empty(9), np.empty(9)
    edges = _edges(theta)
    for n in range(count):
        left = values[n] - _row(xs[n] - theta[7], ys[n] - theta[8], theta, edges, bend, row)
        b = int(ys[n] + _REACH) // _BLOCK * _BLOCKS + int(xs[n] + _REACH) // _BLOCK
        for i in range(2):
            pulls[b, i] += row[7 + i] * left
            for j in range(9):
                shares[b, i, j] += row[7 + i] * row[j]
    for b in range(_BLOCKS * _BLOCKS):
        for i in range(2):
            expected = shares[b, i, 7 + i]
            if expected == 0.0:
                continue
            for j in range(9):
                total = shares[b, i, j]
                for k in range(j):
                    total -= factor[9 * j + k] * solved[k]
                solved[j] = total / factor[10 * j]
                expected -= solved[j] * solved[j]
            power[0] += pulls[b, i] * pulls[b, i]
            power[1] += noise * expected
