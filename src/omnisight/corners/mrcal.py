"""The vnlog of corners that mrgingham writes and mrcal reads (corners.vnl).

Each line holds the image, x, y and the uncertainty of a corner. A whole board is listed row by row, in the order of its
points; an image without a board has a single line with dashes. The fourth column is the decimation `level` (a standard
deviation of 2^level; a dash marks an outlier) or a `weight` (one over the standard deviation; negative for an outlier).
The board is not in the file (man pages of mrgingham and of mrcal's tools).
"""

import numpy as np

from omnisight.corners._protocol import (
    TYPICAL_SIGMA_PX,
    Array,
    CornerFile,
    ImageCorners,
    ReadOptions,
    isotropic_covariance,
)
from omnisight.formats._limits import MAX_ENTRIES, SEARCHED_CHARS
from omnisight.targets import Board

TITLE = "mrcal corners.vnl"
SUFFIX = ".vnl"
CONVENTION = "filename x y level, row by row of the board; integer pixel = pixel centre"
MAX_LEVEL = 30.0  # of decimation; 2^level must not overflow
REQUIRED = ("filename", "x", "y")


def matches(text: str) -> bool:
    """Return whether the legend names filename, x and y."""
    return _legend(text[:SEARCHED_CHARS]) is not None


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    tables = _tables(text)
    counts = sorted({len(table) for table in tables.values() if len(table)})
    board = options.board
    if board is None:
        example = " or ".join(f"{round(n**0.5)}x{round(n**0.5)}" for n in counts[:1] if round(n**0.5) ** 2 == n)
        raise ValueError(
            f"the board is not in the file; it has {counts[0] if counts else 'no'} corners: specify --pattern, such as"
            f" {example or '14x14'}, and --square"
        )
    return CornerFile([_image(name, table, board) for name, table in tables.items()], in_metres=board.unit == "m")


def _tables(text: str) -> dict[str, Array]:
    """Return x, y and the relative standard deviation (N, 3) of the corners of each image."""
    legend = _legend(text)
    assert legend is not None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) > MAX_ENTRIES:
        raise ValueError(f"{len(lines)} lines; at most {MAX_ENTRIES} are read")
    columns = [legend.index(name) for name in REQUIRED]
    weight_column = next((name for name in ("level", "weight") if name in legend), None)
    tables: dict[str, list[tuple[float, float, float]]] = {}
    for number, line in enumerate(lines, 1):
        words = line.split()
        if len(words) != len(legend):
            raise ValueError(f"entry {number} has {len(words)} columns, {len(legend)} in the legend: {line[:60]!r}")
        name, x, y = (words[k] for k in columns)
        corners = tables.setdefault(name, [])
        if x == "-" or y == "-":
            continue
        try:
            sigma = _relative_sigma(weight_column, words[legend.index(weight_column)]) if weight_column else 1.0
            corners.append((float(x), float(y), sigma))
        except ValueError:
            raise ValueError(f"entry {number} is not a corner: {line[:60]!r}") from None
    return {name: np.array(corners).reshape(-1, 3) for name, corners in tables.items()}


def _image(name: str, table: Array, board: Board) -> ImageCorners:
    """Return the corners of an image; outliers become NaN."""
    if len(table) and len(table) != len(board.points):
        raise ValueError(
            f"{name[:60]} has {len(table)} corners, the {board} board {len(board.points)}: mrgingham lists whole"
            " boards; is --pattern right?"
        )
    pixels = np.where(np.isfinite(table[:, 2:]), table[:, :2], np.nan)
    return ImageCorners(name, board.points[: len(table)], pixels, _covariance(table[:, 2]))


def _legend(text: str) -> list[str] | None:
    """Return the column names: the first comment that begins with a single #."""
    for line in text.splitlines():
        if line.startswith("#") and not line.startswith(("##", "#!")):
            names = line[1:].split()
            return names if set(REQUIRED) <= set(names) else None
        if line.strip() and not line.startswith("#"):
            return None
    return None


def _relative_sigma(column: str, word: str) -> float:
    """Return the relative standard deviation of a corner; NaN for an outlier."""
    if word == "-":
        return np.nan
    value = float(word)
    if column == "level":
        return 2.0 ** min(value, MAX_LEVEL) if value >= 0 else np.nan
    return 1 / value if value > 0 else np.nan


def _covariance(sigmas: Array) -> Array | None:
    """Return the covariance of corners, or None if all weights are equal."""
    known = np.isfinite(sigmas)
    if not known.any():
        return None
    return isotropic_covariance(TYPICAL_SIGMA_PX * np.where(known, sigmas, sigmas[known].max()))
