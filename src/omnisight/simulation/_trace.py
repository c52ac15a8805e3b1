"""Compiled ray casting through a bounding-box tree."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math
from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper, njit_inlined
from omnisight.simulation._shapes import meet, normal


class Tree(NamedTuple):
    """Solids in a bounding-box tree, in arrays for the compiled loops.

    The tree is stored once for each octant of ray directions, with the nearer child of a node first.

    Attributes
    ----------
    local_from_world
        (S, 3, 4), for each solid.
    kinds
        (S,), shape of each solid.
    boxes
        (8 N, 6) low and high corner of each node, parents before children.
    nodes
        (8 N, 2): next node if this one is skipped, and the solid of a leaf, else -1.
    """

    local_from_world: Any
    kinds: Any
    boxes: Any
    nodes: Any


class Textures(NamedTuple):
    """All textures of a scene, in arrays for the compiled loops.

    Attributes
    ----------
    tables
        (T, 4): first row in `levels`, number of levels, and repetitions to the right and down.
    levels
        (L, 3): start in `texels`, width and height.
    texels
        (X, 3), 8 bits, sRGB.
    linear
        (256,) linear light of each 8-bit value.
    """

    tables: Any
    levels: Any
    texels: Any
    linear: Any


class World(NamedTuple):
    """A scene in arrays, for the compiled loops.

    Attributes
    ----------
    tree
        The solids.
    first_face, instance
        (S,), for each solid: first row in `faces`, instance number.
    inward
        (S,), -1 for solids seen from inside, else 1.
    faces
        (F, 4), for each face: texture, start of its light, columns and rows of the light.
    light
        Light on the faces, 1 for daylight.
    textures
        The textures.
    sun
        (4,) direction to the sun and its strength.
    colors
        (2, 3) of sunlight and skylight.
    fog
        (5,) extinction per metre, colour, and height of the layer, metres.
    sky
        Texture of the sky, -1 if there is none.
    """

    tree: Tree
    first_face: Any
    instance: Any
    inward: Any
    faces: Any
    light: Any
    textures: Textures
    sun: Any
    colors: Any
    fog: Any
    sky: int


@njit_inlined
def to_local(m, i, x, y, z):
    """Transform a direction by the linear part of m[i], (N, 3, 4)."""
    return (
        m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z,
        m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z,
        m[i, 2, 0] * x + m[i, 2, 1] * y + m[i, 2, 2] * z,
    )


@njit_inlined
def point_to_local(m, i, x, y, z):
    """Transform a point by m[i], (N, 3, 4)."""
    a, b, c = to_local(m, i, x, y, z)
    return a + m[i, 0, 3], b + m[i, 1, 3], c + m[i, 2, 3]


@njit_inlined
def meet_solid(tree, i, ox, oy, oz, dx, dy, dz, least):
    """Return the first distance > least at which a ray meets a solid, and the face."""
    px, py, pz = point_to_local(tree.local_from_world, i, ox, oy, oz)
    qx, qy, qz = to_local(tree.local_from_world, i, dx, dy, dz)
    return meet(tree.kinds[i], px, py, pz, qx, qy, qz, least)


@njit_helper
def first_hit(tree, ox, oy, oz, dx, dy, dz, least, most, guess, stop):
    """Return distance, solid and face of the first hit between two distances; inf and -1 if there is none.

    A solid that is likely to be hit, `guess` (-1 for none), is intersected first; solids beyond it are skipped. It does
    not change the result: of solids at the same distance, the first in the tree is hit. With `stop`, return any hit.
    """
    best, solid, best_face = most, -1, 0
    ix, iy, iz = 1 / dx, 1 / dy, 1 / dz
    size = len(tree.nodes) // 8
    node = size * ((1 if dx < 0 else 0) + (2 if dy < 0 else 0) + (4 if dz < 0 else 0))
    end = node + size
    if guess >= 0:
        t, face = meet_solid(tree, guess, ox, oy, oz, dx, dy, dz, least)
        if t < best:
            best, solid, best_face = t, guess, face
            node = end if stop else node
    while node < end:
        x0, x1 = (tree.boxes[node, 0] - ox) * ix, (tree.boxes[node, 3] - ox) * ix
        y0, y1 = (tree.boxes[node, 1] - oy) * iy, (tree.boxes[node, 4] - oy) * iy
        z0, z1 = (tree.boxes[node, 2] - oz) * iz, (tree.boxes[node, 5] - oz) * iz
        enter = max(min(x0, x1), min(y0, y1), min(z0, z1))
        leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
        if enter > leave or leave < least or enter > best:
            node = tree.nodes[node, 0]
            continue
        i = tree.nodes[node, 1]
        node += 1
        if i >= 0 and i != guess:
            t, face = meet_solid(tree, i, ox, oy, oz, dx, dy, dz, least)
            if t < best or (t == best and i < solid):
                best, solid, best_face = t, i, face
                node = end if stop else node
    return (best if solid >= 0 else np.inf), solid, best_face


@njit_helper
def world_normal(world, tree, solid, face, x, y, z):
    """Return the unit normal (world frame) of the visible side at a local point of a face."""
    a, b, c = normal(tree.kinds[solid], face, x, y, z)
    nx, ny, nz = _transposed(tree.local_from_world, solid, a, b, c)
    scale = world.inward[solid] / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@njit_inlined
def _transposed(m, i, x, y, z):
    """Transform a normal by the transpose of the linear part of m[i], (N, 3, 4)."""
    return (
        m[i, 0, 0] * x + m[i, 1, 0] * y + m[i, 2, 0] * z,
        m[i, 0, 1] * x + m[i, 1, 1] * y + m[i, 2, 1] * z,
        m[i, 0, 2] * x + m[i, 1, 2] * y + m[i, 2, 2] * z,
    )
