"""What a format of corners gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.targets import Board

Array = NDArray[np.float64]

# What corners are off by where a file only says how much surer some are than others, px.
USUAL_PX = 0.5


@dataclass(frozen=True)
class Seen:
    """A target seen in an image.

    Attributes
    ----------
    image
        The image's name; empty where the file has none.
    points
        (N, 3) in the frame of the target.
    pixels
        (N, 2) where they are seen, the centre of the top-left pixel at (0, 0); NaN where they are not.
    covariance
        (N, 2, 2) of `pixels`, px^2; None where it is not known.
    size
        (width, height) of the image, px; (0, 0) where the file does not say.
    """

    picture: str
    points: Array
    pixels: Array
    covariance: Array | None = None
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Corners:
    """What a file holds.

    Attributes
    ----------
    views
        Its images, those that show nothing too; an image that shows several targets more than once.
    metres
        Whether `points` are in metres; if not, the file does not say in what they are.
    """

    views: Sequence[Seen]
    metres: bool = False


@dataclass(frozen=True)
class Told:
    """What is known beside what a file holds.

    Attributes
    ----------
    board
        The board of --pattern or --target.
    which
        Which camera, where the file holds several: its name there.
    beside
        Gives the text of the only file with an ending that lies beside this one; ValueError if there is none.
    """

    board: Board | None = None
    which: str | None = None
    beside: Callable[[str], str] | None = None


class CornerFormat(Protocol):
    """One format of corners: a module of this folder with these names."""

    TITLE: str
    """What it is called in full."""
    SUFFIX: str
    """The file ending it usually has."""
    CONVENTION: str
    """Its pixel origin and order of numbers, in one line."""

    def matches(self, text: str) -> bool:
        """Say whether the text of a file looks like this format."""
        ...

    def parse(self, text: str, told: Told) -> Corners:
        """Read the corners of a file.

        Raises
        ------
        ValueError
            What is wrong, with the value found; the caller adds the file's name.
        """
        ...


def one_of(names: Sequence[str], told: Told) -> str:
    """Give the camera that is meant of those a file holds."""
    if told.which is not None:
        if told.which not in names:
            raise ValueError(f"no corners of a camera {told.which[:40]!r}; it holds {', '.join(names)}")
        return told.which
    if len(names) > 1:
        raise ValueError(f"holds corners of {len(names)} cameras: {', '.join(names)}; say which: --which {names[0]}")
    return names[0]


def rows(values: Any, columns: Sequence[int], name: str) -> Array:
    """Give numbers as (N, k) with one of those k, from (N, k), (N, 1, k) or (1, N, k); no k of 2 and 3 is guessed."""
    found = np.asarray(values, float)
    if found.ndim == 3 and 1 in found.shape[:2]:
        found = found.reshape(-1, found.shape[2])
    if found.ndim != 2 or found.shape[1] not in columns:
        raise ValueError(f"{name} must be N rows of {' or '.join(map(str, columns))} numbers, got {np.shape(values)}")
    return found


def in_space(points: Array) -> Array:
    """Give points (N, 3) of those that may be (N, 2), on the plane z = 0."""
    return points if points.shape[1] == 3 else np.concatenate([points, np.zeros((len(points), 1))], 1)


def spread_of(sigmas: Array) -> Array | None:
    """Give covariances (N, 2, 2) of standard deviations (N,), px; None where all are the same: nothing is told then."""
    if not len(sigmas) or np.ptp(sigmas) == 0:
        return None
    return sigmas[:, None, None] ** 2 * np.eye(2)
