"""Compiled intersection of rays with a scene: neighbouring rays with similar directions are traced as a packet."""

# Compiled code takes its types from its arguments.
# pyright: basic

from functools import partial

import numpy as np

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper
from omnisight.simulation._packets import first_hits
from omnisight.simulation._trace import point_to_local, world_normal

# Rays per packet, and the greatest difference of their directions: wider packets visit too many nodes.
PACKET, MAX_ANGLE_RAD = 8, 0.05


@njit_helper
def _gather(origins, bearings, begin, end, rays):
    """Store rays from `begin` in a packet (2, K, 3) while they are similar; return the first that is not in it."""
    i = begin
    while i < end and i - begin < rays.shape[1]:
        # A NaN is not similar.
        extent = 0.0
        for k in range(3):
            extent = max(extent, abs(bearings[i, k] - bearings[begin, k]))
        if not extent <= MAX_ANGLE_RAD:
            break
        for k in range(3):
            rays[0, i - begin, k], rays[1, i - begin, k] = origins[i, k], bearings[i, k]
        i += 1
    return i


@partial(njit_driver, **STREAMLINED)
def cast(world, origins, bearings, distances, normals, instances, scratch, first, last):
    """Compute rows first to last of distances (N,), normals (N, 3) and instances (N,) of the hits of rays (N, 3).

    Normals point towards the origin of the ray. A ray without a hit has NaN and instance 0. `scratch` are arrays of the
    rays (2, K, 3), distances (K,) and hits (K, 2) of a packet.
    """
    tree, guess = world.tree, -1
    rays, lengths, hits = scratch
    begin = first
    while begin < last:
        end = begin
        if bearings[begin, 0] == bearings[begin, 0]:
            end = _gather(origins, bearings, begin, last, rays)
        if end > begin:
            first_hits(tree, rays, end - begin, guess, lengths, hits)
            guess = hits[end - begin - 1, 0]
        else:
            lengths[0], hits[0, 0], hits[0, 1] = np.inf, -1, 0
            end = begin + 1
        for i in range(begin, end):
            t, solid, face = lengths[i - begin], hits[i - begin, 0], hits[i - begin, 1]
            if solid < 0:
                distances[i], instances[i] = np.nan, 0
                normals[i, 0] = normals[i, 1] = normals[i, 2] = np.nan
                continue
            dx, dy, dz = bearings[i, 0], bearings[i, 1], bearings[i, 2]
            x, y, z = point_to_local(
                tree.local_from_world,
                solid,
                origins[i, 0] + t * dx,
                origins[i, 1] + t * dy,
                origins[i, 2] + t * dz,
            )
            nx, ny, nz = world_normal(world, tree, solid, face, x, y, z)
            turn = -1.0 if nx * dx + ny * dy + nz * dz > 0 else 1.0
            distances[i], instances[i] = t, world.instance[solid]
            normals[i, 0], normals[i, 1], normals[i, 2] = turn * nx, turn * ny, turn * nz
        begin = end
