"""Options of `compare`. This module imports nothing heavy, because the command line imports it for its help."""

from dataclasses import dataclass

from omnisight.choices import Options


@dataclass(frozen=True)
class CompareOptions(Options):
    """Options of `compare`.

    Attributes
    ----------
    name
        Name of the first camera, if its file holds several, such as a rig.
    other_name
        Name of the second camera, if its file holds several.
    distance
        Scene distance with its unit ("2m", "inf"), for non-central cameras.
    max_theta
        Largest angle from the axis to compare, degrees; by default that of the calibrated fields of view.
    columns
        Columns of the grid of pixels on which the cameras are compared.
    """

    name: str | None = None
    other_name: str | None = None
    distance: str | None = None
    max_theta: float | None = None
    columns: int = 96

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        if not 8 <= self.columns <= 1000:
            raise ValueError(f"--columns must be from 8 to 1000, got {self.columns}")
        if self.max_theta is not None and not 0 < self.max_theta <= 180:
            raise ValueError(f"--max-theta must be from 0 to 180 degrees, got {self.max_theta:g}")
