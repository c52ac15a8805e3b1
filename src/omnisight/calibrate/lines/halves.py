"""Whether two halves of the lines agree as well as their uncertainty says."""

import numpy as np

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.plumb import Lines, refine_lines
from omnisight.calibrate.lines.rival import apart
from omnisight.calibrate.lines.uncertainty import Uncertainty, alike, bearing_deviation

# Planes of a half, at least, and the ratio that is more than chance.
FEWEST = 10
CHANCE = 1.5


def widened(uncertainty: Uncertainty, state: Lines, chains: Chains, freedom: Freedom) -> Uncertainty:
    """Widen the covariance until it explains what two halves of the lines differ by (Birge 1932).

    Lines of nearly one plane go to the same half: they would make both wrong alike.
    """
    plane = alike(state.normals)
    if uncertainty.singular or plane.max() + 1 < 2 * FEWEST:
        return uncertainty
    models, predicted = [], 0.0
    for half in (0, 1):
        some = np.flatnonzero(plane % 2 == half)
        part = chains.subset(some)
        own = refine_lines(Lines(state.model, state.normals[some]), part, freedom).state
        said = Uncertainty.of(own, part, freedom)
        predicted += bearing_deviation(own.model, said.covariance, chains.pixels) ** 2
        models.append(own.model)
    ratio = apart(models[0], models[1], chains.pixels) / max(float(np.sqrt(predicted)), 1e-12)
    return uncertainty if ratio < CHANCE else uncertainty.times(ratio)
