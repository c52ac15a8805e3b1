"""Consistency of several boards in one image: a board on a monitor or poster in the background is not the printed one.

Its squares have another aspect or its surface is curved, so the camera would be bent to fit it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.covariance import parts_by_view
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.log_barrier import limit_step
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.targets import Board
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Views = NDArray[np.intp]

# Images with a board from which the camera and the scatter of the boards' errors are known.
MIN_IMAGES = 4
# Probability that a board with the errors of the first boards is left out.
SIGNIFICANCE = 1e-3
# Share of contradicting boards above which all further boards are taken to be of that other kind: some are too small or
# too far away to contradict one by one.
MAX_CONTRADICTING_SHARE = 0.5
# Gauss-Newton steps of a camera that adapts to a further board; the first one leaves a few percent.
ADJUSTMENT_STEPS = 3
# Least rms (px) that counts as an error: exact, noise-free corners agree up to rounding.
MIN_RMS_PX = 1e-6


def leave_out_inconsistent_boards(observations: Observations) -> Observations:
    """Leave out further boards of an image that contradict the camera of the first boards.

    The camera is fitted to the first board of each image, the one with most corners. For a further board, it may move
    within the uncertainty of that fit, because the board may lie where no first board was. The board is left out, with
    a remark on the image, if its rms is above the prediction interval of the rms of the first boards, or if that holds
    for most further boards.

    Returns
    -------
    Observations
        The same ones if no image has several boards, or there are too few images to decide.
    """
    first = np.array([image.views[0] for image in observations.images if len(image.views)], np.intp)
    further = np.setdiff1d(np.arange(len(observations)), first)
    if observations.detections is None or not len(further) or len(first) < MIN_IMAGES:
        return observations
    fitted = observations.subset(first)
    camera = refine(estimate_initial_camera(fitted), fitted).state
    weights = ResidualWeights.estimate(resect(camera.central_model, fitted), fitted)
    state = resect(camera.central_model, observations)
    weights = replace(ResidualWeights.estimate(state, observations), threshold=weights.threshold)
    state = _refine_poses(state, observations, weights)
    expected = _rms_by_view(state, observations, weights)[first]
    rms = _rms_with_adjusted_camera(state, observations, weights, first, further)
    contradicts = rms > prediction_limit(expected)
    if contradicts.mean() > MAX_CONTRADICTING_SHARE:
        contradicts[:] = True
    left_out = dict(zip(further[contradicts].tolist(), rms[contradicts].tolist(), strict=True))
    if not left_out:
        return observations
    return _without(left_out, float(np.median(expected)), observations)


def prediction_limit(rms: Array) -> float:
    """Return the limit (px) that one more rms exceeds with the probability `SIGNIFICANCE`; rms are log-normal."""
    logarithms = np.log(np.maximum(rms, MIN_RMS_PX))
    scatter = float(logarithms.std(ddof=1)) * np.sqrt(1 + 1 / len(logarithms))
    return float(np.exp(logarithms.mean() + stdtrit(len(logarithms) - 1, 1 - SIGNIFICANCE) * scatter))


def _rms_with_adjusted_camera(
    state: State, observations: Observations, weights: ResidualWeights, first: Views, further: Views
) -> Array:
    """Return the rms (px) of each further board by the camera fitted to it and all first boards.

    The first boards count with the information of their normal equations.
    """
    free = FreeParameters.of(state.model)
    information = parts_by_view(Bundle(observations, free, weights), state)[0][first].sum(axis=0)
    rms = list[float]()
    for view in further:
        board, own = observations.subset([view]), weights.subset(observations.rows([view]))
        adjusted, problem = state.subset(np.array([view])), Bundle(board, free, own)
        change = np.zeros(len(information))
        for _ in range(ADJUSTMENT_STEPS):
            (part,), (gradient,) = parts_by_view(problem, adjusted)
            change -= np.linalg.lstsq(information + part, gradient + information @ change, rcond=None)[0]
            model = limit_step(state.model, free.directions @ change)
            adjusted = _refine_poses(replace(adjusted, model=model), board, own)
        rms.append(float(_rms_by_view(adjusted, board, own)[0]))
    return np.array(rms)


def _refine_poses(state: State, observations: Observations, weights: ResidualWeights) -> State:
    return refine(state, observations, free_parameters=FreeParameters.none(state.model), weights=weights).state


def _rms_by_view(state: State, observations: Observations, weights: ResidualWeights) -> Array:
    """Return the rms of the whitened residuals of each view, px; outliers count with the threshold."""
    squares = np.minimum(state.lengths(observations, weights.whitening), weights.threshold) ** 2
    return np.sqrt(np.array([squares[group].mean() for group in observations.groups]))


def _without(rms_of_view: dict[int, float], usual: float, observations: Observations) -> Observations:
    """Return the observations without some views, with remarks on their images."""
    detections = observations.detections
    assert detections is not None
    assert isinstance(detections.board, Board)
    images = list(detections.images)
    for i, (image, observed) in enumerate(zip(images, observations.images, strict=True)):
        left_out = [view for view in observed.views if view in rms_of_view]
        if left_out:
            kept = [d for view, d in zip(observed.views, image.boards, strict=True) if view not in rms_of_view]
            images[i] = image.with_boards(kept, detections.board).with_remark(
                _remark([rms_of_view[view] for view in left_out], usual)
            )
    return Observations.from_detections(replace(detections, images=images), observations.image_names)


def _remark(rms: Sequence[float], usual: float) -> str:
    """Return which boards of an image were left out, and why."""
    which = "a board" if len(rms) == 1 else f"{len(rms)} boards"
    errors = " and ".join(f"{value:.2f}" for value in rms)
    return f"{which} left out, not the printed one: rms {errors} px, first boards {usual:.2f} px"
