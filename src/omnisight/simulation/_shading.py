"""Compiled shading: the light along rays, from anisotropically filtered textures and precomputed light."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math
from functools import partial

import numpy as np

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper, njit_inlined
from omnisight.simulation._shapes import CYLINDER, ELLIPSOID, RECTANGLE, chart, place
from omnisight.simulation._trace import first_hit, point_to_local, to_local, world_normal

# Texture samples along the longer side of a ray's footprint, and across it.
MAX_PROBES, ROWS = 12, 2
# Scale of the footprint for filtering; less than 1, because several rays per pixel are averaged.
FOOTPRINT_SCALE = 0.85
# Offset of shadow rays from the surface, metres, against self-intersection.
SHADOW_OFFSET_M = 1e-5


@njit_inlined
def _bilinear_cell(start, width, height, u, v):
    """Return the bilinear cell of a grid position: index, index steps right and down, and fractions."""
    x = min(max(u * width - 0.5, 0.0), width - 1.0)
    y = min(max(v * height - 0.5, 0.0), height - 1.0)
    column, row = int(x), int(y)
    fx, fy = x - column, y - row
    right, below = (1 if column + 1 < width else 0), (width if row + 1 < height else 0)
    return start + row * width + column, right, below, fx, fy


@njit_inlined
def _linear(textures, at, channel):
    """Return the light in one channel of a texel."""
    return textures.linear[textures.texels[at, channel]]


@njit_inlined
def _texel(textures, level, u, v):
    """Interpolate the light (r, g, b) in one level of a texture bilinearly, clamped at its edges."""
    start, width, height = textures.levels[level, 0], textures.levels[level, 1], textures.levels[level, 2]
    at, right, below, fx, fy = _bilinear_cell(start, width, height, u, v)
    r0, r1 = _linear(textures, at, 0), _linear(textures, at + below, 0)
    g0, g1 = _linear(textures, at, 1), _linear(textures, at + below, 1)
    b0, b1 = _linear(textures, at, 2), _linear(textures, at + below, 2)
    r0 += fx * (_linear(textures, at + right, 0) - r0)
    g0 += fx * (_linear(textures, at + right, 1) - g0)
    b0 += fx * (_linear(textures, at + right, 2) - b0)
    r1 += fx * (_linear(textures, at + below + right, 0) - r1)
    g1 += fx * (_linear(textures, at + below + right, 1) - g1)
    b1 += fx * (_linear(textures, at + below + right, 2) - b1)
    return r0 + fy * (r1 - r0), g0 + fy * (g1 - g0), b0 + fy * (b1 - b0)


@njit_inlined
def _wrap(u, repeats):
    """Return the position within one copy of a repeated texture."""
    return u - math.floor(u) if repeats > 1 else u


@njit_helper
def _filtered(textures, texture, u, v, ux, vx, uy, vy):
    """Return the mean light of a texture over the parallelogram with sides (ux, vx), (uy, vy) about (u, v).

    Anisotropic filtering: two rows of samples along the longer side, each in the mipmap level of half the shorter side.
    Their mean is close to that of the area; one row would blur or alias.
    """
    first, count = textures.tables[texture, 0], textures.tables[texture, 1]
    columns, rows = textures.tables[texture, 2], textures.tables[texture, 3]
    width, height = textures.levels[first, 1], textures.levels[first, 2]
    u, ux, uy, v, vx, vy = u * columns, ux * columns, uy * columns, v * rows, vx * rows, vy * rows
    a = math.sqrt((ux * width) ** 2 + (vx * height) ** 2)
    b = math.sqrt((uy * width) ** 2 + (vy * height) ** 2)
    if a < b:
        a, b, ux, vx, uy, vy = b, a, uy, vy, ux, vx
    a, b = a * FOOTPRINT_SCALE, b * FOOTPRINT_SCALE
    across = ROWS if b > 1.0 else 1
    probes = max(int(min(math.ceil(across * a / max(b, 1.0)), MAX_PROBES)), 1) if a > 1.0 else 1
    level = math.log2(max(b / across, a / probes, 1.0))
    low = int(min(level, count - 1.0))
    share = level - low if low + 1 < count else 0.0
    red = green = blue = 0.0
    for i in range(probes):
        s = (i + 0.5) / probes - 0.5
        for j in range(across):
            t = (j + 0.5) / across - 0.5
            p, q = _wrap(u + s * ux + t * uy, columns), _wrap(v + s * vx + t * vy, rows)
            r0, g0, b0 = _texel(textures, first + low, p, q)
            if share > 0:
                r1, g1, b1 = _texel(textures, first + low + 1, p, q)
                r0, g0, b0 = r0 + share * (r1 - r0), g0 + share * (g1 - g0), b0 + share * (b1 - b0)
            red, green, blue = red + r0, green + g0, blue + b0
    taken = probes * across
    return red / taken, green / taken, blue / taken


@njit_inlined
def _light(world, face, u, v):
    """Interpolate the precomputed light on a face bilinearly."""
    start, width, height = world.faces[face, 1], world.faces[face, 2], world.faces[face, 3]
    at, right, below, fx, fy = _bilinear_cell(start, width, height, u, v)
    above = world.light[at] + fx * (world.light[at + right] - world.light[at])
    under = world.light[at + below] + fx * (world.light[at + below + right] - world.light[at + below])
    return above + fy * (under - above)


@njit_helper
def _chart_step(tree, solid, face, x, y, z, u, v, step):
    """Return the change of (u, v) for a step (x, y, z) along a face."""
    sx, sy, sz = to_local(tree.local_from_world, solid, step[0], step[1], step[2])
    kind = tree.kinds[solid]
    a, b = chart(kind, face, x + sx, y + sy, z + sz)
    a -= u
    if kind in (ELLIPSOID, CYLINDER):
        a -= np.rint(a)  # across the seam
    return a, b - v


@njit_inlined
def _surface_step(t, d, n, origin_step, bearing_step):
    """Return the displacement of a hit on its face from a ray to a neighbouring ray (ray differential)."""
    sx = origin_step[0] + t * bearing_step[0]
    sy = origin_step[1] + t * bearing_step[1]
    sz = origin_step[2] + t * bearing_step[2]
    slope = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    slope = slope if abs(slope) > 1e-3 else 1e-3
    back = (n[0] * sx + n[1] * sy + n[2] * sz) / slope
    return sx - back * d[0], sy - back * d[1], sz - back * d[2]


@njit_inlined
def sky_light(world, textures, d, dx, dy):
    """Return the light (r, g, b) of the sky; dx and dy are differences to the bearings right and below."""
    if world.sky < 0:
        return 0.0, 0.0, 0.0
    u, v = chart(ELLIPSOID, 0, d[0], d[1], d[2])
    wide = norm(dx) / (2 * math.pi * max(math.sqrt(d[0] * d[0] + d[2] * d[2]), 1e-3))
    r, g, b = _filtered(textures, world.sky, u, v, wide, 0.0, 0.0, norm(dy) / math.pi)
    if world.fog[0] > 0:
        r, g, b = fogged(world.fog, r, g, b, world.fog[4] / max(-d[1], 1e-3))
    return r, g, b


@njit_inlined
def texture_position(tree, t, solid, face, o, d):
    """Return the local point (x, y, z) of a hit and its texture coordinates (u, v)."""
    x, y, z = point_to_local(tree.local_from_world, solid, o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
    u, v = chart(tree.kinds[solid], face, x, y, z)
    return x, y, z, u, v


@njit_inlined
def difference(tree, solid, u0, v0, u1, v1):
    """Return the difference of texture coordinates between two hits on a face."""
    u = u1 - u0
    if tree.kinds[solid] in (ELLIPSOID, CYLINDER):
        u -= np.rint(u)  # across the seam
    return u, v1 - v0


@njit_inlined
def footprint(world, tree, hit, place, d, steps):
    """Return the changes (ux, vx, uy, vy) of texture coordinates to the rays right and below, by ray differentials.

    `hit` is the distance, the solid and the face, `place` what `texture_position` returns, and `steps` are the
    differences of origin and bearing to the ray right, and to the ray below.
    """
    t, solid, face = hit
    x, y, z, u, v = place
    n = world_normal(world, tree, solid, face, x, y, z)
    ux, vx = _chart_step(tree, solid, face, x, y, z, u, v, _surface_step(t, d, n, steps[0], steps[1]))
    uy, vy = _chart_step(tree, solid, face, x, y, z, u, v, _surface_step(t, d, n, steps[2], steps[3]))
    return ux, vx, uy, vy


@njit_inlined
def surface(world, tree, textures, hit, place, o, d, sides):
    """Return the albedo (r, g, b) at the hit of a ray, its light from around, the cosine to the sun, and a shadow ray.

    `sides` are the texture coordinates of the footprint's sides; see `footprint`. The shadow ray starts at (x, y, z).
    """
    t, solid, face = hit
    x, y, z, u, v = place
    n = world_normal(world, tree, solid, face, x, y, z)
    row = world.first_face[solid] + face
    r, g, b = _filtered(textures, world.faces[row, 0], u, v, sides[0], sides[1], sides[2], sides[3])
    light = float(_light(world, row, u, v))
    # A rectangle has two sides.
    two_sided = tree.kinds[solid] == RECTANGLE and n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0
    side = -1.0 if two_sided else 1.0
    facing = side * (n[0] * world.sun[0] + n[1] * world.sun[1] + n[2] * world.sun[2])
    lift = side * SHADOW_OFFSET_M
    px, py, pz = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
    return r, g, b, light, facing, px + lift * n[0], py + lift * n[1], pz + lift * n[2]


@njit_inlined
def fogged(fog, r, g, b, t):
    """Return light (r, g, b) after a distance in fog."""
    kept = math.exp(-fog[0] * t)
    return fog[1] + kept * (r - fog[1]), fog[2] + kept * (g - fog[2]), fog[3] + kept * (b - fog[3])


@njit_inlined
def norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@partial(njit_driver, **STREAMLINED)
def precompute_light(world, world_from_local, spots, directions, lamps, ambient, reach, light, first, last):
    """Compute rows first to last of the light at samples (N, 4): solid, face, u, v.

    Ambient light is reduced by solids within `reach` (ambient occlusion), sampled by cosine-weighted directions (K, 3)
    about z. Lamps (M, 4), position and strength, shine downwards with the inverse square of the distance.
    """
    tree = world.tree
    for i in range(first, last):
        solid, face = int(spots[i, 0]), int(spots[i, 1])
        x, y, z = place(tree.kinds[solid], face, spots[i, 2], spots[i, 3])
        nx, ny, nz = world_normal(world, tree, solid, face, x, y, z)
        px, py, pz = point_to_local(world_from_local, solid, x, y, z)
        px, py, pz = px + SHADOW_OFFSET_M * nx, py + SHADOW_OFFSET_M * ny, pz + SHADOW_OFFSET_M * nz
        # A frame about the normal (Duff et al. 2017, Building an orthonormal basis, revisited).
        sign = 1.0 if nz >= 0 else -1.0
        a = -1 / (sign + nz)
        b = nx * ny * a
        total = 0.0
        for k in range(len(directions)):
            s, c, n = directions[k, 0], directions[k, 1], directions[k, 2]
            dx = s * (1 + sign * nx * nx * a) + c * b + n * nx
            dy = s * sign * b + c * (sign + ny * ny * a) + n * ny
            dz = -s * sign * nx - c * ny + n * nz
            t, _, _ = first_hit(tree, px, py, pz, dx, dy, dz, 1e-6, np.inf, -1, False)
            total += t / (t + reach) if t < np.inf else 1.0
        total *= ambient / len(directions)
        for k in range(len(lamps)):
            lx, ly, lz = lamps[k, 0] - px, lamps[k, 1] - py, lamps[k, 2] - pz
            far = math.sqrt(lx * lx + ly * ly + lz * lz)
            lx, ly, lz = lx / far, ly / far, lz / far
            # Cosine at the lamp, which shines down (+y).
            facing = (lx * nx + ly * ny + lz * nz) * max(-ly, 0.0)
            if facing > 0 and first_hit(tree, px, py, pz, lx, ly, lz, 1e-6, far - 1e-3, -1, True)[1] < 0:
                total += lamps[k, 3] * facing / (far * far)
        light[i] = total
