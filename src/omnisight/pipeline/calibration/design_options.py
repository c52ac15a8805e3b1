"""Options of `design`; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass

from omnisight.choices import Options


@dataclass(frozen=True)
class DesignOptions(Options):
    """Options of `design`. Lengths are in metres, angles in degrees.

    Two of focal length, diameter and distance determine the third. Without them, the lens sees the mirror within 40
    degrees, and the mirror is 60 mm wide.

    Attributes
    ----------
    kind
        hyperbolic, parabolic (needs a telecentric lens), spherical or conical (both without a single viewpoint).
    up
        Field of view above the horizon, degrees.
    down
        Field of view below the horizon, degrees: the mirror gets a hole where it would show more. Straight down is the
        camera itself.
    sensor
        (width, height), px.
    pixel
        Pixel pitch.
    focal
        Focal length of the lens.
    diameter
        Diameter of the mirror's rim.
    distance
        From the entrance pupil of the lens to the mirror's vertex.
    body
        Diameter of the camera body as the mirror sees it. A telecentric lens is at least as wide as its mirror.
    working_distance
        Scene distance for the parallax of a misaligned mirror.
    """

    kind: str = "hyperbolic"
    up: float = 20.0
    down: float = 60.0
    sensor: tuple[int, int] = (1280, 960)
    pixel: float = 3.75e-6
    focal: float | None = None
    diameter: float | None = None
    distance: float | None = None
    body: float = 0.03
    working_distance: float = 1.0
