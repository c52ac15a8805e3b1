"""Compiled five-point solver: essential matrices from five pairs of bearings.

D. Nister, An efficient solution to the five-point relative pose problem, PAMI 26, 2004. The essential matrix is
E = x X + y Y + z Z + W in the null space of the five epipolar constraints; det E = 0 and 2 E E^T E = tr(E E^T) E are
ten cubic polynomials in (x, y, z), which elimination reduces to a polynomial of degree ten in z.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper, njit_inlined
from omnisight.optim._polynomial_kernel import real_roots
from omnisight.twoview._essential_kernel import poses_from_essential
from omnisight.twoview._small_vectors_kernel import cross

# Exponents of (x, y, z) of the monomials of degree 1, 2 and 3, the last in the order of the elimination.
LINEAR = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
QUADRATIC = ((2, 0, 0), (1, 1, 0), (1, 0, 1), (0, 2, 0), (0, 1, 1), (0, 0, 2), *LINEAR)
CUBIC = (
    *((3, 0, 0), (0, 3, 0), (2, 1, 0), (1, 2, 0), (2, 0, 1), (2, 0, 0), (0, 2, 1), (0, 2, 0), (1, 1, 1), (1, 1, 0)),
    *((1, 0, 2), (1, 0, 1), (1, 0, 0), (0, 1, 2), (0, 1, 1), (0, 1, 0), (0, 0, 3), (0, 0, 2), (0, 0, 1), (0, 0, 0)),
)


def _products(left, right, monomials):
    """Return the index of the product of each pair of monomials."""
    return np.array([[monomials.index(tuple(map(sum, zip(a, b, strict=True)))) for b in right] for a in left])


QUADRATIC_OF = _products(LINEAR, LINEAR, QUADRATIC)
CUBIC_OF = _products(QUADRATIC, LINEAR, CUBIC)


@njit_helper
def five_point(a, b, poses):
    """Compute the relative poses (10, 3, 4) of five pairs of bearings with positive distances; return their number."""
    matrices = np.empty((10, 3, 3))
    count = 0
    for k in range(essential_matrices(a, b, matrices)):
        count += poses_from_essential(matrices[k], a, b, poses[count:])
    return count


@njit_helper
def essential_matrices(a, b, matrices):
    """Compute the essential matrices E with b_i^T E a_i = 0 of five pairs of bearings (5, 3); return their number.

    Parameters
    ----------
    a, b
        (5, 3) bearings of both cameras.
    matrices
        (10, 3, 3), receives the matrices.
    """
    basis = _null_space(a, b)
    system = _constraints(basis)
    if not _eliminate(system):
        return 0
    rows = _in_last_unknown(system)
    determinant = _determinant(rows)
    roots = np.empty(10)
    count = 0
    for k in range(real_roots(determinant, roots)):
        x, y, is_finite = _other_unknowns(rows, roots[k])
        if is_finite:
            e = matrices[count]
            norm = 0.0
            for i in range(9):
                e[i // 3, i % 3] = x * basis[i, 0] + y * basis[i, 1] + roots[k] * basis[i, 2] + basis[i, 3]
                norm += e[i // 3, i % 3] ** 2
            e *= np.sqrt(2.0 / norm)
            count += 1
    return count


@njit_helper
def _null_space(a, b):
    """Return an orthonormal basis (9, 4), in columns, of the matrices that fulfil the five epipolar constraints."""
    m = np.empty((9, 5))
    for n in range(5):
        for i in range(3):
            for j in range(3):
                m[3 * i + j, n] = b[n, i] * a[n, j]
    # Householder reflections H_5 ... H_1 m = R, of vectors that replace the columns of m: the last columns of
    # H_1 ... H_5 are orthogonal to all constraints.
    for k in range(5):
        length = 0.0
        for i in range(k, 9):
            length += m[i, k] ** 2
        length = np.sqrt(length)
        m[k, k] += length if m[k, k] >= 0 else -length
        square = 0.0
        for i in range(k, 9):
            square += m[i, k] ** 2
        scale = np.sqrt(2.0 / square) if square > 0 else 0.0
        for i in range(k, 9):
            m[i, k] *= scale
        for n in range(k + 1, 5):
            dot = 0.0
            for i in range(k, 9):
                dot += m[i, k] * m[i, n]
            for i in range(k, 9):
                m[i, n] -= dot * m[i, k]
    basis = np.zeros((9, 4))
    for n in range(4):
        basis[5 + n, n] = 1.0
        for k in range(4, -1, -1):
            dot = 0.0
            for i in range(k, 9):
                dot += m[i, k] * basis[i, n]
            for i in range(k, 9):
                basis[i, n] -= dot * m[i, k]
    return basis


@njit_helper
def _constraints(basis):
    """Return the ten cubic constraints (10, 20) on (x, y, z)."""
    system = np.zeros((10, 20))
    # E E^T - tr(E E^T)/2 I, and (E E^T - tr(E E^T)/2 I) E = 0.
    gram = np.zeros((3, 3, 10))
    for i in range(3):
        for j in range(i + 1):
            for k in range(3):
                _add_quadratic(gram[i, j], basis[3 * i + k], basis[3 * j + k], 1.0)
            for m in range(10):
                gram[j, i, m] = gram[i, j, m]
    for m in range(10):
        half_trace = 0.5 * (gram[0, 0, m] + gram[1, 1, m] + gram[2, 2, m])
        for i in range(3):
            gram[i, i, m] -= half_trace
    for i in range(3):
        for j in range(3):
            for k in range(3):
                _add_cubic(system[3 * i + j], gram[i, k], basis[3 * k + j])
    # det E = 0, along the first row.
    minor = np.empty(10)
    for j in range(3):
        following, last = (j + 1) % 3, (j + 2) % 3
        minor[:] = 0.0
        _add_quadratic(minor, basis[3 + following], basis[6 + last], 1.0)
        _add_quadratic(minor, basis[3 + last], basis[6 + following], -1.0)
        _add_cubic(system[9], minor, basis[j])
    return system


@njit_inlined
def _add_quadratic(target, left, right, sign):
    """Add the product of two linear polynomials times a sign to a quadratic polynomial."""
    for p in range(4):
        for q in range(4):
            target[QUADRATIC_OF[p, q]] += sign * left[p] * right[q]


@njit_inlined
def _add_cubic(target, quadratic, linear):
    """Add the product of a quadratic and a linear polynomial to a cubic polynomial."""
    for p in range(10):
        for q in range(4):
            target[CUBIC_OF[p, q]] += quadratic[p] * linear[q]


@njit_helper
def _eliminate(system):
    """Reduce the first ten columns of the last six rows of a system (10, 20) to the identity, if it is regular."""
    for k in range(10):
        pivot = k
        for i in range(k + 1, 10):
            if abs(system[i, k]) > abs(system[pivot, k]):
                pivot = i
        if abs(system[pivot, k]) < 1e-14:
            return False
        for j in range(k, 20):
            system[k, j], system[pivot, j] = system[pivot, j], system[k, j]
        scale = 1.0 / system[k, k]
        for j in range(k, 20):
            system[k, j] *= scale
        for i in range(10):
            if i > k or 4 <= i < k:
                factor = system[i, k]
                for j in range(k, 20):
                    system[i, j] -= factor * system[k, j]
    return True


@njit_helper
def _in_last_unknown(system):
    """Return three polynomials (3, 3, 5) in z, the coefficients of x, y and 1, ascending in z.

    The leading monomials of two rows differ by a factor z, so the first minus z times the second is linear in x and y.
    """
    rows = np.zeros((3, 3, 5))
    for r in range(3):
        first, second = system[4 + 2 * r], system[5 + 2 * r]
        column = 10
        for unknown in range(3):
            count = 4 if unknown == 2 else 3
            for i in range(count):  # descending powers of z
                power = count - 1 - i
                rows[r, unknown, power] += first[column + i]
                rows[r, unknown, power + 1] -= second[column + i]
            column += count
    return rows


@njit_helper
def _determinant(rows):
    """Return the determinant (11,) of a matrix (3, 3) of polynomials.

    The bounds of the loops are literals, which lets the compiler unroll them.
    """
    determinant, minor = np.zeros(13), np.empty(9)
    for j in range(3):
        following, last = (j + 1) % 3, (j + 2) % 3
        minor[:] = 0.0
        for p in range(5):
            for q in range(5):
                minor[p + q] += rows[1, following, p] * rows[2, last, q] - rows[1, last, p] * rows[2, following, q]
        for p in range(5):
            for q in range(9):
                determinant[p + q] += rows[0, j, p] * minor[q]
    # The coefficients of x and y have degree 3, that of 1 has degree 4: the product has degree 10 at most.
    return determinant[:11]


@njit_helper
def _other_unknowns(rows, z):
    """Return x and y for a root z, and whether they are finite."""
    values = _at(rows[0], z), _at(rows[1], z), _at(rows[2], z)
    best, x, y = 0.0, 0.0, 0.0
    for r in range(3):
        nx, ny, nw = cross(values[r], values[(r + 1) % 3])
        if abs(nw) > best:
            best, x, y = abs(nw), nx / nw, ny / nw
    return x, y, best > 0.0


@njit_helper
def _at(row, z):
    """Return the values of three polynomials of degree four."""
    x, y, w = row[0, 4], row[1, 4], row[2, 4]
    for power in range(3, -1, -1):
        x, y, w = x * z + row[0, power], y * z + row[1, power], w * z + row[2, power]
    return x, y, w
