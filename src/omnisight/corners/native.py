"""omnisight's own JSON of corners: what `omnisight detect --json` prints."""

import json
from typing import Any

import numpy as np

from omnisight.corners._protocol import Corners, Seen, Told, rows
from omnisight.formats._checks import picture_size
from omnisight.targets import Board, board_class

TITLE = "omnisight corners"
SUFFIX = ".json"
CONVENTION = "ids of the target's points, pixels and their covariance; integer pixel = pixel centre"
FORMAT = "omnisight-corners"


def matches(text: str) -> bool:
    """Say whether it names itself so."""
    return text.lstrip().startswith("{") and f'"{FORMAT}"' in text[:2000]


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from None
    target, pictures = data.get("target"), data.get("images")
    if not isinstance(target, dict) or not isinstance(pictures, list):
        raise ValueError("target or images missing: was any board found?")
    board = board_class(str(target.get("target"))[:40]).from_dict(target)
    views: list[Seen] = []
    for k, picture in enumerate(pictures, 1):
        if not isinstance(picture, dict) or not isinstance(picture.get("boards"), list):
            raise ValueError(f"image {k} has no boards")
        name, size = str(picture.get("name", "")), picture.get("size") or (0, 0)
        size = picture_size(*size) if size != (0, 0) else size
        found = [_seen(name, size, detection, board) for detection in picture["boards"]]
        views += found or [Seen(name, np.zeros((0, 3)), np.zeros((0, 2)), size=size)]
    return Corners(views, metres=board.unit == "m")


def _seen(name: str, size: tuple[int, int], detection: Any, board: Board) -> Seen:
    if not isinstance(detection, dict) or not {"ids", "pixels"} <= set(detection):
        raise ValueError(f"{name[:60]}: a board without ids and pixels")
    ids, pixels = np.asarray(detection["ids"]), rows(detection["pixels"], (2,), f"{name[:60]}: pixels")
    if ids.shape != (len(pixels),) or ids.dtype.kind != "i" or not ((ids >= 0) & (ids < board.size)).all():
        raise ValueError(f"{name[:60]}: ids must be {len(pixels)} numbers of the target's {board.size} points")
    covariance = None
    if detection.get("covariance") is not None:
        covariance = np.asarray(detection["covariance"], float)
        if covariance.shape != (len(ids), 2, 2):
            raise ValueError(f"{name[:60]}: covariance must be {len(ids)} x 2 x 2, got {covariance.shape}")
    return Seen(name, board.points[ids], pixels, covariance, size)
