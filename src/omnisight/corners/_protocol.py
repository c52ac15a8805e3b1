"""The protocol of a corner format."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.targets import Board

Array = NDArray[np.float64]

# The standard deviation of a corner where a file only has relative weights, px.
TYPICAL_SIGMA_PX = 0.5


@dataclass(frozen=True)
class ImageCorners:
    """The corners of a target in an image.

    Attributes
    ----------
    name
        The name of the image; empty if the file has none.
    points
        (N, 3) in the frame of the target.
    pixels
        (N, 2), the centre of the top-left pixel is (0, 0); NaN for a corner that was not detected.
    covariance
        (N, 2, 2) of `pixels`, px^2, or None.
    size
        (width, height) of the image, px; (0, 0) if unknown.
    """

    name: str
    points: Array
    pixels: Array
    covariance: Array | None = None
    size: tuple[int, int] = (0, 0)

    @classmethod
    def empty(cls, name: str = "", size: tuple[int, int] = (0, 0)) -> "ImageCorners":
        """Return an image without corners."""
        return cls(name, np.zeros((0, 3)), np.zeros((0, 2)), size=size)


@dataclass(frozen=True)
class CornerFile:
    """The content of a corner file.

    Attributes
    ----------
    images
        All images, those without corners too; an image of several targets occurs once per target.
    in_metres
        Whether `points` are in metres; if not, their unit is unknown.
    """

    images: Sequence[ImageCorners]
    in_metres: bool = False


@dataclass(frozen=True)
class ReadOptions:
    """What the user specifies besides a corner file.

    Attributes
    ----------
    board
        The board, for files that do not hold one.
    camera
        The name of the camera in a file that holds several.
    read_sibling
        Reads the text of the only file with an ending in the same folder; raises ValueError if there is none.
    """

    board: Board | None = None
    camera: str | None = None
    read_sibling: Callable[[str], str] | None = None


class CornerFormat(Protocol):
    """A corner format: a module of this folder with these names.

    Attributes
    ----------
    TITLE
        The full name.
    SUFFIX
        The usual file ending.
    CONVENTION
        The pixel origin and order of numbers, in one line.
    """

    TITLE: str
    SUFFIX: str
    CONVENTION: str

    def matches(self, text: str) -> bool:
        """Return whether the text of a file is in this format."""
        ...

    def parse(self, text: str, options: ReadOptions) -> CornerFile:
        """Return the corners of a file.

        Raises
        ------
        ValueError
            If the file is damaged; the message has the value, the caller adds the file name.
        """
        ...


def select_camera(names: Sequence[str], options: ReadOptions) -> str:
    """Return the camera to read of those that a file holds."""
    if options.camera is not None:
        if options.camera not in names:
            raise ValueError(f"no corners of a camera {options.camera[:40]!r}; it holds {', '.join(names)}")
        return options.camera
    if len(names) > 1:
        raise ValueError(f"holds corners of {len(names)} cameras: {', '.join(names)}; specify one: --which {names[0]}")
    return names[0]


def as_rows(values: Any, columns: Sequence[int], name: str) -> Array:
    """Return numbers as (N, k) with k in `columns`, from (N, k), (N, 1, k) or (1, N, k)."""
    array = np.asarray(values, float)
    if array.ndim == 3 and 1 in array.shape[:2]:
        array = array.reshape(-1, array.shape[2])
    if array.ndim != 2 or array.shape[1] not in columns:
        raise ValueError(f"{name} must be N rows of {' or '.join(map(str, columns))} numbers, got {np.shape(values)}")
    return array


def to_3d(points: Array) -> Array:
    """Return points (N, 2) or (N, 3) as (N, 3); z is 0 where it is absent."""
    return points if points.shape[1] == 3 else np.concatenate([points, np.zeros((len(points), 1))], 1)


def isotropic_covariance(sigmas: Array) -> Array | None:
    """Return covariances (N, 2, 2) of standard deviations (N,), px; None if all are equal and thus carry no weight."""
    if not len(sigmas) or np.ptp(sigmas) == 0:
        return None
    return sigmas[:, None, None] ** 2 * np.eye(2)
