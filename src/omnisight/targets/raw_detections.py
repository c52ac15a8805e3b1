"""Detections in one image file before the board is known, cached between runs."""

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import decode_image, downsample, exif_orientation, to_gray8
from omnisight.images.interlacing import deinterlace
from omnisight.targets.boards import Board
from omnisight.targets.boards.checkerboard import Checkerboard
from omnisight.targets.cache import cache_key, load_entry, save_entry
from omnisight.targets.detections import Detection
from omnisight.targets.detectors import detect
from omnisight.targets.detectors.checkerboard.corner_grid import CornerGrid
from omnisight.targets.detectors.checkerboard.grid_search import find_grids
from omnisight.targets.drawn_corners import has_drawn_corners

# Part of the keys of cached detections: increase it whenever detections change.
DETECTOR_VERSION = 8


@dataclass(frozen=True, eq=False)
class RawDetections:
    """Detections in one image file.

    Attributes
    ----------
    size : (int, int)
        Width and height, px.
    grids : tuple of CornerGrid
        Checkerboard grids of any size; empty if the board has markers or circles.
    boards : tuple of Detection
        Boards with markers or circles.
    sharpness : float
        Laplacian energy over contrast energy on the board, to be compared within one set.
    exposure : float
        Gray level of the brightest quarter of that part: 255 is overexposed.
    orientation : int
        The EXIF orientation, 1 to 8.
    interlaced : bool
        Whether the image is interlaced, and its first field was used.
    drawn_on : bool
        Whether detected corners were drawn onto the image.
    key : str
        Digest of the file's content and of how it was read.
    thumbnail : (h, w) array of uint8 or None
        The downsampled image, if it was requested and the file had to be decoded.
    """

    size: tuple[int, int]
    grids: tuple[CornerGrid, ...]
    boards: tuple[Detection, ...]
    sharpness: float
    exposure: float
    orientation: int
    interlaced: bool
    drawn_on: bool
    key: str
    thumbnail: NDArray[np.uint8] | None = None

    def to_json(self) -> str:
        """Return the detections without the thumbnail as the content of a file."""
        return json.dumps({"orientation": self.orientation, "key": self.key, "entry": _to_entry(self)})

    @classmethod
    def from_json(cls, text: str | bytes) -> "RawDetections":
        """Return the detections of a file that `to_json` wrote; raise ValueError if it is damaged."""
        values = json.loads(text)
        raw = _from_entry(values["entry"], int(values["orientation"]), str(values["key"]))
        if raw is None:
            raise ValueError("the detections are damaged")
        return raw


def detect_in_file(
    data: bytes, name: str, board: Board | None, *, apply_exif: bool, cache: bool, keep_thumbnail: bool = False
) -> RawDetections:
    """Detect boards in the bytes of an image file; error messages start with `name`.

    Raises
    ------
    UnreadableImage
        If it cannot be decoded.
    """
    orientation = exif_orientation(data)
    # The same grids serve all checkerboards.
    board = None if isinstance(board, Checkerboard) else board
    key = cache_key(data, board and board.to_dict(), apply_exif, DETECTOR_VERSION)
    entry = load_entry(key) if cache else None
    raw = None if entry is None else _from_entry(entry, orientation, key)
    if raw is None:
        image = decode_image(data, name, apply_exif=apply_exif)
        raw = _detect_in_image(image, board, orientation, key)
        if cache:
            save_entry(key, _to_entry(raw))
        if keep_thumbnail:
            raw = replace(raw, thumbnail=downsample(to_gray8(image)))
    return raw


def grids_or_boards(
    gray: NDArray[np.uint8], board: Board | None
) -> tuple[tuple[CornerGrid, ...], tuple[Detection, ...]]:
    """Return the checkerboard grids of any size in an image or, if the board is of another kind, its detections."""
    if board is None or isinstance(board, Checkerboard):
        return tuple(find_grids(gray)), ()
    return (), tuple(detect(gray, board))


def _detect_in_image(image: NDArray[Any], board: Board | None, orientation: int, key: str) -> RawDetections:
    import cv2

    frame = to_gray8(image)
    gray = deinterlace(frame)
    grids, boards = grids_or_boards(gray, board)
    pixels = [grid.pixels[grid.present] for grid in grids] + [b.pixels for b in boards]
    part = gray
    if pixels:
        (left, top), (right, bottom) = pixels[0].min(axis=0), pixels[0].max(axis=0)
        part = gray[max(int(top), 0) : int(bottom) + 2, max(int(left), 0) : int(right) + 2]
    sharpness = float(cv2.Laplacian(part, cv2.CV_32F).var() / max(float(part.var()), 1.0))
    size = (gray.shape[1], gray.shape[0])
    exposure = float(np.percentile(part, 75))
    drawn_on = bool(pixels) and has_drawn_corners(image, np.concatenate(pixels))
    return RawDetections(size, grids, boards, sharpness, exposure, orientation, gray is not frame, drawn_on, key)


def _to_entry(raw: RawDetections) -> dict[str, Any]:
    return {
        "size": raw.size,
        "grids": [_grid_entry(grid) for grid in raw.grids],
        "boards": [
            {
                "ids": b.ids.tolist(),
                "pixels": b.pixels.tolist(),
                "covariance": b.covariance.tolist(),
                "located": b.located,
                "note": b.note,
            }
            for b in raw.boards
        ],
        "sharpness": raw.sharpness,
        "exposure": raw.exposure,
        "interlaced": raw.interlaced,
        "drawn_on": raw.drawn_on,
    }


def _from_entry(entry: dict[str, Any], orientation: int, key: str) -> RawDetections | None:
    """Rebuild an entry; None if it is malformed."""
    try:
        width, height = (int(length) for length in entry["size"])
        grids = tuple(_grid_from_entry(g) for g in entry["grids"])
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
        if min(width, height) < 1 or not all(_is_valid(board) for board in boards):
            return None
        sharpness, exposure = float(entry["sharpness"]), float(entry["exposure"])
        flags = bool(entry["interlaced"]), bool(entry["drawn_on"])
        return RawDetections((width, height), grids, boards, sharpness, exposure, orientation, *flags, key)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        return None


def _is_valid(board: Detection) -> bool:
    return bool(np.isfinite(board.pixels).all() and np.isfinite(board.covariance).all() and (board.ids >= 0).all())


def _grid_entry(grid: CornerGrid) -> dict[str, Any]:
    return {
        # JSON has no NaN.
        "pixels": np.where(grid.present[..., None], grid.pixels, -1e9).tolist(),
        "covariance": np.nan_to_num(grid.covariance).tolist(),
        "starts_dark": grid.starts_dark,
        "borders": grid.borders,
        "contrast": grid.contrast,
        "white": grid.white,
        "blur": grid.blur,
    }


def _grid_from_entry(entry: dict[str, Any]) -> CornerGrid:
    pixels, covariance = np.array(entry["pixels"], np.float64), np.array(entry["covariance"], np.float64)
    is_lattice = pixels.ndim == 3 and pixels.shape[2] == 2 and covariance.shape == (*pixels.shape, 2)
    if not is_lattice or not np.isfinite(pixels).all():
        raise ValueError("not a grid")
    top, bottom, left, right = (str(border) for border in entry["borders"])
    missing = pixels[..., 0] < -1e8
    pixels[missing], covariance[missing] = np.nan, np.nan
    levels = (float(entry[name]) for name in ("contrast", "white", "blur"))
    return CornerGrid(pixels, covariance, bool(entry["starts_dark"]), (top, bottom, left, right), *levels)
