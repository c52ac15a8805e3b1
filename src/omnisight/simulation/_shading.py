"""Compiled shading: the light along rays, from anisotropically filtered textures and precomputed light."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.simulation._shapes import CYLINDER, ELLIPSOID, RECTANGLE, chart, place
from omnisight.simulation._trace import first_hit, to_local, world_normal

# Texture samples along the longer side of a ray's footprint, and across it.
MAX_PROBES, ROWS = 12, 2
# Scale of the footprint for filtering; less than 1, because several rays per pixel are averaged.
FOOTPRINT_SCALE = 0.85
# Colours of sunlight and skylight (red, green, blue).
SUNLIGHT, SKYLIGHT = (1.05, 1.0, 0.88), (0.93, 0.98, 1.1)
# Offset of shadow rays from the surface, metres, against self-intersection.
SHADOW_OFFSET_M = 1e-5


@njit_helper
def _bilinear_cell(start, width, height, u, v):
    """Return the bilinear cell of a grid position: index, index steps right and down, and fractions."""
    x = min(max(u * width - 0.5, 0.0), width - 1.0)
    y = min(max(v * height - 0.5, 0.0), height - 1.0)
    column, row = int(x), int(y)
    fx, fy = x - column, y - row
    right, below = (1 if column + 1 < width else 0), (width if row + 1 < height else 0)
    return start + row * width + column, right, below, fx, fy


@njit_helper
def _texel(textures, level, u, v):
    """Interpolate the light (r, g, b) in one level of a texture bilinearly, clamped at its edges."""
    levels, texels, linear = textures.levels, textures.texels, textures.linear
    start, width, height = levels[level, 0], levels[level, 1], levels[level, 2]
    at, right, below, fx, fy = _bilinear_cell(start, width, height, u, v)
    r0, r1 = linear[texels[at, 0]], linear[texels[at + below, 0]]
    g0, g1 = linear[texels[at, 1]], linear[texels[at + below, 1]]
    b0, b1 = linear[texels[at, 2]], linear[texels[at + below, 2]]
    r0 += fx * (linear[texels[at + right, 0]] - r0)
    g0 += fx * (linear[texels[at + right, 1]] - g0)
    b0 += fx * (linear[texels[at + right, 2]] - b0)
    r1 += fx * (linear[texels[at + below + right, 0]] - r1)
    g1 += fx * (linear[texels[at + below + right, 1]] - g1)
    b1 += fx * (linear[texels[at + below + right, 2]] - b1)
    return r0 + fy * (r1 - r0), g0 + fy * (g1 - g0), b0 + fy * (b1 - b0)


@njit_helper
def _wrap(u, repeats):
    """Return the position within one copy of a repeated texture."""
    return u - math.floor(u) if repeats > 1 else u


@njit_helper
def _filtered(textures, texture, u, v, ux, vx, uy, vy):
    """Return the mean light of a texture over the parallelogram with sides (ux, vx), (uy, vy) about (u, v).

    Anisotropic filtering: two rows of samples along the longer side, each in the mipmap level of half the shorter side.
    Their mean is close to that of the area; one row would blur or alias.
    """
    tables, levels = textures.tables, textures.levels
    first, count, columns, rows = tables[texture, 0], tables[texture, 1], tables[texture, 2], tables[texture, 3]
    width, height = levels[first, 1], levels[first, 2]
    u, ux, uy, v, vx, vy = u * columns, ux * columns, uy * columns, v * rows, vx * rows, vy * rows
    a = math.sqrt((ux * width) ** 2 + (vx * height) ** 2)
    b = math.sqrt((uy * width) ** 2 + (vy * height) ** 2)
    if a < b:
        a, b, ux, vx, uy, vy = b, a, uy, vy, ux, vx
    a, b = a * FOOTPRINT_SCALE, b * FOOTPRINT_SCALE
    if not a > 1.0:
        return _texel(textures, first, _wrap(u, columns), _wrap(v, rows))
    across = ROWS if b > 1.0 else 1
    probes = int(min(math.ceil(across * a / max(b, 1.0)), MAX_PROBES))
    level = max(0.0, math.log2(max(b / across, a / probes)))
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


@njit_helper
def _light(world, face, u, v):
    """Interpolate the precomputed light on a face bilinearly."""
    start, width, height = world.faces[face, 1], world.faces[face, 2], world.faces[face, 3]
    at, right, below, fx, fy = _bilinear_cell(start, width, height, u, v)
    light = world.light
    above = light[at] + fx * (light[at + right] - light[at])
    under = light[at + below] + fx * (light[at + below + right] - light[at + below])
    return above + fy * (under - above)


@njit_helper
def _chart_step(m, kind, face, x, y, z, u, v, step):
    """Return the change of (u, v) for a step (x, y, z) along a face."""
    sx, sy, sz = to_local(m, step[0], step[1], step[2])
    a, b = chart(kind, face, x + sx, y + sy, z + sz)
    a -= u
    if kind in (ELLIPSOID, CYLINDER):
        a -= np.rint(a)  # across the seam
    return a, b - v


@njit_helper
def _surface_step(t, d, n, origin_step, bearing_step):
    """Return the displacement of a hit on its face from a ray to a neighbouring ray (ray differential)."""
    sx = origin_step[0] + t * bearing_step[0]
    sy = origin_step[1] + t * bearing_step[1]
    sz = origin_step[2] + t * bearing_step[2]
    slope = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    slope = slope if abs(slope) > 1e-3 else 1e-3
    back = (n[0] * sx + n[1] * sy + n[2] * sz) / slope
    return sx - back * d[0], sy - back * d[1], sz - back * d[2]


@njit_helper
def _sky(world, d, dx, dy):
    """Return the light (r, g, b) of the sky; dx and dy are differences to the bearings right and below."""
    if world.sky < 0:
        return 0.0, 0.0, 0.0
    u, v = chart(ELLIPSOID, 0, d[0], d[1], d[2])
    wide = _norm(dx) / (2 * math.pi * max(math.sqrt(d[0] * d[0] + d[2] * d[2]), 1e-3))
    return _filtered(world.textures, world.sky, u, v, wide, 0.0, 0.0, _norm(dy) / math.pi)


@njit_helper
def _radiance(world, t, solid, face, o, d, ox, dx, oy, dy, shade):
    """Return the light (r, g, b) of the hit of a ray, and the solid that shades it from the sun, else -1.

    ox, dx, oy, dy are differences to the rays right and below; `shade` is a solid that is likely to shade it.
    """
    m, kind = world.tree.local_from_world[solid], world.tree.kinds[solid]
    px, py, pz = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
    x, y, z = to_local(m, px, py, pz)
    x, y, z = x + m[0, 3], y + m[1, 3], z + m[2, 3]
    u, v = chart(kind, face, x, y, z)
    n = world_normal(world, solid, face, x, y, z)
    row = world.first_face[solid] + face
    ux, vx = _chart_step(m, kind, face, x, y, z, u, v, _surface_step(t, d, n, ox, dx))
    uy, vy = _chart_step(m, kind, face, x, y, z, u, v, _surface_step(t, d, n, oy, dy))
    r, g, b = _filtered(world.textures, world.faces[row, 0], u, v, ux, vx, uy, vy)
    light = float(_light(world, row, u, v))
    sun = world.sun
    if not sun[3] > 0:
        return r * light, g * light, b * light, -1
    shine, shader = 0.0, shade
    # A rectangle has two sides.
    side = -1.0 if kind == RECTANGLE and n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0 else 1.0
    facing = side * (n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2])
    if facing > 0:
        lift = side * SHADOW_OFFSET_M
        sx, sy, sz = px + lift * n[0], py + lift * n[1], pz + lift * n[2]
        shader = first_hit(world.tree, sx, sy, sz, sun[0], sun[1], sun[2], 1e-6, np.inf, shade, True)[1]
        if shader < 0:
            shine = sun[3] * facing
    r *= light * SKYLIGHT[0] + shine * SUNLIGHT[0]
    g *= light * SKYLIGHT[1] + shine * SUNLIGHT[1]
    b *= light * SKYLIGHT[2] + shine * SUNLIGHT[2]
    return r, g, b, shader


@njit_helper
def _norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@njit_helper
def _rotate(rotation, v):
    return (
        rotation[0, 0] * v[0] + rotation[0, 1] * v[1] + rotation[0, 2] * v[2],
        rotation[1, 0] * v[0] + rotation[1, 1] * v[1] + rotation[1, 2] * v[2],
        rotation[2, 0] * v[0] + rotation[2, 1] * v[1] + rotation[2, 2] * v[2],
    )


@njit_helper
def _subtract(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit_helper
def _neighbour(i, samples, end):
    """Return the index of a neighbouring ray, in the same pixel if possible, so that windows do not change results."""
    if samples > 1:
        return i + 1 if (i + 1) % samples else i - 1
    return i + 1 if i + 1 < end else i - 1 if i > 0 else i


@njit_driver
def render_rows(world, origins, bearings, rotations, translations, samples, image, first, last):
    """Render rows first to last of image (H, W, 3), with samples x samples rays per pixel.

    Rays (H samples, W samples, 3) are in the camera frame. Each pixel row has its own pose world_from_cam: rotations
    (H, 3, 3), translations (H, 3). NaN rays are black.
    """
    height, width = bearings.shape[0], bearings.shape[1]
    tree = world.tree
    for row in range(first, last):
        turn, eye = rotations[row], translations[row]
        # Neighbouring rays mostly hit, and are shaded by, the same solid.
        solid = shade = -1
        for column in range(image.shape[1]):
            r = g = b = 0.0
            for j in range(row * samples, (row + 1) * samples):
                for i in range(column * samples, (column + 1) * samples):
                    bearing = bearings[j, i]
                    if bearing[0] != bearing[0]:
                        continue
                    d, o = _rotate(turn, bearing), _rotate(turn, origins[j, i])
                    across, down = _neighbour(i, samples, width), _neighbour(j, samples, height)
                    dx = _subtract(_rotate(turn, bearings[j, across]), d)
                    dy = _subtract(_rotate(turn, bearings[down, i]), d)
                    ox = _subtract(_rotate(turn, origins[j, across]), o)
                    oy = _subtract(_rotate(turn, origins[down, i]), o)
                    # At the edge of the view one neighbour may be invalid: use the other one.
                    if dx[0] != dx[0]:
                        dx, ox = dy, oy
                    if dy[0] != dy[0]:
                        dy, oy = dx, ox
                    if dx[0] != dx[0]:
                        dx = dy = ox = oy = (0.0, 0.0, 0.0)
                    o = (o[0] + eye[0], o[1] + eye[1], o[2] + eye[2])
                    t, solid, face = first_hit(tree, o[0], o[1], o[2], d[0], d[1], d[2], 1e-9, np.inf, solid, False)
                    if solid < 0:
                        cr, cg, cb = _sky(world, d, dx, dy)
                    else:
                        cr, cg, cb, shade = _radiance(world, t, solid, face, o, d, ox, dx, oy, dy, shade)
                    r, g, b = r + cr, g + cg, b + cb
            count = samples * samples
            image[row, column, 0], image[row, column, 1], image[row, column, 2] = r / count, g / count, b / count


@njit_driver
def precompute_light(world, world_from_local, spots, directions, lamps, ambient, reach, light, first, last):
    """Compute rows first to last of the light at samples (N, 4): solid, face, u, v.

    Ambient light is reduced by solids within `reach` (ambient occlusion), sampled by cosine-weighted directions (K, 3)
    about z. Lamps (M, 4), position and strength, shine downwards with the inverse square of the distance.
    """
    for i in range(first, last):
        solid, face = int(spots[i, 0]), int(spots[i, 1])
        x, y, z = place(world.tree.kinds[solid], face, spots[i, 2], spots[i, 3])
        nx, ny, nz = world_normal(world, solid, face, x, y, z)
        m = world_from_local[solid]
        px, py, pz = to_local(m, x, y, z)
        px, py, pz = (
            px + m[0, 3] + SHADOW_OFFSET_M * nx,
            py + m[1, 3] + SHADOW_OFFSET_M * ny,
            pz + m[2, 3] + SHADOW_OFFSET_M * nz,
        )
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
            t, _, _ = first_hit(world.tree, px, py, pz, dx, dy, dz, 1e-6, np.inf, -1, False)
            total += t / (t + reach) if t < np.inf else 1.0
        total *= ambient / len(directions)
        for k in range(len(lamps)):
            lx, ly, lz = lamps[k, 0] - px, lamps[k, 1] - py, lamps[k, 2] - pz
            far = math.sqrt(lx * lx + ly * ly + lz * lz)
            lx, ly, lz = lx / far, ly / far, lz / far
            # Cosine at the lamp, which shines down (+y).
            facing = (lx * nx + ly * ny + lz * nz) * max(-ly, 0.0)
            if facing > 0 and first_hit(world.tree, px, py, pz, lx, ly, lz, 1e-6, far - 1e-3, -1, True)[1] < 0:
                total += lamps[k, 3] * facing / (far * far)
        light[i] = total
