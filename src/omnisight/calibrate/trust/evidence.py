"""What a verdict is taken from, and how good each thing in it leaves a calibration."""

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.trust.ceiling import Ceiling
from omnisight.calibrate.trust.coverage import Coverage
from omnisight.calibrate.trust.halves import Halves
from omnisight.calibrate.trust.uncertainty import UncertaintyMap
from omnisight.calibrate.views import BoardViews
from omnisight.camera import Camera

if TYPE_CHECKING:
    from omnisight.calibrate.rays.ask import Asked


class Level(IntEnum):
    """How good a calibration is."""

    GOOD = 0
    USABLE = 1
    DO_NOT_USE = 2

    def __str__(self) -> str:
        return ("good", "usable", "do not use")[self]


@dataclass(frozen=True)
class Check:
    """One thing that can be wrong with a calibration.

    Attributes
    ----------
    name
        What was looked at.
    level
        How good it leaves the calibration.
    sentence
        What was found and what to do; empty where nothing is wrong.
    """

    name: str
    level: Level = Level.GOOD
    sentence: str = ""


@dataclass(frozen=True)
class Evidence:
    """What a verdict is taken from."""

    camera: Camera
    best: Candidate
    views: BoardViews
    uncertainty: UncertaintyMap
    coverage: Coverage
    halves: Halves | None
    ceiling: Ceiling | None
    viewpoint: "Asked | None"
    outliers: NDArray[np.bool_]
    auto: bool

    @property
    def scale(self) -> float:
        """How much larger errors may be than in a picture 1000 px wide."""
        return self.camera.px_unit
