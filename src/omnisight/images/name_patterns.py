"""Glob patterns that divide the images of a folder by camera: left*.jpg and right*.jpg, img_1_*.png and img_2_*.png."""

import re
from collections.abc import Sequence

# Images of a camera: fewer do not calibrate it.
MIN_IMAGES_EACH = 3


def patterns_by_name(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the ways to divide images by name: for each, the pattern that each name matches.

    A pattern is a name with one of its numbers, the number of the image, replaced by `*`. A way is returned if it has
    at least two patterns, and each of them matches at least three names.

    Parameters
    ----------
    names
        N file names, which may include folders.

    Returns
    -------
    list of tuple of str
        For each way, N patterns.
    """
    numbers = [list(re.finditer(r"\d+", name)) for name in names]
    ways = set[tuple[str, ...]]()
    for position in range(min(map(len, numbers), default=0)):
        for index in (position, -1 - position):  # names of two cameras may contain different counts of numbers
            patterns = tuple(_pattern(name, found[index]) for name, found in zip(names, numbers, strict=True))
            counts = {pattern: patterns.count(pattern) for pattern in patterns}
            if len(counts) > 1 and min(counts.values()) >= MIN_IMAGES_EACH:
                ways.add(patterns)
    return sorted(ways)


def _pattern(name: str, number: re.Match[str]) -> str:
    return f"{name[: number.start()]}*{name[number.end() :]}"
