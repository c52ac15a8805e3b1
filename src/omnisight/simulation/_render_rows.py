"""Compiled rendering of image rows: all rays of a pixel are traced as a packet."""

# Compiled code takes its types from its arguments.
# pyright: basic

from functools import partial

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper, njit_inlined
from omnisight.simulation._packets import find_shadows, first_hits
from omnisight.simulation._shading import difference, fogged, footprint, sky_light, surface, texture_position


@njit_inlined
def _rotate(rotation, v, j, i):
    """Rotate v[j, i], (M, N, 3)."""
    x, y, z = v[j, i, 0], v[j, i, 1], v[j, i, 2]
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@njit_inlined
def _subtract(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit_inlined
def _store(array, r, v):
    array[r, 0], array[r, 1], array[r, 2] = v[0], v[1], v[2]


@njit_inlined
def _load(array, r):
    return array[r, 0], array[r, 1], array[r, 2]


@njit_helper
def _neighbour(i, samples, end):
    """Return the index of a neighbouring ray, in the same pixel if possible: windows do not change results."""
    if samples > 1:
        return i + 1 if (i + 1) % samples else i - 1
    return i + 1 if i + 1 < end else i - 1 if i > 0 else i


@njit_helper
def _gather(origins, bearings, turn, eye, pixel, samples, only, rays, places):
    """Store the valid rays (2, K, 3) of a pixel in the world, their rows and columns (K, 2); return their number."""
    count = 0
    for j in range(pixel[0] * samples, (pixel[0] + 1) * samples):
        for i in range(pixel[1] * samples, (pixel[1] + 1) * samples):
            number = (j - pixel[0] * samples) * samples + i - pixel[1] * samples
            if (only >= 0 and number != only) or bearings[j, i, 0] != bearings[j, i, 0]:
                continue
            d, o = _rotate(turn, bearings, j, i), _rotate(turn, origins, j, i)
            _store(rays[0], count, (o[0] + eye[0], o[1] + eye[1], o[2] + eye[2]))
            _store(rays[1], count, d)
            places[count, 0], places[count, 1] = j, i
            count += 1
    return count


@njit_helper
def _steps(origins, bearings, turn, j, i, samples):
    """Return the differences of origin and bearing to the ray right of a ray, and to the ray below."""
    across, down = _neighbour(i, samples, bearings.shape[1]), _neighbour(j, samples, bearings.shape[0])
    d, o = _rotate(turn, bearings, j, i), _rotate(turn, origins, j, i)
    dx = _subtract(_rotate(turn, bearings, j, across), d)
    dy = _subtract(_rotate(turn, bearings, down, i), d)
    ox = _subtract(_rotate(turn, origins, j, across), o)
    oy = _subtract(_rotate(turn, origins, down, i), o)
    # At the edge of the view one neighbour may be invalid: use the other one.
    if dx[0] != dx[0]:
        dx, ox = dy, oy
    if dy[0] != dy[0]:
        dy, oy = dx, ox
    if dx[0] != dx[0]:
        dx = dy = ox = oy = (0.0, 0.0, 0.0)
    return ox, dx, oy, dy


@njit_inlined
def _same_face(hits, a, b):
    return hits[a, 0] == hits[b, 0] and hits[a, 1] == hits[b, 1]


@partial(njit_driver, **STREAMLINED)
def render_rows(world, origins, bearings, rotations, translations, samples, only, image, scratch, first, last):
    """Render rows first to last of image (H, W, 3), with samples x samples rays per pixel, or with ray `only` of these.

    Rays (H samples, W samples, 3) are in the camera frame. Each pixel row has its own pose world_from_cam: rotations
    (H, 3, 3), translations (H, 3). NaN rays are black. `scratch` is what `render.scratch_arrays` returns.
    """
    rays, places, points, shadows, colors, distances, hits, hidden = scratch
    tree, textures, sun, tint = world.tree, world.textures, world.sun, world.colors
    for row in range(first, last):
        # Neighbouring pixels mostly show, and are shaded by, the same solid.
        guess = shade = -1
        for column in range(image.shape[1]):
            red = green = blue = 0.0
            turn, eye = rotations[row], translations[row]
            count = _gather(origins, bearings, turn, eye, (row, column), samples, only, rays, places)
            if count > 0:
                first_hits(tree, rays, count, guess, distances, hits)
                guess = hits[count - 1, 0]
            for r in range(count):
                if hits[r, 0] >= 0:
                    o, d = _load(rays[0], r), _load(rays[1], r)
                    place = texture_position(tree, distances[r], hits[r, 0], hits[r, 1], o, d)
                    points[r, 0], points[r, 1], points[r, 2], points[r, 3], points[r, 4] = place
            complete, lit = samples > 1 and count == samples * samples, 0
            for r in range(count):
                o, d = _load(rays[0], r), _load(rays[1], r)
                hit, solid = (distances[r], hits[r, 0], hits[r, 1]), hits[r, 0]
                place = points[r, 0], points[r, 1], points[r, 2], points[r, 3], points[r, 4]
                across, down = _neighbour(r, samples, count), r + samples if r + samples < count else r - samples
                if complete and solid >= 0 and _same_face(hits, r, across) and _same_face(hits, r, down):
                    # The hits of neighbouring rays are the sides of the footprint.
                    ux, vx = difference(tree, solid, place[3], place[4], points[across, 3], points[across, 4])
                    uy, vy = difference(tree, solid, place[3], place[4], points[down, 3], points[down, 4])
                else:
                    steps = _steps(origins, bearings, turn, places[r, 0], places[r, 1], samples)
                    if solid < 0:
                        cr, cg, cb = sky_light(world, textures, d, steps[1], steps[3])
                        red, green, blue = red + cr, green + cg, blue + cb
                        continue
                    ux, vx, uy, vy = footprint(world, tree, hit, place, d, steps)
                cr, cg, cb, light, facing, x, y, z = surface(world, tree, textures, hit, place, o, d, (ux, vx, uy, vy))
                if sun[3] > 0 and facing > 0:
                    _store(shadows[0], lit, (x, y, z))
                    _store(shadows[1], lit, (sun[0], sun[1], sun[2]))
                    _store(colors, lit, (cr, cg, cb))
                    colors[lit, 3], colors[lit, 4], colors[lit, 5] = light, facing, hit[0]
                    lit += 1
                    continue
                cr, cg, cb = _reflected(world.fog, tint, (cr, cg, cb), light, 0.0, hit[0])
                red, green, blue = red + cr, green + cg, blue + cb
            if lit > 0:
                shade = find_shadows(tree, shadows, lit, shade, hidden)
                for r in range(lit):
                    shine = 0.0 if hidden[r] else sun[3] * colors[r, 4]
                    cr, cg, cb = _reflected(world.fog, tint, _load(colors, r), colors[r, 3], shine, colors[r, 5])
                    red, green, blue = red + cr, green + cg, blue + cb
            total = 1 if only >= 0 else samples * samples
            _store(image[row], column, (red / total, green / total, blue / total))


@njit_inlined
def _reflected(fog, tint, albedo, light, shine, t):
    """Return the light (r, g, b) that a surface at a distance reflects, through the fog."""
    r = albedo[0] * (light * tint[1, 0] + shine * tint[0, 0])
    g = albedo[1] * (light * tint[1, 1] + shine * tint[0, 1])
    b = albedo[2] * (light * tint[1, 2] + shine * tint[0, 2])
    return fogged(fog, r, g, b, t) if fog[0] > 0 else (r, g, b)
