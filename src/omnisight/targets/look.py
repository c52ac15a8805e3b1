"""What one image file shows, whichever board is asked for; remembered between runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import decode_image, exif_orientation, read_bytes, downsample, to_gray8

from .boards import Board
from .boards.checkerboard import Checkerboard
from .cache import cache_key, load_entry, save_entry
from .detection import Detection
from .grids.grid import ENDS, Grid
from .grids.search import DETECTOR_VERSION, find_grids

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen in an image.

    Attributes
    ----------
    size : (int, int)
        Width and height, px.
    grids : tuple of Grid
        Checkerboard grids of any size; none were looked for where the board has markers or circles.
    boards : tuple of Detection
        Boards with markers or circles.
    sharpness : float
        Laplacian energy over contrast energy, where there is a board on it: to be compared within one set.
    exposure : float
        Gray level of the brightest quarter of that part: 255 is overexposed.
    orientation : int
        The EXIF orientation, 1 to 8.
    key : str
        Digest of the file's content and of how it was read.
    small : (h, w) array of uint8 or None
        The image averaged down, if it was asked for and had to be read.
    """

    size: tuple[int, int]
    grids: tuple[Grid, ...]
    boards: tuple[Detection, ...]
    sharpness: float
    exposure: float
    orientation: int
    key: str
    small: NDArray[np.uint8] | None = None


def look_at(path: Path, board: Board | None, *, apply_exif: bool, cache: bool, keep: bool = False) -> Look:
    """Read an image file and find what it shows; `keep` it small, if it has to be read.

    Raises
    ------
    UnreadableImage
        If it cannot be read.
    """
    data = read_bytes(path)
    orientation = exif_orientation(data)
    asked = None if board is None or isinstance(board, Checkerboard) else board
    key = cache_key(data, None if asked is None else asked.to_dict(), apply_exif, DETECTOR_VERSION)
    entry = load_entry(key) if cache else None
    look = None if entry is None else _from_entry(entry, orientation, key)
    if look is None:
        gray = to_gray8(decode_image(data, path.name, apply_exif=apply_exif))
        look = _look(gray, asked, orientation, key)
        if cache:
            save_entry(key, _to_entry(look))
        if keep:
            look = replace(look, small=downsample(gray))
    return look


def _look(gray: NDArray[np.uint8], asked: Board | None, orientation: int, key: str) -> Look:
    grids, boards = look_in(gray, asked)
    size = (gray.shape[1], gray.shape[0])
    found = [grid.pixels[grid.there] for grid in grids] + [board.pixels for board in boards]
    part = gray
    if found:
        (left, top), (right, bottom) = found[0].min(axis=0), found[0].max(axis=0)
        part = gray[max(int(top), 0) : int(bottom) + 2, max(int(left), 0) : int(right) + 2]
    return Look(size, grids, boards, _sharpness(part), float(np.percentile(part, 75)), orientation, key)


def look_in(gray: NDArray[np.uint8], asked: Board | None) -> tuple[tuple[Grid, ...], tuple[Detection, ...]]:
    """Give the checkerboard grids of any size in an image or, where another board is asked for, where that is."""
    return (tuple(find_grids(gray)), ()) if asked is None else ((), tuple(asked.detect(gray)))


def _sharpness(gray: NDArray[np.uint8]) -> float:
    import cv2

    return float(cv2.Laplacian(gray, cv2.CV_32F).var() / max(float(gray.var()), 1.0))


def _to_entry(look: Look) -> dict[str, Any]:
    return {
        "size": look.size,
        "grids": [
            {
                "pixels": np.where(grid.there[..., None], grid.pixels, -1e9).tolist(),
                "covariance": np.nan_to_num(grid.covariance).tolist(),
                "dark": grid.dark,
                "ends": grid.ends,
                "contrast": grid.contrast,
                "white": grid.white,
                "blur": grid.blur,
            }
            for grid in look.grids
        ],
        "boards": [
            {
                "ids": b.ids.tolist(),
                "pixels": b.pixels.tolist(),
                "covariance": b.covariance.tolist(),
                "located": b.located,
                "note": b.note,
            }
            for b in look.boards
        ],
        "sharpness": look.sharpness,
        "exposure": look.exposure,
    }


def _from_entry(entry: dict[str, Any], orientation: int, key: str) -> Look | None:
    """Rebuild what was seen; None if the entry is not what was written."""
    try:
        width, height = (int(length) for length in entry["size"])
        grids = tuple(_grid(g) for g in entry["grids"])
        boards = tuple(
            Detection(
                np.array(b["ids"], np.int64),
                np.array(b["pixels"], np.float64),
                np.array(b["covariance"], np.float64),
                bool(b["located"]),
                str(b["note"]),
            )
            for b in entry["boards"]
        )
        if min(width, height) < 1 or not all(_usable(board) for board in boards):
            return None
        return Look(
            (width, height), grids, boards, float(entry["sharpness"]), float(entry["exposure"]), orientation, key
        )
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        return None


def _usable(board: Detection) -> bool:
    return bool(np.isfinite(board.pixels).all() and np.isfinite(board.covariance).all() and (board.ids >= 0).all())


def _grid(entry: dict[str, Any]) -> Grid:
    pixels, covariance = np.array(entry["pixels"], np.float64), np.array(entry["covariance"], np.float64)
    ends = tuple(entry["ends"])
    shaped = pixels.ndim == 3 and pixels.shape[2] == 2 and covariance.shape == (*pixels.shape, 2)
    if not shaped or len(ends) != len(ENDS) or not np.isfinite(pixels).all():
        raise ValueError("not a grid")
    missing = pixels[..., 0] < -1e8
    pixels[missing], covariance[missing] = np.nan, np.nan
    return Grid(
        pixels, covariance, bool(entry["dark"]), ends, *(float(entry[k]) for k in ("contrast", "white", "blur"))
    )
