"""The requirements of a mirror camera."""

from dataclasses import dataclass

import numpy as np

from omnisight.display import Displayed
from omnisight.extensions import unknown_name
from omnisight.optics.design.shapes import KINDS

# Share of the sensor's shorter side that the mirror's image fills if the lens is chosen automatically.
FILL_FRACTION = 0.98
# Larger values (metres) are rejected: they come from a wrong unit.
MAX_LENGTH_M = {"pixel": 1e-4, "focal length": 1.0, "diameter": 10.0, "distance": 100.0, "body": 10.0}


@dataclass(frozen=True)
class MirrorSpecification(Displayed):
    """Requirements of a mirror camera. The mirror is above the lens and the axis is vertical.

    Attributes
    ----------
    kind
        One of `KINDS`.
    up, down
        Field of view above and below the horizon, radians. The rim of the mirror shows `up`, the edge of its hole
        `down`.
    size
        (width, height) of the sensor, px.
    pixel
        Pixel pitch, metres.
    focal
        Focal length of the lens, metres; None to choose it automatically.
    diameter
        Diameter of the mirror's rim, metres; None to choose it automatically.
    distance
        From the lens centre to the mirror's vertex, metres; None to choose it automatically.
    body
        Diameter of the camera body as the mirror sees it, metres.
    working_distance
        Scene distance, metres, at which the parallax of a misaligned mirror is evaluated.
    """

    kind: str
    up: float
    down: float
    size: tuple[int, int]
    pixel: float
    focal: float | None = None
    diameter: float | None = None
    distance: float | None = None
    body: float = 0.03
    working_distance: float = 1.0

    def __post_init__(self) -> None:
        """Check that all values are possible."""
        if self.kind not in KINDS:
            raise ValueError(unknown_name("kind of mirror", self.kind, KINDS))
        self._check_field()
        self._check_lengths()
        if min(self.size) < 16 or max(self.size) > 10**5:
            raise ValueError(f"sensor of {self.size[0]}x{self.size[1]} px: width and height must be from 16 to 100000")
        if self.focal is not None and KINDS[self.kind].parallel:
            raise ValueError(
                f"a {self.kind} mirror needs a telecentric lens, which has a magnification instead of a focal length:"
                " leave the focal length out, or choose a hyperbolic mirror"
            )

    def _check_field(self) -> None:
        up, down = np.degrees([self.up, self.down])
        if not (-90 < up < 90 and -90 < down <= 90):
            raise ValueError(
                f"up and down are angles above and below the horizon, less than 90 degrees, got {up:g} and {down:g}"
            )
        if up + down < 1:
            raise ValueError(
                f"the field from {-down:g} to {up:g} degrees is empty: up and down are measured from the horizon;"
                " up 20 and down 60 is a field of 80 degrees"
            )

    def _check_lengths(self) -> None:
        lengths = {"pixel": self.pixel, "focal length": self.focal, "diameter": self.diameter}
        lengths |= {"distance": self.distance, "body": self.body, "working distance": self.working_distance}
        for name, value in lengths.items():
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"the {name} must be a positive length, got {value}")
            if value is not None and value > (limit := MAX_LENGTH_M.get(name, np.inf)):
                raise ValueError(f"the {name} is {value:.4g} m, more than {limit:g} m: check its unit")

    @property
    def theta(self) -> float:
        """Largest angle in view, from straight down (towards the lens), radians."""
        return np.pi / 2 + self.up

    @property
    def max_image_radius(self) -> float:
        """Largest radius of the mirror's image that fits the sensor, metres."""
        return min(self.size) * self.pixel / 2
