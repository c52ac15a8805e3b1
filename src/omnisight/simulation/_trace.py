"""Compiled ray casting through a bounding-box tree."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math
from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.simulation._shapes import meet, normal


class World(NamedTuple):
    """A scene in arrays, for the compiled loops.

    Attributes
    ----------
    local_from_world
        (S, 3, 4), for each solid.
    kinds, first_face, instance
        (S,), for each solid: shape, first row in `faces`, instance number.
    inward
        (S,), -1 for solids seen from inside, else 1.
    boxes
        (N, 6) low and high corner of each node of the tree, parents before children.
    nodes
        (N, 3): next node if this one is skipped, first solid and number of solids of a leaf.
    faces
        (F, 4), for each face: texture, start of its light, columns and rows of the light.
    light
        Light on the faces, 1 for daylight.
    textures
        (T, 4): first row in `levels`, number of levels, and repetitions to the right and down.
    levels
        (L, 3): start in `texels`, width and height.
    texels
        (X, 3), 8 bits, sRGB.
    linear
        (256,) linear light of each 8-bit value.
    sun
        (4,) direction to the sun and its strength.
    sky
        Texture of the sky, -1 if there is none.
    """

    local_from_world: Any
    kinds: Any
    first_face: Any
    instance: Any
    inward: Any
    boxes: Any
    nodes: Any
    faces: Any
    light: Any
    textures: Any
    levels: Any
    texels: Any
    linear: Any
    sun: Any
    sky: int


@njit_helper
def to_local(m, x, y, z):
    """Transform a direction by the linear part of (3, 4)."""
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@njit_helper
def first_hit(world, ox, oy, oz, dx, dy, dz, least, most):
    """Return distance, solid and face of the first hit between two distances; inf and -1 if there is none."""
    best, solid, best_face = most, -1, 0
    ix, iy, iz = 1 / dx, 1 / dy, 1 / dz
    boxes, node, end = world.boxes, 0, len(world.nodes)
    while node < end:
        x0, x1 = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
        y0, y1 = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
        z0, z1 = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
        enter = max(min(x0, x1), min(y0, y1), min(z0, z1))
        leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
        if enter > leave or leave < least or enter > best:
            node = world.nodes[node, 0]
            continue
        start, count = world.nodes[node, 1], world.nodes[node, 2]
        for i in range(start, start + count):
            m = world.local_from_world[i]
            px, py, pz = to_local(m, ox, oy, oz)
            qx, qy, qz = to_local(m, dx, dy, dz)
            t, face = meet(world.kinds[i], px + m[0, 3], py + m[1, 3], pz + m[2, 3], qx, qy, qz, least)
            if t < best:
                best, solid, best_face = t, i, face
        node += 1
    return (best if solid >= 0 else np.inf), solid, best_face


@njit_helper
def world_normal(world, solid, face, x, y, z):
    """Return the unit normal (world frame) of the visible side at a local point of a face."""
    m = world.local_from_world[solid]
    a, b, c = normal(world.kinds[solid], face, x, y, z)
    nx = m[0, 0] * a + m[1, 0] * b + m[2, 0] * c
    ny = m[0, 1] * a + m[1, 1] * b + m[2, 1] * c
    nz = m[0, 2] * a + m[1, 2] * b + m[2, 2] * c
    scale = world.inward[solid] / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@njit_driver
def cast(world, origins, bearings, distances, normals, instances, first, last):
    """Compute rows first to last of distances (N,), normals (N, 3) and instances (N,) of the hits of rays (N, 3).

    Normals point towards the origin of the ray. A ray without a hit has NaN and instance 0.
    """
    for i in range(first, last):
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = bearings[i, 0], bearings[i, 1], bearings[i, 2]
        t, solid, face = np.inf, -1, 0
        if dx == dx:
            t, solid, face = first_hit(world, ox, oy, oz, dx, dy, dz, 1e-9, np.inf)
        if solid < 0:
            distances[i], instances[i] = np.nan, 0
            normals[i, 0] = normals[i, 1] = normals[i, 2] = np.nan
            continue
        m = world.local_from_world[solid]
        x, y, z = to_local(m, ox + t * dx, oy + t * dy, oz + t * dz)
        nx, ny, nz = world_normal(world, solid, face, x + m[0, 3], y + m[1, 3], z + m[2, 3])
        turn = -1.0 if nx * dx + ny * dy + nz * dz > 0 else 1.0
        distances[i], instances[i] = t, world.instance[solid]
        normals[i, 0], normals[i, 1], normals[i, 2] = turn * nx, turn * ny, turn * nz
