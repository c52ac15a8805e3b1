"""What every calibration from boards gives, whatever its camera."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.state import State
from omnisight.quality.verdict import Verdict
from omnisight.targets.observations import Observations

if TYPE_CHECKING:
    from omnisight.quality.quality_report import QualityReport

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CalibrationResult:
    """A camera fitted to boards, and what supports it.

    Attributes
    ----------
    views
        The corners it was calibrated on.
    chosen
        The chosen model, fitted to all of them.
    candidates
        Every model that was tried, on no more corners than tell them apart: the chosen one, then the others, the best
        first.
    reason
        Why this model.
    outliers
        (N,) corners more than five robust standard deviations off.
    trust
        How far it can be trusted.
    """

    views: Observations
    chosen: Candidate
    candidates: tuple[Candidate, ...]
    reason: str
    outliers: NDArray[np.bool_]
    trust: "QualityReport"

    @property
    def state(self) -> State:
        """The model with cam_from_board of every image, and the bend of the board."""
        return self.chosen.state

    @property
    def rms(self) -> float:
        """Length of the residual over all corners, px (root mean square)."""
        return self.chosen.rms

    @property
    def mean(self) -> float:
        """The same (mean)."""
        return self.chosen.mean

    @property
    def held_out_rms(self) -> float | None:
        """The rms over images held out; None with too few images."""
        return self.chosen.held_out_rms

    @property
    def verdict(self) -> Verdict:
        """Whether to use it, and what to do where not."""
        return self.trust.verdict

    @property
    def residual_lengths(self) -> Array:
        """(N,) length of each corner's residual, px."""
        return self.state.lengths(self.views)
