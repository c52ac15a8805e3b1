"""Image sizes of a set: which images are of one camera, and what the others may be."""

from collections.abc import Sequence

from omnisight.images.name_patterns import patterns_by_name

Size = tuple[int, int]

FRACTIONS = {2: "half", 3: "a third", 4: "a quarter"}
# Images of each other size that are listed by name.
MAX_NAMES = 5


def most_common_size(images: Sequence[tuple[Size, bool]]) -> Size | None:
    """Return the size that most images with a board have; None without images.

    Parameters
    ----------
    images : sequence of ((int, int), bool)
        Width and height in px of each image, and whether it shows any board.
    """
    counts: dict[Size, tuple[int, int, int]] = {}
    for size, has_board in images:
        boards, count, _ = counts.get(size, (0, 0, 0))
        counts[size] = (boards + has_board, count + 1, size[0] * size[1])
    return max(counts, key=lambda size: counts[size], default=None)


def size_mismatch_note(size: Size, used: Size) -> str:
    """Return what an image of another size may be, and what to do."""
    note = f"{_text(size)} where others have {_text(used)}: left out"
    if size == used[::-1]:
        return f"{note}; rotated by 90°? Use the file as the sensor wrote it, not rotated on saving or by --apply-exif"
    ratio = _ratio(size, used)
    if ratio is not None:
        return f"{note}; {ratio}: if it was resized or binned, resize it to {_text(used)}"
    return f"{note}; cropped, or another camera? Calibrate it separately"


def sizes_note(images: Sequence[tuple[str, Size]], used: Size) -> str | None:
    """Return the sizes of images, each (name, size), with counts and names; None if all have one size."""
    by_size: dict[Size, list[str]] = {}
    for name, size in images:
        by_size.setdefault(size, []).append(name)
    if len(by_size) < 2:
        return None
    others = sorted((size for size in by_size if size != used), key=lambda size: -len(by_size[size]))
    parts = [f"{len(by_size[used])} of {_text(used)}, which are used"]
    for size in others:
        names = by_size[size]
        part = f"{len(names)} of {_text(size)} ({', '.join(names[:MAX_NAMES])}{', ...' * (len(names) > MAX_NAMES)})"
        parts.append(f"{part}, rotated by 90°?" if size == used[::-1] else part)
    action = "Another size is another camera: calibrate it separately"
    for patterns in patterns_by_name([name for name, _ in images]):
        size_by_pattern = dict(zip(patterns, (size for _, size in images), strict=True))
        if all(size_by_pattern[pattern] == size for pattern, (_, size) in zip(patterns, images, strict=True)):
            quoted = [f"'{pattern}'" for pattern in size_by_pattern]
            action = f"{', '.join(quoted[:MAX_NAMES])} are different cameras: calibrate each separately"
    ratios = [f"{_text(size)} is {ratio}: resize them" for size in others if (ratio := _ratio(size, used))]
    first = f"images have {len(by_size)} sizes: {'; '.join(parts)}"
    return ". ".join([first, *ratios, action])


def _ratio(size: Size, used: Size) -> str | None:
    """Return that a size is half of another, twice it, and so on; None if it is not."""
    if (times := used[0] // size[0]) > 1 and (times * size[0], times * size[1]) == used:
        return f"{FRACTIONS.get(times, f'1/{times}')} of {_text(used)}"
    if (times := size[0] // used[0]) > 1 and (times * used[0], times * used[1]) == size:
        return f"{'twice' if times == 2 else f'{times} times'} {_text(used)}"
    return None


def _text(size: Size) -> str:
    return f"{size[0]}x{size[1]}"
