"""Images of several sizes: which of them are one camera's, and what the others may be."""

from __future__ import annotations

from collections.abc import Sequence

Size = tuple[int, int]

_PARTS = {2: "half", 3: "a third", 4: "a quarter"}
_NAMED = 5
"""Images of a size that are named."""


def used_size(seen: Sequence[tuple[Size, bool]]) -> Size | None:
    """Give the size that most images with a board have; None without images.

    Parameters
    ----------
    seen : sequence of ((int, int), bool)
        Width and height in px of each image, and whether any board is in it.
    """
    counts: dict[Size, tuple[int, int, int]] = {}
    for size, shows in seen:
        boards, count, _ = counts.get(size, (0, 0, 0))
        counts[size] = (boards + shows, count + 1, size[0] * size[1])
    return max(counts, key=lambda size: counts[size], default=None)


def misfit(size: Size, used: Size) -> str:
    """Say what an image of another size than the others may be, and what to do."""
    said = f"{_text(size)} where others have {_text(used)}: left out"
    if size == used[::-1]:
        return f"{said}; rotated 90 degrees? Give it as the sensor read it, not turned on saving or by --apply-exif"
    part = _part(size, used)
    if part is not None:
        return f"{said}; {part}: if it was resized or binned, resize it to {_text(used)}"
    return f"{said}; cropped, or another camera? Calibrate it apart"


def sizes_note(named: Sequence[tuple[str, Size]], used: Size) -> str | None:
    """Say which sizes there are, with counts and names; None if all images, each (name, size), have one size."""
    by_size: dict[Size, list[str]] = {}
    for name, size in named:
        by_size.setdefault(size, []).append(name)
    if len(by_size) < 2:
        return None
    others = sorted((size for size in by_size if size != used), key=lambda size: -len(by_size[size]))
    parts = [f"{len(by_size[used])} of {_text(used)}, which are used"]
    for size in others:
        names = by_size[size]
        part = f"{len(names)} of {_text(size)} ({', '.join(names[:_NAMED])}{', ...' if len(names) > _NAMED else ''})"
        parts.append(f"{part}, rotated 90 degrees?" if size == used[::-1] else part)
    said = f"images have {len(by_size)} sizes: {'; '.join(parts)}"
    ways = [f"{_text(size)} is {part}: resize them" for size in others if (part := _part(size, used))]
    return ". ".join([said, *ways, "Another size is another camera: calibrate it apart"])


def _part(size: Size, used: Size) -> str | None:
    """Say that a size is half of another, or twice, and so on; None where it is not."""
    if (times := used[0] // size[0]) > 1 and (times * size[0], times * size[1]) == used:
        return f"{_PARTS.get(times, f'1/{times}')} of {_text(used)}"
    if (times := size[0] // used[0]) > 1 and (times * used[0], times * used[1]) == size:
        return f"{'twice' if times == 2 else f'{times} times'} {_text(used)}"
    return None


def _text(size: Size) -> str:
    return f"{size[0]}x{size[1]}"
