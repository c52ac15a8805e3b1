"""Compiled traversal of a bounding-box tree by packets: rays of one pixel, which visit nearly the same nodes.

The box of a node is tested once for all rays of a packet, by intervals of their origins and directions (Boulos et al.,
2006, Geometric and arithmetic culling methods for entire ray packets). The test is conservative, so
that the hits are those of single rays.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper, njit_inlined
from omnisight.simulation._trace import first_hit, meet_solid

# Packets with origins farther apart, metres, visit too many nodes: their rays are traced one by one.
MAX_SPREAD_M = 1.0
LEAST = 1e-9
SHADOW_LEAST = 1e-6


@njit_inlined
def _axis(origins, bearings, count, k):
    """Return the interval of one axis of a packet, mirrored to positive directions.

    Sign (0 if the directions differ in sign), origins from low to high, and inverse directions from low to high.
    """
    first = bearings[0, k]
    sign = 1.0 if first > 0 else -1.0
    low = high = sign * origins[0, k]
    least = most = sign * first
    for r in range(1, count):
        o, d = sign * origins[r, k], sign * bearings[r, k]
        low, high = min(low, o), max(high, o)
        least, most = min(least, d), max(most, d)
    if not least > 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    return sign, low, high, 1 / most, 1 / least


@njit_inlined
def _enter(near, high, inverse_low, inverse_high):
    """Return the least distance at which a ray of a packet passes the near plane of a slab."""
    gap = near - high
    return gap * inverse_low if gap >= 0 else gap * inverse_high


@njit_inlined
def _leave(far, low, inverse_low, inverse_high):
    """Return the greatest distance at which a ray of a packet passes the far plane of a slab."""
    gap = far - low
    return gap * inverse_high if gap >= 0 else gap * inverse_low


@njit_helper
def first_hits(tree, rays, count, guess, distances, hits):
    """Compute distances (K,), and solid and face (K, 2), of the first hits of a packet; inf and -1 without a hit.

    Rays (2, K, 3) are origins and bearings. `guess` is a solid that is likely to be hit; see `first_hit`.
    """
    origins, bearings = rays[0], rays[1]
    sx, lx, hx, ax, bx = _axis(origins, bearings, count, 0)
    sy, ly, hy, ay, by = _axis(origins, bearings, count, 1)
    sz, lz, hz, az, bz = _axis(origins, bearings, count, 2)
    if count == 1 or sx * sy * sz == 0 or max(hx - lx, hy - ly, hz - lz) > MAX_SPREAD_M:
        for r in range(count):
            ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
            dx, dy, dz = bearings[r, 0], bearings[r, 1], bearings[r, 2]
            t, solid, face = first_hit(tree, ox, oy, oz, dx, dy, dz, LEAST, np.inf, guess, False)
            distances[r], hits[r, 0], hits[r, 1] = t, solid, face
            guess = solid
        return
    for r in range(count):
        distances[r], hits[r, 0], hits[r, 1] = np.inf, -1, 0
    if guess >= 0:
        _meet_packet(tree, guess, rays, count, distances, hits)
    farthest = _farthest(distances, count)
    near_x, near_y, near_z = (0 if sx > 0 else 3), (1 if sy > 0 else 4), (2 if sz > 0 else 5)
    far_x, far_y, far_z = 3 - near_x, 5 - near_y, 7 - near_z
    size = len(tree.nodes) // 8
    node = size * ((1 if sx < 0 else 0) + (2 if sy < 0 else 0) + (4 if sz < 0 else 0))
    end = node + size
    boxes = tree.boxes
    while node < end:
        enter = max(
            _enter(sx * boxes[node, near_x], hx, ax, bx),
            _enter(sy * boxes[node, near_y], hy, ay, by),
            _enter(sz * boxes[node, near_z], hz, az, bz),
        )
        leave = min(
            _leave(sx * boxes[node, far_x], lx, ax, bx),
            _leave(sy * boxes[node, far_y], ly, ay, by),
            _leave(sz * boxes[node, far_z], lz, az, bz),
        )
        if enter > leave or leave < LEAST or enter > farthest:
            node = tree.nodes[node, 0]
            continue
        i = tree.nodes[node, 1]
        node += 1
        if i >= 0 and i != guess:
            _meet_packet(tree, i, rays, count, distances, hits)
            farthest = _farthest(distances, count)


@njit_helper
def _meet_packet(tree, i, rays, count, distances, hits):
    """Intersect a packet with a solid; keep what is nearer than before. Of equal distances the first solid is hit."""
    for r in range(count):
        t, face = meet_solid(
            tree, i, rays[0, r, 0], rays[0, r, 1], rays[0, r, 2], rays[1, r, 0], rays[1, r, 1], rays[1, r, 2], LEAST
        )
        if t < distances[r] or (t == distances[r] and t < np.inf and i < hits[r, 0]):
            distances[r], hits[r, 0], hits[r, 1] = t, i, face


@njit_inlined
def _farthest(distances, count):
    farthest = distances[0]
    for r in range(1, count):
        farthest = max(farthest, distances[r])
    return farthest


@njit_helper
def find_shadows(tree, rays, count, guess, hidden):
    """Compute which of the origins (K, 3) of a packet (2, K, 3) with one direction are hidden in it, 1 or 0.

    Return a solid that hides one of them, or `guess`, which is likely to hide them.
    """
    origins, bearings = rays[0], rays[1]
    dx, dy, dz = bearings[0, 0], bearings[0, 1], bearings[0, 2]
    sx, lx, hx, ax, bx = _axis(origins, bearings, count, 0)
    sy, ly, hy, ay, by = _axis(origins, bearings, count, 1)
    sz, lz, hz, az, bz = _axis(origins, bearings, count, 2)
    shader = guess
    if count == 1 or sx * sy * sz == 0 or max(hx - lx, hy - ly, hz - lz) > MAX_SPREAD_M:
        for r in range(count):
            ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
            solid = first_hit(tree, ox, oy, oz, dx, dy, dz, SHADOW_LEAST, np.inf, shader, True)[1]
            hidden[r] = 1 if solid >= 0 else 0
            shader = solid
        return shader
    for r in range(count):
        hidden[r] = 0
    left = count
    if guess >= 0:
        left -= _hide(tree, guess, rays, count, hidden)
    near_x, near_y, near_z = (0 if sx > 0 else 3), (1 if sy > 0 else 4), (2 if sz > 0 else 5)
    far_x, far_y, far_z = 3 - near_x, 5 - near_y, 7 - near_z
    size = len(tree.nodes) // 8
    node = size * ((1 if sx < 0 else 0) + (2 if sy < 0 else 0) + (4 if sz < 0 else 0))
    end = node + size
    boxes = tree.boxes
    while node < end and left > 0:
        enter = max(
            _enter(sx * boxes[node, near_x], hx, ax, bx),
            _enter(sy * boxes[node, near_y], hy, ay, by),
            _enter(sz * boxes[node, near_z], hz, az, bz),
        )
        leave = min(
            _leave(sx * boxes[node, far_x], lx, ax, bx),
            _leave(sy * boxes[node, far_y], ly, ay, by),
            _leave(sz * boxes[node, far_z], lz, az, bz),
        )
        if enter > leave or leave < SHADOW_LEAST:
            node = tree.nodes[node, 0]
            continue
        i = tree.nodes[node, 1]
        node += 1
        if i >= 0 and i != guess:
            found = _hide(tree, i, rays, count, hidden)
            if found > 0:
                left -= found
                shader = i
    return shader if left < count else -1


@njit_helper
def _hide(tree, i, rays, count, hidden):
    """Mark the rays of a packet that a solid meets; return how many were not marked before."""
    found = 0
    for r in range(count):
        if hidden[r] == 0:
            t, _ = meet_solid(
                tree,
                i,
                rays[0, r, 0],
                rays[0, r, 1],
                rays[0, r, 2],
                rays[1, r, 0],
                rays[1, r, 1],
                rays[1, r, 2],
                SHADOW_LEAST,
            )
            if t < np.inf:
                hidden[r] = 1
                found += 1
    return found
