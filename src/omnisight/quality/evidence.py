"""What a verdict is taken from, and how good each thing in it leaves a calibration."""

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.camera import Camera
from omnisight.quality.coverage import Coverage
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.quality.split_half import SplitHalfTest
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.targets.observations import Observations

if TYPE_CHECKING:
    from omnisight.quality.noncentral_test import NonCentralityTest


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
    views: Observations
    uncertainty: UncertaintyMap
    coverage: Coverage
    halves: SplitHalfTest | None
    ceiling: SplineBaseline | None
    viewpoint: "NonCentralityTest | None"
    outliers: NDArray[np.bool_]
    auto: bool

    @property
    def scale(self) -> float:
        """How much larger errors may be than in an image 1000 px wide."""
        return self.camera.px_unit
