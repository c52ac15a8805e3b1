"""What the lens or the mirror shows in a set of images: the same in all, so it is learned from some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import ImageField, estimate_image_field, read_image, downsample, to_gray8
from omnisight.images.ellipse import Ellipse

from .cache import cache_key, load_entry, save_entry
from .look import Look

_ENOUGH = 16
"""Images that tell it."""


def telling(count: int) -> NDArray[np.intp]:
    """Choose the images, of so many, that the field is learned from."""
    return np.unique(np.linspace(0, count - 1, min(_ENOUGH, count)).round().astype(np.intp))


def shown_field(paths: Sequence[Path], looks: Sequence[Look], *, apply_exif: bool, cache: bool) -> ImageField | None:
    """Give the image circle or the mirror's borders; None without images.

    Parameters
    ----------
    paths : sequence of Path
        Images of one camera and one size.
    looks : sequence of Look
        What was seen in each; the image is read again where it did not keep it.
    apply_exif, cache : bool
        As in `detect_boards`.
    """
    if not looks:
        return None
    key = cache_key(b"", "field", *(look.key for look in looks))
    entry = load_entry(key) if cache else None
    field = None if entry is None else _from_entry(entry)
    if field is None:
        field = estimate_image_field(_small(path, look, apply_exif) for path, look in zip(paths, looks, strict=True))
        field = field.resized(looks[0].size)
        if cache:
            save_entry(key, asdict(field))
    return field


def _small(path: Path, look: Look, apply_exif: bool) -> NDArray[np.uint8]:
    return downsample(to_gray8(read_image(path, apply_exif=apply_exif))) if look.small is None else look.small


def _from_entry(entry: dict[str, Any]) -> ImageField | None:
    """Rebuild it; None if the entry is not what was written."""
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
