"""Protocol of a board: numbered points on a plane, a drawing, lengths and symmetry. Boards are data only."""

import re
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields
from types import NoneType
from typing import Any, ClassVar, Self, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.targets.length import format_length, parse_length
from omnisight.targets.printing.drawing import Shape

# Part of a step to which a window extends each way at most: the next point or edge is a whole step away.
MAX_WINDOW_SHARE = 0.55
# Limits on what a file may ask for.
MAX_COUNT = 1000
MAX_TEXT_LENGTH = 100


@dataclass(frozen=True)
class Board(Displayed, ABC):
    """A flat calibration target; each kind is one frozen dataclass in one file of this folder.

    Fields are counts, names, ratios, and lengths in metres. The metadata of a field may hold "length": True, "low", the
    least value of a count (1 if absent), and "default": (0.75, "square") for three quarters of another field or
    (0.3, None) for a number. The default applies to a new board that is printed; nothing is assumed of an existing one.
    A length of None is unknown: `points` are then in squares.

    Attributes
    ----------
    columns, rows : int
    relative : bool
        Whether only the ratios of the lengths are known, as of a board that was recognized in images: lengths and
        `points` are then in squares, sides of a marker or spacings.
    """

    # Name in files and on the command line: that of its module.
    kind: ClassVar[str]
    # Name of the package in `targets/detectors/` that detects and measures it.
    detector: ClassVar[str]

    columns: int
    rows: int
    relative: bool = field(default=False, kw_only=True)

    @property
    @abstractmethod
    def points(self) -> NDArray[np.float64]:
        """Positions (N, 3) of the points, in `unit`; x to the right on the print, y down, z = 0."""

    @property
    def unit(self) -> str:
        """Unit of `points`: 'm', or 'squares' if no length is known."""
        return "squares" if self.relative else "m"

    @property
    @abstractmethod
    def is_symmetric(self) -> bool:
        """Whether the board looks the same after some rotation, which makes its origin ambiguous."""

    @property
    @abstractmethod
    def extent(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom edge of the ink, in metres in the frame of `points`; needs all lengths."""

    @abstractmethod
    def drawing(self) -> list[Shape]:
        """Return the black and white shapes of the board, in metres in the frame of `points`, in painting order."""

    @property
    @abstractmethod
    def window_step(self) -> float:
        """Step along x and y, in the unit of `points`, whose window around a point holds nothing else.

        The window of `detectors.measure` extends up to `MAX_WINDOW_SHARE` of the step each way.
        """

    @property
    def max_window_step(self) -> float:
        """Largest step of a window, in the unit of `points`, for images too small for `window_step`."""
        return self.window_step

    @property
    def bright_ahead(self) -> NDArray[np.bool_] | None:
        """Whether the quadrant of each point (N,) towards +x and +y is bright; None unless edges cross at points."""
        return None

    def measurement_offset(self, project: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the offset (N, 2), px, of what is measured from the point's image; `project` maps (N, 3) to px."""
        return np.zeros((self.size, 2))

    @property
    def quiet_zone(self) -> float:
        """Width in metres of the white margin around the ink: one square."""
        left, _, right, _ = self.extent
        return (right - left) / (self.columns + 1)

    @property
    def size(self) -> int:
        """Number of points: one per column and row unless a kind overrides it."""
        return self.columns * self.rows

    def lengths(self) -> dict[str, float]:
        """Return the known lengths, in metres, by field name."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.metadata.get("length")}
        return {name: value for name, value in values.items() if value is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return the content of a target file: lengths as text with their unit, or as numbers if they are relative."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "relative"}
        if self.relative:
            return {"target": self.kind, **values, "relative": True}
        return {"target": self.kind, **values, **{k: format_length(v) for k, v in self.lengths().items()}}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build a board from `to_dict`.

        Raises
        ------
        ValueError
            For an unknown, missing or unreadable field, with its value and what was expected.
        """
        if values.get("target", cls.kind) != cls.kind:
            raise ValueError(f"target is {reprlib.repr(values['target'])}: expected {cls.kind!r}")
        known = {f.name: f for f in fields(cls)}
        given = {k: v for k, v in values.items() if k != "target"}
        if unknown := [k for k in given if k not in known]:
            names = ", ".join(name for name in known if name != "relative")
            raise ValueError(f"the target {cls.kind} has no {', '.join(map(reprlib.repr, unknown))}; it has {names}")
        if missing := [k for k, f in known.items() if f.default is MISSING and k not in given]:
            raise ValueError(f"the target {cls.kind} needs {', '.join(missing)}")
        types = get_type_hints(cls)
        relative = given.get("relative") is True
        return cls(
            **{k: _field_value(v, known[k], get_args(types[k]) or (types[k],), relative) for k, v in given.items()}
        )

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


def parse_pattern(text: str) -> dict[str, int]:
    """Parse `columns` and `rows` from `9x6`, `9,6` or `9 x 6`."""
    if (counts := _counts(text)) is None:
        raise ValueError(
            f"cannot read the pattern {text[:40]!r}: expected COLUMNSxROWS, inner corners of a checkerboard, such as"
            " 9x6"
        )
    return {"columns": counts[0], "rows": counts[1]}


def parse_squares(text: str) -> dict[str, int]:
    """Parse `columns` and `rows` of inner corners from the number of squares, one more each way, such as `10x7`."""
    if (counts := _counts(text)) is None:
        raise ValueError(
            f"cannot read the squares {text[:40]!r}: expected COLUMNSxROWS, squares of a checkerboard, such as 10x7"
        )
    return {"columns": counts[0] - 1, "rows": counts[1] - 1}


def _counts(text: str) -> tuple[int, int] | None:
    match = re.fullmatch(r"\s*([0-9]{1,4})\s*[xX×,]\s*([0-9]{1,4})\s*", text)
    return None if match is None else (int(match[1]), int(match[2]))


def grid_points(columns: int, rows: int, step: float) -> NDArray[np.float64]:
    """Return the points (N, 3) of a square grid in z = 0; x runs fastest."""
    y, x = np.mgrid[:rows, :columns]
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * step


def _field_value(value: Any, target_field: Field[Any], types: tuple[type, ...], relative: bool) -> Any:
    """Return the checked value of a field, or raise ValueError with what was expected."""
    if value is None and NoneType in types:
        return None
    if target_field.metadata.get("length") and not relative:
        expected = "a length in quotes with its unit, such as '30mm'"
        if isinstance(value, str) and len(value) <= MAX_TEXT_LENGTH:
            # 18 * 1e-3 is not 0.018: a board must equal the one that was written.
            return round(parse_length(value, target_field.name), 12)
    elif bool in types:
        expected = "true or false"
        if isinstance(value, bool):
            return value
    elif int in types:
        low = target_field.metadata.get("low", 1)
        expected = f"an integer from {low} to {MAX_COUNT}"
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= MAX_COUNT:
            return value
    elif float in types:
        expected = f"a number up to {MAX_COUNT}"
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_COUNT:
            return float(value)
    else:
        expected = f"text of at most {MAX_TEXT_LENGTH} characters"
        if isinstance(value, str) and len(value) <= MAX_TEXT_LENGTH:
            return value
    raise ValueError(f"{target_field.name} is {reprlib.repr(value)}: expected {expected}")
