"""Choosing a camera model by the images it has not seen."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.geometry.sphere import angle_from_axis
from omnisight.targets.observations import Observations

AUTO = ("unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam")
FEW_PARAMETERS = ("unified", "eucm", "double_sphere")
NARROW_AUTO = ("radial_tangential",)
NARROW = np.radians(62.0)
# A model is not asked about images it has not seen where it explains those it has so much worse than the best.
HOPELESS = 1.5
# Held-out figures this close are the same: the model with fewer parameters is taken.
TIE = 0.01
# An image should go on for so many times the angle that corners reach.
ROOM = 1.03


def choose(candidates: Sequence[Candidate], views: Observations, usable: NDArray[np.bool_]) -> tuple[Candidate, str]:
    """Give the best candidate and one sentence that says why.

    Of those that are as good as the best on images held out, the one with the fewest parameters: whose mean square is
    above by no more than its standard error over the images (Breiman et al., Classification and regression trees,
    1984, sec. 3.4.3), both asked about the same images. A model whose image folds over just past the corners comes
    last: what lies a little farther out it cannot see at all.
    """
    judged = [c for c in candidates if c.held_out_rms is not None]
    asked = [c for c in judged if not _folds(c, views, usable)] or judged
    if not asked:
        best = min(candidates, key=lambda c: (round(c.rms, 3), c.parameters))
        return (
            best,
            f"{best.name}: too few images to hold any out, so the least rms decides ({best.rms:.3f} px).",
        )
    lowest = min(asked, key=lambda c: c.held_out_rms or 0)
    near = [c for c in asked if _as_good(c, lowest, views, usable)]
    best = min(near, key=lambda c: (c.parameters, c.held_out_rms or 0))
    others = [c for c in asked if c is not best]
    figure = f"{best.held_out_rms:.3f} px on images it was not calibrated on"
    if not others and len(candidates) > 1:
        worse = f"{HOPELESS:g} times worse"
        return best, f"{best.name}: {figure}; the others explain even those they were calibrated on {worse}."
    if not others:
        return best, f"{best.name}: {figure}."
    second = min(others, key=lambda c: c.held_out_rms or 0)
    passed = min(judged, key=lambda c: c.held_out_rms or 0)
    if passed not in asked:
        why = f"the least of those that do not fold over past the corners, as {passed.name} does"
    elif best is not lowest:
        why = (
            f"as good as {lowest.name} ({lowest.held_out_rms:.3f} px) as far as so many images can tell, with"
            f" {best.parameters} parameters instead of {lowest.parameters}"
        )
    else:
        why = f"the least of {len(asked)}; next is {second.name} with {second.held_out_rms:.3f} px"
    return best, f"{best.name}: {figure}, {why}."


def _folds(candidate: Candidate, views: Observations, usable: NDArray[np.bool_]) -> bool:
    angles = angle_from_axis(candidate.state.points(views)[0])[usable]
    return candidate.state.model.theta_max < min(ROOM * float(angles.max(initial=0.0)), np.pi)


def _as_good(candidate: Candidate, lowest: Candidate, views: Observations, usable: NDArray[np.bool_]) -> bool:
    if (candidate.held_out_rms or 0) <= (1 + TIE) * (lowest.held_out_rms or 0):
        return True
    if candidate.held_out_lengths is None or lowest.held_out_lengths is None:
        return False
    worse = np.where(usable, candidate.held_out_lengths**2 - lowest.held_out_lengths**2, 0.0)
    by_view = np.bincount(views.view_of_row, worse, len(views))
    return bool(by_view.mean() <= by_view.std(ddof=1) / np.sqrt(len(views)))
