"""The vnlog of corners that mrgingham writes and mrcal reads (corners.vnl).

A line per corner: the image, x, y, and how sure it is. A whole board is listed row by row, in the order of its
points; an image without one has a single line with dashes. The fourth column is the decimation `level` (a deviation of
2^level, a dash: do not use) or a `weight` (one over the deviation, negative: do not use). The board is not in the file
(man pages of mrgingham and of mrcal's tools).
"""

import numpy as np

from omnisight.corners._protocol import USUAL_PX, Array, Corners, Seen, Told, spread_of

TITLE = "mrcal corners.vnl"
SUFFIX = ".vnl"
CONVENTION = "filename x y level, row by row of the board; integer pixel = pixel centre"
MOST = 2_000_000  # lines
NEEDED = ("filename", "x", "y")


def matches(text: str) -> bool:
    """Say whether the legend names filename, x and y."""
    return _legend(text[:100_000]) is not None


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    legend = _legend(text)
    assert legend is not None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) > MOST:
        raise ValueError(f"{len(lines)} lines; corners have at most {MOST}")
    place = [legend.index(name) for name in NEEDED]
    sure = next((name for name in ("level", "weight") if name in legend), None)
    found: dict[str, list[tuple[float, float, float]]] = {}
    for number, line in enumerate(lines, 1):
        words = line.split()
        if len(words) != len(legend):
            raise ValueError(f"entry {number} has {len(words)} columns, {len(legend)} in the legend: {line[:60]!r}")
        name, x, y = (words[k] for k in place)
        corners = found.setdefault(name, [])
        if x == "-" or y == "-":
            continue
        try:
            sigma = _sigma(sure, words[legend.index(sure)]) if sure else 1.0
            corners.append((float(x), float(y), sigma))
        except ValueError:
            raise ValueError(f"entry {number} is no corner: {line[:60]!r}") from None
    counts = sorted({len(corners) for corners in found.values() if corners})
    if told.board is None:
        such = " or ".join(f"{round(n**0.5)}x{round(n**0.5)}" for n in counts[:1] if round(n**0.5) ** 2 == n)
        raise ValueError(
            f"the board is not in the file; it has {counts[0] if counts else 'no'} corners: give --pattern, such as"
            f" {such or '14x14'}, and --square"
        )
    views: list[Seen] = []
    for name, corners in found.items():
        if corners and len(corners) != len(told.board.points):
            raise ValueError(
                f"{name[:60]} has {len(corners)} corners, the {told.board} board {len(told.board.points)}: mrgingham"
                " lists whole boards; is --pattern right?"
            )
        table = np.array(corners).reshape(-1, 3)
        pixels = np.where(np.isfinite(table[:, 2:]), table[:, :2], np.nan)
        views.append(Seen(name, told.board.points[: len(table)], pixels, _covariance(table[:, 2])))
    return Corners(views, metres=told.board.unit == "m")


def _legend(text: str) -> list[str] | None:
    """Give the columns' names: the first comment that begins with a single #."""
    for line in text.splitlines():
        if line.startswith("#") and not line.startswith(("##", "#!")):
            names = line[1:].split()
            return names if set(NEEDED) <= set(names) else None
        if line.strip() and not line.startswith("#"):
            return None
    return None


def _sigma(column: str, word: str) -> float:
    """Give how unsure a corner is; NaN where it is not to be used."""
    if word == "-":
        return np.nan
    value = float(word)
    if column == "level":
        return 2.0 ** min(value, 30.0) if value >= 0 else np.nan
    return 1 / value if value > 0 else np.nan


def _covariance(sigmas: Array) -> Array | None:
    known = np.isfinite(sigmas)
    if not known.any():
        return None
    return spread_of(USUAL_PX * np.where(known, sigmas, sigmas[known].max()))
