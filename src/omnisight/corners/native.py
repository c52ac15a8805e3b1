"""omnisight's own JSON of corners, as `omnisight detect --json` prints it."""

import json
import math
from typing import Any

import numpy as np

from omnisight.corners._protocol import CornerFile, ImageCorners, ReadOptions, as_rows
from omnisight.formats._limits import HEAD_CHARS
from omnisight.formats._values import image_size
from omnisight.images.output_paths import image_labels
from omnisight.targets import Board, Detection, Detections, board_class

TITLE = "omnisight corners"
SUFFIX = ".json"
CONVENTION = "ids of the target's points, pixels and their covariance; integer pixel = pixel centre"
FORMAT = "omnisight-corners"


def matches(text: str) -> bool:
    """Return whether this is omnisight's JSON of corners."""
    return text.lstrip().startswith("{") and f'"{FORMAT}"' in text[:HEAD_CHARS]


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"invalid JSON: {error}") from None
    target, entries = data.get("target"), data.get("images")
    if not isinstance(target, dict) or not isinstance(entries, list):
        raise ValueError("target or images missing: was any board detected?")
    board = board_class(str(target.get("target"))[:40]).from_dict(target)
    images: list[ImageCorners] = []
    for k, entry in enumerate(entries, 1):
        if not isinstance(entry, dict) or not isinstance(entry.get("boards"), list):
            raise ValueError(f"image {k} has no boards")
        name, size = str(entry.get("name", "")), entry.get("size") or (0, 0)
        size = image_size(*size) if size != (0, 0) else size
        boards = [_board_corners(name, size, detection, board) for detection in entry["boards"]]
        images += boards or [ImageCorners.empty(name, size)]
    return CornerFile(images, in_metres=board.unit == "m")


def serialize(detections: Detections) -> str:
    """Return the content of a file."""
    return json.dumps(to_dict(detections), indent=2, allow_nan=False)


def to_dict(detections: Detections) -> dict[str, Any]:
    """Return the JSON object of detections."""
    names = image_labels([image.path for image in detections.images])
    field = detections.field
    return {
        "format": FORMAT,
        "pattern": None if detections.board is None else str(detections.board),
        "target": None if detections.board is None else detections.board.to_dict(),
        "assumption": detections.assumption,
        "hint": detections.hint,
        "notes": list(detections.notes),
        "field": None if field is None else field.describe(),
        "images": [
            {
                "name": name,
                "size": image.size,
                "boards": [_board_entry(detection, detections) for detection in image.boards],
                "sharpness": _finite(image.sharpness),
                "blur": _finite(image.blur),
                "exposure": _finite(image.exposure),
                "note": image.note,
            }
            for name, image in zip(names, detections.images, strict=True)
        ],
    }


def _board_entry(detection: Detection, detections: Detections) -> dict[str, Any]:
    field = detections.field
    outside = [] if field is None else detection.ids[~field.contains(detection.pixels)].tolist()
    return {
        "pattern": str(detections.board),
        "ids": detection.ids.tolist(),
        "pixels": detection.pixels.tolist(),
        "covariance": detection.covariance.tolist(),
        "located": detection.located,
        "outside": outside,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _board_corners(name: str, size: tuple[int, int], detection: Any, board: Board) -> ImageCorners:
    """Return the corners of one detected board."""
    if not isinstance(detection, dict) or not {"ids", "pixels"} <= set(detection):
        raise ValueError(f"{name[:60]}: a board without ids and pixels")
    ids, pixels = np.asarray(detection["ids"]), as_rows(detection["pixels"], (2,), f"{name[:60]}: pixels")
    if ids.shape != (len(pixels),) or ids.dtype.kind != "i" or not ((ids >= 0) & (ids < board.size)).all():
        raise ValueError(f"{name[:60]}: ids must be {len(pixels)} numbers of the target's {board.size} points")
    covariance = None
    if detection.get("covariance") is not None:
        covariance = np.asarray(detection["covariance"], float)
        if covariance.shape != (len(ids), 2, 2):
            raise ValueError(f"{name[:60]}: covariance must be {len(ids)} x 2 x 2, got {covariance.shape}")
    return ImageCorners(name, board.points[ids], pixels, covariance, size)
