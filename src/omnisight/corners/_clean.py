"""What can be used of corners that something else found, and what is said of the rest."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.corners._protocol import Array, Seen
from omnisight.images.headers import declared_size
from omnisight.targets import Detection, Detections, ImageDetection, PointTarget
from omnisight.targets.sizes import misfit, sizes_note, used_size

# Corners that a pose needs.
FEWEST = 6
# Part of the corners outside of the images from which on the size is wrong, not the corners; less, where the size
# turned round holds all of them.
OUTSIDE, SOME = 0.1, 0.005
# Part of its points' spread that a target is thick across a line, where it is no line.
THICK = 1e-3
# Points this near each other, over the size of the target, are one.
SAME = 1e-7
# Times its size that a target may lie from the origin of its points: farther, the origin moves to its middle.
FAR = 10.0
# Part of its spread that a target may stand off a plane to be flat.
FLAT = 1e-6
# Part of the images that may show a flat target from its other side and be left out for it.
TURNED = 0.25
# Corners of an image that tell from which side it shows its target.
TELLING = 60
HEADER = 1_000_000  # bytes of an image in which its size stands


def found_in(
    seen: Sequence[tuple[Path, Seen]], *, metres: bool, square: float | None, size: tuple[int, int] | None
) -> Detections:
    """Give the search of images, each a path and a target seen in it, as `read_corners` describes it."""
    kept = [_on_target(view) for _, view in seen]
    points = np.concatenate([view.points for view in kept] or [np.zeros((0, 3))])
    if not any(_known(view).any() for view in kept):
        raise ValueError("no corners in it")
    target, ids = _joined(points)
    step = _step(target)
    scale = (square or 1.0) / step if square is not None or not metres else 1.0
    target, notes = _placed(target)
    given = PointTarget(scale * target, "m" if metres or square is not None else "squares")
    splits = np.split(ids, np.cumsum([len(view.points) for view in kept])[:-1])
    used, sizes = _sizes([(path, view.size) for path, view in seen], kept, size)
    notes += filter(None, [sizes_note([(path.name, size) for path, size in sizes.items()], used)])
    _must_hold(used, [v.pixels[_known(v)] for (path, _), v in zip(seen, kept, strict=True) if sizes[path] == used])
    pictures: dict[Path, ImageDetection] = {}
    left = np.zeros(3, int)
    for (path, whole), view, own in zip(seen, kept, splits, strict=True):
        picture = pictures.setdefault(path, ImageDetection(path, used))
        if sizes[path] != used:
            pictures[path] = ImageDetection(path, note=misfit(sizes[path], used))
            continue
        known = _known(view)
        inside = known & _within(view.pixels, used)
        first = _first(own, view.pixels) & inside
        left += len(whole.points) - known.sum(), (known & ~inside).sum(), (inside & ~first).sum()
        detection = _detection(view, own, first)
        why = _unusable(given.points[detection.ids])
        if why:
            pictures[path] = picture.with_remark(why) if len(whole.points) else picture
            continue
        boards = (*picture.boards, detection)
        pictures[path] = ImageDetection(path, used, boards, note=picture.note, remark=picture.remark)
    listed, turned = _turned(list(pictures.values()), given)
    return Detections(given, listed, None, None, (*notes, *_left_out(*left.tolist()), *turned))


def _on_target(view: Seen) -> Seen:
    """Leave out points that are no numbers."""
    known = np.isfinite(view.points).all(1)
    covariance = None if view.covariance is None else view.covariance[known]
    return Seen(view.picture, view.points[known], view.pixels[known], covariance, view.size)


def _known(view: Seen) -> NDArray[np.bool_]:
    """Say which corners (N,) were found: they are numbers, and not at 0, 0 to the last digit."""
    u, v = view.pixels.T
    known = np.isfinite(u) & np.isfinite(v) & ((u != 0) | (v != 0))
    return known if view.covariance is None else known & np.isfinite(view.covariance).all((1, 2))


def _within(pixels: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Say which pixels (N, 2) lie in an image."""
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = (pixels >= -0.5) & (pixels < np.array(size) - 0.5)
    return inside[:, 0] & inside[:, 1]


def _joined(points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Give the points of the target (K, 3), each once, and which of them each of the given ones (N, 3) is."""
    grain = SAME * max(float(np.abs(points).max()), 1e-300)
    _, first, ids = np.unique(np.round(points / grain), axis=0, return_index=True, return_inverse=True)
    # As they came: rows of a board stay rows.
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    return points[first[order]], rank[ids.reshape(-1)]


def _placed(points: Array) -> tuple[Array, list[str]]:
    """Give the points of the target near the origin, and those on one plane in z = 0; say what was moved."""
    middle = points.mean(0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    normal = axes[2]
    if points[:, 2].any() and float(np.abs((points - middle) @ normal).max()) < FLAT * spread[1]:
        if np.abs(points[:, 2]).max() < FLAT * spread[1]:
            return points * (1.0, 1.0, 0.0), []
        # The plane's x is that of the points, or y, as far as it lies in the plane.
        x = np.eye(3)[np.abs(normal).argmin()]
        x = x - (x @ normal) * normal
        across = np.stack([x, np.cross(normal, x)]) / np.linalg.norm(x)
        flat = np.concatenate([(points - middle) @ across.T, np.zeros((len(points), 1))], 1)
        return flat, ["the points lie on a plane that is not z = 0: poses are those of that plane, about their middle"]
    if np.linalg.norm(middle) > FAR * np.linalg.norm(np.ptp(points, axis=0)):
        return points - middle, ["the points lie far from their origin: poses are those of their middle"]
    return points, []


def _step(points: Array) -> float:
    """Give the distance between neighbouring points: the middle one of those from each to its nearest."""
    from scipy.spatial import KDTree

    if len(points) < FEWEST:
        raise ValueError(f"{len(points)} different points on the target; {FEWEST} are the least")
    distances, _ = KDTree(points).query(points, k=2)
    return float(np.median(distances[:, 1]))


def _sizes(
    given: Sequence[tuple[Path, tuple[int, int]]], views: Sequence[Seen], told: tuple[int, int] | None
) -> tuple[tuple[int, int], dict[Path, tuple[int, int]]]:
    """Give the size that is used, and that of each image: told, of the file, or of the image beside it."""
    sizes = {path: told or (size if all(size) else _of_picture(path)) for path, size in given}
    shows = dict.fromkeys(sizes, False)
    for (path, _), view in zip(given, views, strict=True):
        shows[path] |= len(view.points) > 0
    used = used_size([(size, shows[path]) for path, size in sizes.items() if all(size)])
    if used is None:
        far = np.nanmax(np.concatenate([view.pixels for view in views]), axis=0)
        raise ValueError(
            f"does not say how large the images are, and none lies beside it: give --image-size, such as 1280x800"
            f" (corners reach {far[0]:.0f}, {far[1]:.0f})"
        )
    return used, {path: size if all(size) else used for path, size in sizes.items()}


def _of_picture(path: Path) -> tuple[int, int]:
    """Read the size of an image from its header; (0, 0) if there is none."""
    try:
        with path.open("rb") as file:
            return declared_size(file.read(HEADER)) or (0, 0)
    except OSError:
        return (0, 0)


def _must_hold(size: tuple[int, int], seen: Sequence[Array]) -> None:
    """Refuse a size that many of the corners lie outside of."""
    pixels = np.concatenate([np.zeros((0, 2)), *seen])
    pixels = pixels[(pixels >= -0.5).all(1)]  # less is no place in an image of any size
    outside, turned = (_outside(pixels, sides) for sides in (size, (size[1], size[0])))
    if outside <= (SOME if turned == 0 else OUTSIDE):
        return
    (left, top), (right, bottom) = pixels.min(0), pixels.max(0)
    said = (
        f"corners reach from ({left:.0f}, {top:.0f}) to ({right:.0f}, {bottom:.0f}), {outside:.0%} of them outside of"
        f" images of {size[0]}x{size[1]}"
    )
    if turned <= OUTSIDE:
        raise ValueError(
            f"{said}: either the size is height x width (give --image-size {size[1]}x{size[0]}), or x and y of the"
            " corners are exchanged"
        )
    raise ValueError(f"{said}: give the --image-size of the images that the corners are from")


def _outside(pixels: Array, size: tuple[int, int]) -> float:
    return float((~_within(pixels, size)).mean()) if len(pixels) else 0.0


def _first(ids: NDArray[np.intp], pixels: Array) -> NDArray[np.bool_]:
    """Say which corners (N,) are no repetition of one before: the same point at the same place."""
    _, first = np.unique(np.column_stack([ids, np.round(pixels * 1e4)]), axis=0, return_index=True)
    found = np.zeros(len(ids), bool)
    found[first] = True
    return found


def _detection(view: Seen, ids: NDArray[np.intp], used: NDArray[np.bool_]) -> Detection:
    order = np.argsort(ids[used], kind="stable")
    covariance = np.zeros((len(ids), 2, 2)) if view.covariance is None else view.covariance
    return Detection(ids[used][order].astype(np.int64), view.pixels[used][order], covariance[used][order])


def _unusable(points: Array) -> str:
    """Say why an image with these points of the target has no pose, or nothing."""
    if len(points) < FEWEST:
        return f"{len(points)} corners, {FEWEST} are the least: left out"
    thickness = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return "all corners on one line: left out" if thickness[1] < THICK * thickness[0] else ""


def _left_out(unknown: int, outside: int, repeated: int) -> list[str]:
    """Say what was left out of all images."""
    counts = {
        "corners that are no numbers, or at 0, 0, left out as not seen": unknown,
        "corners outside of the image, left out as not seen": outside,
        "corners listed twice, counted once": repeated,
    }
    return [f"{what}: {count}" for what, count in counts.items() if count]


def _turned(pictures: list[ImageDetection], target: PointTarget) -> tuple[list[ImageDetection], list[str]]:
    """Leave out the few images that show a flat target from its other side, as if x and y were exchanged; say so."""
    if target.points[:, 2].any():
        return pictures, []
    sides = {p.path: _side(p.boards[0], target) for p in pictures if p.boards}
    few = min((1, -1), key=lambda side: sum(s == side for s in sides.values()))
    odd = {path for path, side in sides.items() if side == few}
    if not odd:
        return pictures, []
    names = [path.name for path in sides if path in odd]
    which = f"{len(names)} of {len(sides)} ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
    said = f"images that show the board from its other side: {which}; are x and y, or the order of points, exchanged?"
    if len(odd) > TURNED * len(sides):
        return pictures, [said]
    why = "shows the board from its other side: left out"
    return [ImageDetection(p.path, p.size, note=why) if p.path in odd else p for p in pictures], [f"{said} Left out"]


def _side(detection: Detection, target: PointTarget) -> int:
    """Say from which side a flat target is seen: the sign of the area that its triangles have in the image."""
    from scipy.spatial import Delaunay, QhullError

    some = slice(None, None, 1 + len(detection) // TELLING)
    points, pixels = target.points[detection.ids[some], :2], detection.pixels[some]
    try:
        triangles = Delaunay(points).simplices
    except QhullError:  # those are on a line
        return 1
    turns = _area(points[triangles]) * _area(pixels[triangles])
    return 1 if np.count_nonzero(turns > 0) >= np.count_nonzero(turns < 0) else -1


def _area(triangles: Array) -> Array:
    (a, b), (c, d) = (triangles[:, k].T - triangles[:, 0].T for k in (1, 2))
    return a * d - b * c
