"""An image of a stream with its time."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class TimedImage:
    """An image of a stream.

    Attributes
    ----------
    seconds
        Its time.
    image
        Gray or RGB image (H, W) or (H, W, 3); None if it cannot be read.
    reason
        Why it cannot be read; empty otherwise.
    """

    seconds: float
    image: NDArray[Any] | None
    reason: str = ""
