"""Images that show what another one showed: a copy, or the next frame of a film."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .detection import Detection

SAME_PX = 0.5
"""Boards that moved by less are the same image, saved again."""

NEAR = 0.005
"""Boards none of whose points moved by more, over the image's diagonal, say hardly anything new."""

_COMMON = 0.8
"""Share of the points of either board that both must show."""


def repetitions(pictures: Sequence[Sequence[Detection]], size: tuple[int, int]) -> dict[int, tuple[int, float]]:
    """Give the images that repeat an earlier one.

    Parameters
    ----------
    images : sequence of sequence of Detection
        The boards seen in each.
    size : (int, int)
        Width and height of all, px.

    Returns
    -------
    dict
        For an image that repeats: which earlier one, that itself repeats none, and the farthest (px) that a point
        moved between them.
    """
    limit = max(NEAR * float(np.hypot(*size)), SAME_PX)
    repeated: dict[int, tuple[int, float]] = {}
    for i, boards in enumerate(pictures):
        others = [j for j in range(i) if j not in repeated and len(pictures[j]) == len(boards) > 0]
        moved = min(((_moved(boards, pictures[j]), j) for j in others), default=(np.inf, -1))
        if moved[0] < limit:
            repeated[i] = (moved[1], moved[0])
    return repeated


def repetition_note(other: str, moved: float) -> str:
    """Say that an image repeats another one."""
    return f"the same as {other}" if moved < SAME_PX else f"hardly differs from {other} (by {moved:.1f} px)"


def repetitions_note(count: int, all_: int, farthest: float) -> str:
    """Say how many images repeat another one, and what to do."""
    return (
        f"{count} of {all_} images with a board repeat another one (no corner moved by more than {farthest:.1f} px):"
        " they add next to nothing, and make the camera look surer than it is; move and tilt the board between"
        " images, or give the film itself, of which the frames that say most are taken"
    )


def _moved(boards: Sequence[Detection], others: Sequence[Detection]) -> float:
    """Give the farthest (px) that a point of the boards moved; inf where they show different points."""
    farthest = 0.0
    for board, other in zip(boards, others, strict=True):
        _, here, there = np.intersect1d(board.ids, other.ids, assume_unique=True, return_indices=True)
        if len(here) < _COMMON * max(len(board), len(other), 1):
            return np.inf
        farthest = max(farthest, float(np.linalg.norm(board.pixels[here] - other.pixels[there], axis=1).max(initial=0)))
    return farthest
