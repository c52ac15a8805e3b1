"""Options of the estimation."""

from dataclasses import dataclass
from typing import Literal

from omnisight.choices import Options

Loss = Literal["huber", "squared"]


@dataclass(frozen=True, kw_only=True)
class EstimationOptions(Options):
    """What is estimated, and how.

    Attributes
    ----------
    loss
        Loss of the residuals: huber, or squared for plain least squares.
    fix
        Name of a parameter that keeps its initial value (0 for a skew); may be repeated.
    free
        Name of a parameter to estimate although it is constant by default; may be repeated.
    square_pixels
        Estimate one focal length for both directions.
    flat
        Assume a flat board. Otherwise its warp is estimated too, and kept if it lowers the held-out error.
    """

    loss: Loss = "huber"
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    square_pixels: bool = False
    flat: bool = False
