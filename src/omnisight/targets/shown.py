"""What the lens or the mirror shows in a set of pictures: the same in all, so it is learned from some of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.images import ImageField, estimate_field, read_image, to_gray8
from omnisight.images.ellipse import Ellipse

from .cache import cache_key, load_entry, save_entry

_ENOUGH = 16
"""Pictures that tell it."""


def shown_field(paths: Sequence[Path], keys: Sequence[str], *, apply_exif: bool, cache: bool) -> ImageField | None:
    """Give the image circle or the mirror's borders; None without pictures.

    Parameters
    ----------
    paths : sequence of Path
        Pictures of one camera and one size, which can be read.
    keys : sequence of str
        Digest of each, by which the result is remembered.
    apply_exif, cache : bool
        As in `find_boards`.
    """
    if not paths:
        return None
    chosen = np.unique(np.linspace(0, len(paths) - 1, min(_ENOUGH, len(paths))).round().astype(int))
    key = cache_key(b"", "field", *(keys[i] for i in chosen))
    entry = load_entry(key) if cache else None
    field = None if entry is None else _from_entry(entry)
    if field is None:

        def pictures() -> Iterator[Any]:
            for i in chosen:
                yield to_gray8(read_image(paths[i], apply_exif=apply_exif))

        field = estimate_field(pictures())
        if cache:
            save_entry(key, asdict(field))
    return field


def _from_entry(entry: dict[str, Any]) -> ImageField | None:
    """Rebuild it; None if the entry is not what was written."""
    try:
        width, height = (int(length) for length in entry["size"])
        outer, inner = (_ellipse(entry[name]) for name in ("outer", "inner"))
        return ImageField((width, height), outer, inner, float(entry["outer_fade"]), float(entry["inner_fade"]))
    except (KeyError, TypeError, ValueError):
        return None


def _ellipse(entry: dict[str, Any] | None) -> Ellipse | None:
    if entry is None:
        return None
    (u, v), (a, b) = entry["centre"], entry["axes"]
    return Ellipse((float(u), float(v)), (float(a), float(b)), float(entry["angle"]))
