"""Convert the corners of files to detections; leave out what cannot be used and note it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.corners._protocol import Array, ImageCorners
from omnisight.corners._target_points import (
    MIN_CORNERS,
    is_degenerate,
    merge_points,
    neighbour_distance,
    normalize_frame,
)
from omnisight.images.headers import declared_size
from omnisight.targets import Detection, Detections, ImageDetection, PointTarget
from omnisight.targets.image_sizes import most_common_size, size_mismatch_note, sizes_note

Size = tuple[int, int]

# Fractions of corners outside the image above which the size is wrong, not the corners; the second if the size with
# width and height exchanged contains all of them.
MAX_OUTSIDE, MAX_OUTSIDE_IF_SWAPPED_FITS = 0.1, 0.005
# Largest fraction of images with a mirrored board that are left out; more are a property of the file.
MAX_MIRRORED = 0.25
# Corners of an image from which the side of its board is determined.
SIDE_SAMPLES = 60
# Repeated corners agree to this distance, px.
DUPLICATE_PX = 1e-4
HEADER_BYTES = 1_000_000  # of an image file, in which its size is stored


@dataclass
class _LeftOut:
    """Counts of corners that are left out, by reason."""

    counts: dict[str, int] = field(default_factory=dict[str, int])

    def add(self, reason: str, count: int) -> None:
        self.counts[reason] = self.counts.get(reason, 0) + int(count)

    def notes(self) -> list[str]:
        """Return a note for each reason."""
        return [f"{reason}: {count}" for reason, count in self.counts.items() if count]


def make_detections(
    images: Sequence[tuple[Path, ImageCorners]], *, in_metres: bool, square: float | None, size: Size | None
) -> Detections:
    """Return the detections of images, each a path and the corners of a target, as `read_corners` describes."""
    paths, given = [path for path, _ in images], [view for _, view in images]
    views = [_with_finite_points(view) for view in given]
    if not any(_is_detected(view).any() for view in views):
        raise ValueError("no corners in it")
    points, ids = merge_points(np.concatenate([view.points for view in views]))
    unit = neighbour_distance(points)
    points, notes = normalize_frame(points)
    scale = (square or 1.0) / unit if square is not None or not in_metres else 1.0
    target = PointTarget(scale * points, "m" if in_metres or square is not None else "squares")
    used, sizes = _image_sizes(paths, given, views, size)
    notes += filter(None, [sizes_note([(path.name, size) for path, size in sizes.items()], used)])
    _check_size(used, [v.pixels[_is_detected(v)] for path, v in zip(paths, views, strict=True) if sizes[path] == used])
    view_ids = np.split(ids, np.cumsum([len(view.points) for view in views])[:-1])
    left_out = _LeftOut()
    detections: dict[Path, ImageDetection] = {}
    for path, whole, view, own in zip(paths, given, views, view_ids, strict=True):
        if sizes[path] != used:
            detections[path] = ImageDetection(path, note=size_mismatch_note(sizes[path], used))
            continue
        image = detections.get(path, ImageDetection(path, used))
        board = _detection(view, own, used, left_out, len(whole.points) - len(view.points))
        if remark := _unusable(target.points[board.ids]):
            detections[path] = image.with_remark(remark) if len(whole.points) else image
        else:
            detections[path] = replace(image, boards=(*image.boards, board))
    kept, mirrored = _drop_mirrored(list(detections.values()), target)
    return Detections(target, kept, None, None, (*notes, *left_out.notes(), *mirrored))


def _with_finite_points(view: ImageCorners) -> ImageCorners:
    """Leave out corners whose board point is not finite."""
    finite = np.isfinite(view.points).all(1)
    covariance = None if view.covariance is None else view.covariance[finite]
    return replace(view, points=view.points[finite], pixels=view.pixels[finite], covariance=covariance)


def _is_detected(view: ImageCorners) -> NDArray[np.bool_]:
    """Return which corners (N,) are finite and not exactly (0, 0), which some programs write for a missing corner."""
    u, v = view.pixels.T
    detected = np.isfinite(u) & np.isfinite(v) & ((u != 0) | (v != 0))
    return detected if view.covariance is None else detected & np.isfinite(view.covariance).all((1, 2))


def _is_inside(pixels: Array, size: Size) -> NDArray[np.bool_]:
    """Return which pixels (N, 2) lie in an image."""
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = (pixels >= -0.5) & (pixels < np.array(size) - 0.5)
    return inside[:, 0] & inside[:, 1]


def _image_sizes(
    paths: Sequence[Path], given: Sequence[ImageCorners], views: Sequence[ImageCorners], specified: Size | None
) -> tuple[Size, dict[Path, Size]]:
    """Return the size in use and the size of each image: specified, of the file, or of the image beside it."""
    sizes = {
        path: specified or (view.size if all(view.size) else _size_of_image_file(path))
        for path, view in zip(paths, given, strict=True)
    }
    has_corners = dict.fromkeys(sizes, False)
    for path, view in zip(paths, views, strict=True):
        has_corners[path] |= len(view.points) > 0
    used = most_common_size([(size, has_corners[path]) for path, size in sizes.items() if all(size)])
    if used is None:
        far = np.nanmax(np.concatenate([view.pixels for view in views]), axis=0)
        raise ValueError(
            "the image size is in neither the file nor an image beside it: specify --image-size, such as 1280x800"
            f" (corners reach {far[0]:.0f}, {far[1]:.0f})"
        )
    return used, {path: size if all(size) else used for path, size in sizes.items()}


def _size_of_image_file(path: Path) -> Size:
    """Read the size of an image from its header; (0, 0) if there is none."""
    try:
        with path.open("rb") as file:
            return declared_size(file.read(HEADER_BYTES)) or (0, 0)
    except OSError:
        return (0, 0)


def _check_size(size: Size, detected: Sequence[Array]) -> None:
    """Raise ValueError if many corners lie outside images of this size."""
    pixels = np.concatenate([np.zeros((0, 2)), *detected])
    pixels = pixels[(pixels >= -0.5).all(1)]  # negative pixels are outside images of any size
    outside, outside_swapped = (_fraction_outside(pixels, sides) for sides in (size, (size[1], size[0])))
    if outside <= (MAX_OUTSIDE_IF_SWAPPED_FITS if outside_swapped == 0 else MAX_OUTSIDE):
        return
    (left, top), (right, bottom) = pixels.min(0), pixels.max(0)
    reason = (
        f"corners reach from ({left:.0f}, {top:.0f}) to ({right:.0f}, {bottom:.0f}), {outside:.0%} of them outside"
        f" images of {size[0]}x{size[1]}"
    )
    if outside_swapped <= MAX_OUTSIDE:
        raise ValueError(
            f"{reason}: either the size is height x width (specify --image-size {size[1]}x{size[0]}), or x and y of the"
            " corners are exchanged"
        )
    raise ValueError(f"{reason}: specify the --image-size of the images that the corners are from")


def _fraction_outside(pixels: Array, size: Size) -> float:
    return float((~_is_inside(pixels, size)).mean()) if len(pixels) else 0.0


def _detection(
    view: ImageCorners, ids: NDArray[np.intp], size: Size, left_out: _LeftOut, invalid_points: int
) -> Detection:
    """Return the usable corners of a view in the order of their points, and count the others."""
    detected = _is_detected(view)
    inside = detected & _is_inside(view.pixels, size)
    used = inside & _is_first(ids, view.pixels)
    left_out.add("corners that are not finite, or at (0, 0), left out", invalid_points + (~detected).sum())
    left_out.add("corners outside the image, left out", (detected & ~inside).sum())
    left_out.add("duplicate corners, left out", (inside & ~used).sum())
    order = np.argsort(ids[used], kind="stable")
    covariance = np.zeros((len(ids), 2, 2)) if view.covariance is None else view.covariance
    return Detection(ids[used][order].astype(np.int64), view.pixels[used][order], covariance[used][order])


def _is_first(ids: NDArray[np.intp], pixels: Array) -> NDArray[np.bool_]:
    """Return which corners (N,) do not repeat the same point at the same pixel."""
    _, first = np.unique(np.column_stack([ids, np.round(pixels / DUPLICATE_PX)]), axis=0, return_index=True)
    is_first = np.zeros(len(ids), bool)
    is_first[first] = True
    return is_first


def _unusable(points: Array) -> str:
    """Return why no pose follows from these points of the target, or an empty text."""
    if len(points) < MIN_CORNERS:
        return f"{len(points)} corners, at least {MIN_CORNERS} are needed: left out"
    return "all corners on one line: left out" if is_degenerate(points) else ""


def _drop_mirrored(images: list[ImageDetection], target: PointTarget) -> tuple[list[ImageDetection], list[str]]:
    """Leave out the few images that show a flat target from behind, as if x and y were exchanged, and note them."""
    if target.points[:, 2].any():
        return images, []
    sides = {image.path: _side(image.boards[0], target) for image in images if image.boards}
    minority = min((1, -1), key=lambda side: sum(s == side for s in sides.values()))
    mirrored = [path for path, side in sides.items() if side == minority]
    if not mirrored:
        return images, []
    names = ", ".join([path.name for path in mirrored[:3]] + ["..."] * (len(mirrored) > 3))
    note = (
        f"images that show the board from behind: {len(mirrored)} of {len(sides)} ({names}); are x and y, or the order"
        " of points, exchanged?"
    )
    if len(mirrored) > MAX_MIRRORED * len(sides):
        return images, [note]
    reason = "shows the board from behind: left out"
    kept = [ImageDetection(i.path, i.size, note=reason) if i.path in mirrored else i for i in images]
    return kept, [f"{note} Left out"]


def _side(detection: Detection, target: PointTarget) -> int:
    """Return the side from which a flat target is seen: the sign of the area of its triangles in the image."""
    from scipy.spatial import Delaunay, QhullError

    subset = slice(None, None, 1 + len(detection) // SIDE_SAMPLES)
    points, pixels = target.points[detection.ids[subset], :2], detection.pixels[subset]
    try:
        triangles = Delaunay(points).simplices
    except QhullError:  # the subset is collinear
        return 1
    signs = _area(points[triangles]) * _area(pixels[triangles])
    return 1 if np.count_nonzero(signs > 0) >= np.count_nonzero(signs < 0) else -1


def _area(triangles: Array) -> Array:
    """Return twice the signed area of triangles (N, 3, 2)."""
    (a, b), (c, d) = (triangles[:, k].T - triangles[:, 0].T for k in (1, 2))
    return a * d - b * c
