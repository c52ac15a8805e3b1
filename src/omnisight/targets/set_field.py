"""Image field of a set of images: it is the same in all, so it is estimated from a sample."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import ImageField, downsample, estimate_image_field, to_gray8
from omnisight.images.ellipse import Ellipse
from omnisight.targets.cache import cache_key, load_entry, save_entry
from omnisight.targets.raw_detections import RawDetections

ReadImage = Callable[[Path], NDArray[Any]]

# Images from which the field is estimated: more do not change it.
MAX_SAMPLES = 16


def sample_indices(count: int) -> NDArray[np.intp]:
    """Return the indices of the images, of so many, that the field is estimated from."""
    return np.unique(np.linspace(0, count - 1, min(MAX_SAMPLES, count)).round().astype(np.intp))


def estimate_set_field(
    images: Sequence[tuple[Path, RawDetections]], read: ReadImage, *, cache: bool
) -> ImageField | None:
    """Estimate the image circle or the mirror's boundaries from images of one camera and size; None without images.

    An image is read again if its detections came from the cache.
    """
    if not images:
        return None
    images = [images[i] for i in sample_indices(len(images))]
    key = cache_key(b"", "field", *(raw.key for _, raw in images))
    entry = load_entry(key) if cache else None
    field = None if entry is None else _from_entry(entry)
    if field is None:
        field = estimate_image_field(_thumbnail(path, raw, read) for path, raw in images)
        field = field.resized(images[0][1].size)
        if cache:
            save_entry(key, asdict(field))
    return field


def _thumbnail(path: Path, raw: RawDetections, read: ReadImage) -> NDArray[np.uint8]:
    return downsample(to_gray8(read(path))) if raw.thumbnail is None else raw.thumbnail


def _from_entry(entry: dict[str, Any]) -> ImageField | None:
    """Rebuild an entry; None if it is malformed."""
    try:
        width, height = (int(length) for length in entry["size"])
        outer, inner = (_ellipse(entry[name]) for name in ("outer", "inner"))
        return ImageField((width, height), outer, inner, float(entry["outer_fade"]), float(entry["inner_fade"]))
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _ellipse(entry: dict[str, Any] | None) -> Ellipse | None:
    if entry is None:
        return None
    (u, v), (a, b) = entry["centre"], entry["axes"]
    ellipse = Ellipse((float(u), float(v)), (float(a), float(b)), float(entry["angle"]))
    if not (min(ellipse.axes) > 0 and np.isfinite((*ellipse.centre, *ellipse.axes, ellipse.angle)).all()):
        raise ValueError("not an ellipse")
    return ellipse
