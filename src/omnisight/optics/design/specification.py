"""What a mirror is ordered by."""

from dataclasses import dataclass

import numpy as np

from omnisight.optics.design.shapes import KINDS

# How much of the sensor's shorter side the image of the mirror takes where the lens is chosen to suit.
FILL = 0.98
# Metres; what is larger is a unit mistaken for another.
LARGEST = {"pixel": 1e-4, "focal length": 1.0, "diameter": 10.0, "distance": 100.0, "body": 10.0}


@dataclass(frozen=True)
class MirrorSpecification:
    """What a mirror camera has to be; the mirror hangs above its lens, the axis upright.

    Attributes
    ----------
    kind
        One of `KINDS`.
    up, down
        How far it sees above and below the horizon, radians.
    size
        (width, height) of the sensor, px.
    pixel
        Side of a pixel, metres.
    focal
        Of the lens, metres; None to have it chosen.
    diameter
        Of the mirror's rim, metres; None to have it chosen.
    distance
        From the lens' centre to the mirror's vertex, metres; None to have it chosen.
    body
        Diameter of the lens and of what else of the camera the mirror sees beside it, metres.
    working_distance
        How far things are, metres: what a lost viewpoint costs is told there.
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
        """Refuse what no mirror can be."""
        if self.kind not in KINDS:
            raise ValueError(f"unknown kind of mirror {self.kind!r}; there are: {', '.join(KINDS)}")
        up, down = np.degrees([self.up, self.down])
        if not (-90 < up < 90 and -90 < down <= 90):
            raise ValueError(
                f"up and down are degrees above and below the horizon, less than 90, got {up:g} and {down:g}"
            )
        if up + down < 1:
            raise ValueError(
                f"the field from {-down:g} to {up:g} degrees is empty: up and down are counted from the horizon,"
                " up 20 and down 60 is a field of 80 degrees"
            )
        lengths = {"pixel": self.pixel, "focal length": self.focal, "diameter": self.diameter}
        lengths |= {"distance": self.distance, "body": self.body, "working distance": self.working_distance}
        for name, value in lengths.items():
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"the {name} must be a positive length, got {value}")
            if value is not None and value > (most := LARGEST.get(name, np.inf)):
                raise ValueError(f"the {name} is {value:.4g} m, the most thought of is {most:g} m: is its unit right?")
        if min(self.size) < 16 or max(self.size) > 10**5:
            few = "few" if min(self.size) < 16 else "many"
            raise ValueError(f"the sensor has {self.size[0]}x{self.size[1]} px: too {few} for an image")
        if self.focal is not None and KINDS[self.kind].parallel:
            raise ValueError(
                f"a {self.kind} mirror needs a telecentric lens, that has a magnification in place of a focal length:"
                " leave the focal length out, or choose a hyperbolic mirror"
            )

    @property
    def theta(self) -> float:
        """The largest angle seen, from the axis towards the lens (straight down), radians."""
        return np.pi / 2 + self.up

    @property
    def half(self) -> float:
        """The largest radius of the mirror's image that the sensor holds, metres."""
        return min(self.size) * self.pixel / 2
