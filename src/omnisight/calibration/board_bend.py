"""Board bend test: whether the board bends differently in each image, as a printed sheet without a backing does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.geometry.rotation import hat
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Significance level of the F test: a false alarm in a million calibrations.
SIGNIFICANCE = 1e-6
# Share of the squared residuals, and rms (px), that the bends must explain to matter.
MIN_EXPLAINED, MIN_EXPLAINED_PX = 0.15, 0.1
# Ratio of the squared residuals after displacements across the direction of a height, which no bend causes, to those
# after heights.
MIN_HEIGHT_ADVANTAGE = 1.15
# Corners of a view: a pose and a bend have nine parameters, and a corner two coordinates.
MIN_CORNERS = 12
# Heights that bend a board: x^2, x y and y^2.
BEND_TERMS = 3


@dataclass(frozen=True)
class BoardBendTest(Displayed):
    """How much of the residuals a different bend of the board in each image explains.

    Attributes
    ----------
    explained
        Share of the squared residuals that bends explain beyond a bend that all images share.
    explained_across
        The same for equal displacements across the direction in which a height moves a pixel: what a poor camera model
        explains too, but no bend.
    p_value
        Probability that noise alone explains as much.
    rms
        Root mean square of the explained part, px.
    height
        Root mean square over the images of the height of a bend, relative to the width of the board.
    name
        The view of which most is explained.
    """

    explained: float
    explained_across: float
    p_value: float
    rms: float
    height: float
    name: str

    @property
    def is_positive(self) -> bool:
        """Whether bends that differ between the images explain the residuals significantly and relevantly."""
        heights_are_better = 1 - self.explained_across > MIN_HEIGHT_ADVANTAGE * (1 - self.explained)
        relevant = self.explained > MIN_EXPLAINED and self.rms > MIN_EXPLAINED_PX
        return heights_are_better and relevant and self.p_value < SIGNIFICANCE

    def as_dict(self) -> dict[str, float | str]:
        """Return the figures by name."""
        return {
            "explained": self.explained,
            "explained_across": self.explained_across,
            "p_value": self.p_value,
            "rms_px": self.rms,
            "height": self.height,
            "worst": self.name,
        }

    @property
    def finding(self) -> str:
        """What was found, as a sentence."""
        return (
            f"The board bends differently in each image, like paper without a backing: bends of {self.height:.1%} of"
            f" its width explain {self.explained:.0%} of the squared residuals ({self.rms:.2f} px rms, most in"
            f" {self.name})."
        )


@dataclass(frozen=True)
class _Fits:
    """Normal equations of the bends of all views, their poses eliminated.

    Attributes
    ----------
    squares
        (V, B, B).
    gradients
        (V, B).
    """

    squares: Array
    gradients: Array

    @property
    def solutions(self) -> Array:
        """(V, B) the bend of each view that explains most."""
        return (np.linalg.pinv(self.squares, hermitian=True) @ self.gradients[..., None])[..., 0]

    @property
    def gains(self) -> Array:
        """(V,) squared residuals that the bend of each view explains beyond the one that all views share."""
        common = np.linalg.pinv(self.squares.sum(0), hermitian=True) @ self.gradients.sum(0)
        shared = 2 * self.gradients @ common - np.einsum("i,vij,j->v", common, self.squares, common)
        return (self.solutions * self.gradients).sum(1) - shared


def run_board_bend_test(state: State, observations: Observations) -> BoardBendTest | None:
    """Fit each board a bend and test how much it explains.

    To first order, the height h = b0 x^2 + b1 x y + b2 y^2 of a sheet moves pixels by their derivative by the height.
    Whether bends that differ between the views explain more than noise does is the F test of two nested linear models
    (Draper and Smith, Applied Regression Analysis, 1998, ch. 6), with poses and a bend that all views share in both. An
    error of the camera model is smooth across each board too, but moves pixels in any direction: displacements across
    the direction of a height must explain less.

    None if fewer than two views have enough corners, or the board is not planar.
    """
    if not observations.is_planar:
        return None
    usable = ~ResidualWeights.estimate(state, observations).outliers(state, observations)
    usable &= np.isfinite(state.residuals(observations)).all(1)
    rows = [np.flatnonzero(usable[group]) + group.start for group in observations.groups]
    views = [k for k in range(len(rows)) if len(rows[k]) >= MIN_CORNERS]
    if len(views) < 2:
        return None
    squares, along, across = _fit_bends(state, observations, [(k, rows[k]) for k in views])
    corners = sum(len(rows[k]) for k in views)
    parameters = BEND_TERMS * (len(views) - 1)
    degrees = 2 * corners - (6 + BEND_TERMS) * len(views)
    if degrees <= 0 or squares <= 0:
        return None
    gain = float(along.gains.sum())
    ratio = gain / parameters / max((squares - gain) / degrees, 1e-300)
    heights = along.solutions - along.solutions.mean(0)
    return BoardBendTest(
        gain / squares,
        float(across.gains.sum()) / squares,
        float(fdtrc(parameters, degrees, ratio)),
        float(np.sqrt(max(gain, 0.0) / corners)),
        float(np.sqrt((heights**2).sum(1).mean())) / _width(observations),
        observations.names[views[int(np.argmax(along.gains))]],
    )


def _fit_bends(
    state: State, observations: Observations, views: Sequence[tuple[int, NDArray[np.intp]]]
) -> tuple[float, _Fits, _Fits]:
    """Return the squared residuals that no pose explains, and the fits of heights and of displacements across them.

    Each view is given by its number and the rows of its corners.
    """
    residuals, (points, rotated) = state.residuals(observations), state.points(observations)
    with np.errstate(invalid="ignore"):
        _, _, d_point, _ = state.model.project_with_jacobians(points)
    x, y = ((observations.points[:, :2] - observations.extent.mean(0)) / (_width(observations) / 2)).T
    shapes = np.stack([x * x, x * y, y * y], -1)
    squares, along, across = 0.0, list[tuple[Array, Array]](), list[tuple[Array, Array]]()
    for k, rows in views:
        # A rotation w of the board about its origin moves a point by w x rotated.
        pose = np.concatenate([d_point[rows], -d_point[rows] @ hat(rotated[rows])], axis=2).reshape(-1, 6)
        basis = np.linalg.svd(pose, full_matrices=False)[0]
        rest = residuals[rows].ravel()
        rest = rest - basis @ (basis.T @ rest)
        squares += float(rest @ rest)
        by_height = d_point[rows] @ state.rotations[k, :, 2]
        for fits, direction in ((along, by_height), (across, by_height[:, ::-1] * (-1.0, 1.0))):
            bends = (direction[:, :, None] * shapes[rows, None]).reshape(-1, BEND_TERMS)
            bends = bends - basis @ (basis.T @ bends)
            fits.append((bends.T @ bends, -bends.T @ rest))
    heights, others = (_Fits(*map(np.array, zip(*fits, strict=True))) for fits in (along, across))
    return squares, heights, others


def _width(observations: Observations) -> float:
    return float(np.ptp(observations.extent, axis=0).max())
