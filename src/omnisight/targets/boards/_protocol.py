"""What a board is: points at known places on a plane, a way to print them and a way to find them."""

from __future__ import annotations

import re
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detection import Detection
from omnisight.targets.length import format_length, parse_length
from omnisight.targets.printing.drawing import Shape

if TYPE_CHECKING:
    from omnisight.targets.grids.crossing import Crossings

CLEAR_SHARE = 0.55
"""Part of a step around a point, each way, that must be free of other edges: as far as a small board's window goes."""

LARGEST_COUNT = 1000
LONGEST_TEXT = 100  # characters


@dataclass(frozen=True)
class Board(ABC):
    """A flat calibration target; each kind is one frozen dataclass in one file of this folder.

    Fields are counts, names, ratios, and lengths in metres; a length field says so by its metadata. A field that is
    a length and None is one that the user did not tell: `points` are then in squares. A field's metadata may also
    say what is usual, (0.75, "square") for three quarters of another field or (0.3, None) for a number: a new board
    is made so where nothing else is asked for, but nothing is assumed of one that exists.
    """

    kind: ClassVar[str]
    """What a file and the command line call it: the name of its module."""

    columns: int
    rows: int

    @property
    @abstractmethod
    def points(self) -> NDArray[np.float64]:
        """Positions (N, 3) of the points that are found, in `unit`; x to the right on the print, y down, z = 0."""

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of `points`: 'm', or 'squares' where no length was told."""

    @property
    @abstractmethod
    def symmetric(self) -> bool:
        """Whether it looks the same after some turn: its origin may then be taken for another point."""

    @property
    @abstractmethod
    def extent(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom edge of the ink, in metres in the frame of `points`; needs all lengths."""

    @abstractmethod
    def drawing(self) -> list[Shape]:
        """Give the black and white shapes that make it up, in metres in the frame of `points`, painted in order."""

    @abstractmethod
    def detect(self, gray: NDArray[np.uint8]) -> list[Detection]:
        """Find all boards of this kind in a gray image (H, W) of uint8, the one with most points first."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Length, in the unit of `points`, of the steps that `measure` takes along x and along y.

        So short that the window, which goes a part of the step each way, shows nothing but the point itself.
        """

    def measure(
        self,
        gray: NDArray[Any],
        pixels: NDArray[np.float64],
        steps: NDArray[np.float64],
        bends: NDArray[np.float64],
    ) -> Crossings:
        """Measure points where they are expected, such as by a calibrated camera.

        Parameters
        ----------
        gray : (H, W) array of uint8
        pixels : (N, 2) array
            Where they are expected.
        steps : (N, 2, 2) array
            Steps in px for `reach` along x (first row) and along y.
        bends : (N, 2, 2) array
            How the lines along x and y bend: one runs through c + s step + s^2 bend.
        """
        from omnisight.targets.grids.crossing import fit_crossings

        return fit_crossings(gray, pixels, steps, bends)

    @property
    def bright(self) -> NDArray[np.bool_] | None:
        """Whether the square ahead of each point (N,), towards +x and +y, is a bright one; None without squares."""
        return None

    def offset(self, project: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Give how far (N, 2), px, what `measure` finds is from the point's image; `project` maps (N, 3) to px."""
        return np.zeros((self.size, 2))

    @property
    def quiet(self) -> float:
        """Width in metres of the white margin that it likes around its ink: one square."""
        left, _, right, _ = self.extent
        return (right - left) / (self.columns + 1)

    @property
    def size(self) -> int:
        """Number of points: one for each column and row unless a kind says otherwise."""
        return self.columns * self.rows

    def lengths(self) -> dict[str, float]:
        """Give the lengths that are known, in metres, by their field."""
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.metadata.get("length")}
        return {name: value for name, value in known.items() if value is not None}

    def to_dict(self) -> dict[str, Any]:
        """Give what a target file holds: lengths as text with their unit."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {"target": self.kind, **values, **{k: format_length(v) for k, v in self.lengths().items()}}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Rebuild it from `to_dict`.

        Raises
        ------
        ValueError
            For an unknown, missing or unreadable field: names it, what was found, and what was expected.
        """
        if values.get("target", cls.kind) != cls.kind:
            raise ValueError(f"target is {reprlib.repr(values['target'])}: expected {cls.kind!r}")
        known = {f.name: f for f in fields(cls)}
        given = {k: v for k, v in values.items() if k != "target"}
        if unknown := [k for k in given if k not in known]:
            raise ValueError(
                f"the target {cls.kind} has no {', '.join(map(reprlib.repr, unknown))}; it has {', '.join(known)}"
            )
        if missing := [k for k, f in known.items() if f.default is MISSING and k not in given]:
            raise ValueError(f"the target {cls.kind} needs {', '.join(missing)}")
        types = get_type_hints(cls)
        return cls(**{k: _checked(v, known[k], get_args(types[k]) or (types[k],)) for k, v in given.items()})

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


def parse_pattern(text: str) -> dict[str, int]:
    """Read `columns` and `rows` as a user writes them: `9x6`, `9,6`, `9 x 6`."""
    match = re.fullmatch(r"\s*([0-9]{1,4})\s*[xX×,]\s*([0-9]{1,4})\s*", text)
    if match is None:
        raise ValueError(
            f"cannot read the pattern {text[:40]!r}: give COLUMNSxROWS, inner corners of a checkerboard, such as 9x6"
        )
    return {"columns": int(match[1]), "rows": int(match[2])}


def _checked(value: Any, field: Field[Any], types: tuple[type, ...]) -> Any:
    """Give the value of a field as it is kept, or say what is wrong with it."""
    if value is None and NoneType in types:
        return None
    if field.metadata.get("length"):
        expected = "a length in quotes with its unit, such as '30mm'"
        if isinstance(value, str) and len(value) <= LONGEST_TEXT:
            try:
                # 18 * 1e-3 is not 0.018: a board is to equal the one that was written.
                return round(parse_length(value), 12)
            except ValueError as error:
                raise ValueError(f"{field.name}: {error}") from None
    elif bool in types:
        expected = "true or false"
        if isinstance(value, bool):
            return value
    elif int in types:
        expected = f"a whole number from 1 to {LARGEST_COUNT}"
        if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= LARGEST_COUNT:
            return value
    elif float in types:
        expected = f"a number up to {LARGEST_COUNT}"
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_COUNT:
            return float(value)
    else:
        expected = f"text of at most {LONGEST_TEXT} characters"
        if isinstance(value, str) and len(value) <= LONGEST_TEXT:
            return value
    raise ValueError(f"{field.name} is {reprlib.repr(value)}: expected {expected}")
