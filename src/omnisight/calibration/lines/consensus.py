"""RANSAC consensus over arcs: find the camera for which most arcs are images of straight lines."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines.camera_hypotheses import OUTLIER_PX, is_plausible, rank_hypotheses, truncated_cost
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import PlumbLineState, fit_line_planes, line_sigma, refine_plumb_lines
from omnisight.display import Displayed
from omnisight.models import CameraModel
from omnisight.models.unified import Unified

Array = NDArray[np.float64]

# Three lines in general position determine a camera.
MIN_LINES = 3
# Distinct hypotheses that are refined; two are the same if they differ by less than this in xi and log f, and by less
# than this share of f in the centre.
REFINED_HYPOTHESES, SAME_SHAPE, SAME_CENTRE = 4, 0.25, 0.15
# The longest arcs, and pixels of each, that the search uses: they determine a start as well as all of them.
SEARCH_ARCS, SEARCH_PIXELS = 120, 24
# Maximum rms distance (px) of an inlier arc, and the limits that the search tightens through.
INLIER_PX = 1.5
SEARCH_LIMITS_PX = (OUTLIER_PX, 2.0, INLIER_PX, 1.2)
# An arc is curved, not straight, if its bend exceeds the largest of: this multiple of the typical bend, this many
# standard errors of its rms, and this distance.
BEND_RATIO, BEND_SIGMAS, MIN_BEND_PX = 2.0, 5.0, 0.04
# Short lines are hardly curved even if distorted: they are dropped where so many longer ones exist.
LONG_LINE_RAD, MIN_LONG_LINES = np.radians(12.0), 12


@dataclass(frozen=True)
class LineConsensus(Displayed):
    """The arcs that one camera explains as images of lines.

    Attributes
    ----------
    state
        The camera and the plane of each line.
    lines
        Pixels of the lines; arcs of one line are joined.
    line_of_arc
        (A,) index of the line that each arc belongs to, -1 for outliers.
    """

    state: PlumbLineState
    lines: PixelChains
    line_of_arc: NDArray[np.intp]


def find_consensus(
    arcs: PixelChains,
    size: tuple[int, int],
    centre: Array,
    *,
    fixed: Mapping[str, float],
    square: bool = True,
    all_inliers: bool = False,
    seed: int = 0,
) -> LineConsensus:
    """Find the unified camera that explains most arcs, and the inlier arcs.

    The best distinct hypotheses are refined on their inliers with a tightening limit; the one of least truncated cost
    is kept.

    Parameters
    ----------
    arcs
        Detected arcs, images of lines and others.
    size
        (width, height) px.
    centre
        (2,) expected principal point.
    fixed
        Known parameters of the unified model by name.
    square
        Whether pixels are square: fx = fy.
    all_inliers
        Whether every arc is a line: none is rejected, none joined.
    seed
        Seed of the random hypotheses.

    Raises
    ------
    ValueError
        If no camera explains three of the arcs.
    """
    samples = arcs.subset(arcs.longest_first()[:SEARCH_ARCS]).subsample(SEARCH_PIXELS)
    best, least_cost = None, np.inf
    for start in _distinct(rank_hypotheses(samples, size, centre, fixed=fixed, seed=seed)):
        free_parameters = FreeParameters.of(start, square=square, fixed=tuple(fixed))
        model = _refine_hypothesis(start, samples, free_parameters, all_inliers)
        if model is None or not is_plausible(model, size, centre):
            continue
        distances = fit_line_planes(model, samples).distances(samples)
        cost = truncated_cost(distances, samples, samples.arc_lengths, INLIER_PX)
        if cost < least_cost:
            best, least_cost = model, cost
    if best is None:
        raise ValueError(
            f"no camera explains {MIN_LINES} of {len(arcs)} lines: check that they are images of straight lines, and"
            " long enough to be bent by the lens or mirror"
        )
    return select_lines(best, arcs, all_inliers=all_inliers)


def select_lines(
    model: CameraModel, arcs: PixelChains, *, all_inliers: bool = False, join: bool = False
) -> LineConsensus:
    """Select the arcs that are images of lines for a camera.

    With `join`, arcs of one image on one great circle become one line: a partly occluded line consists of several arcs.
    """
    state = fit_line_planes(model, arcs)
    if all_inliers:
        return LineConsensus(state, arcs, np.arange(len(arcs)))
    inliers = np.flatnonzero(_is_straight(state, arcs))
    groups = _join_collinear_arcs(model, arcs, inliers) if join else [[int(i)] for i in inliers]
    lines = PixelChains.from_arrays(
        [np.concatenate([arcs.pixels[arcs.groups[k]] for k in members]) for members in groups],
        [int(arcs.image_ids[members[0]]) for members in groups],
    )
    state = fit_line_planes(model, lines)
    is_long = state.angular_extents(lines) > LONG_LINE_RAD
    if is_long.sum() >= MIN_LONG_LINES:
        kept = np.flatnonzero(is_long)
        lines, groups = lines.subset(kept), [groups[i] for i in kept]
        state = PlumbLineState(model, state.normals[is_long])
    line_of_arc = np.full(len(arcs), -1, np.intp)
    for i, members in enumerate(groups):
        line_of_arc[members] = i
    return LineConsensus(state, lines, line_of_arc)


def _is_straight(state: PlumbLineState, arcs: PixelChains) -> NDArray[np.bool_]:
    """Return which arcs (L,) bend as the image of a line does.

    The bend is what a free circle explains of an arc and its great circle does not: rough edges deviate to both sides
    and have none, curves deviate to one side. The typical bend, weighted towards long arcs, is the model's own error.
    """
    rms = arcs.rms_by_chain(state.distances(arcs))
    bend = np.sqrt(np.maximum(rms**2 - arcs.circle_rms**2, 0.0))
    is_close = rms < INLIER_PX
    if not is_close.any():
        return is_close
    order = np.argsort(bend)
    weight = np.cumsum(np.where(is_close, arcs.arc_lengths**2, 0.0)[order])
    typical_bend = float(bend[order][np.searchsorted(weight, weight[-1] / 2)])
    noise = BEND_SIGMAS * arcs.circle_rms / np.sqrt(arcs.counts)
    return is_close & (bend < np.maximum(max(BEND_RATIO * typical_bend, MIN_BEND_PX), noise))


def _distinct(cameras: list[Unified]) -> list[Unified]:
    """Return the first distinct cameras: similar ones converge to the same minimum."""
    kept: list[Unified] = []
    for camera in cameras:
        if len(kept) == REFINED_HYPOTHESES:
            break
        if not any(_is_similar(camera, other) for other in kept):
            kept.append(camera)
    return kept


def _is_similar(camera: Unified, other: Unified) -> bool:
    return bool(
        abs(camera.xi - other.xi) < SAME_SHAPE
        and np.hypot(camera.cx - other.cx, camera.cy - other.cy) < SAME_CENTRE * other.fx
        and abs(np.log(camera.fx / other.fx)) < SAME_SHAPE
    )


def _refine_hypothesis(
    start: Unified, arcs: PixelChains, free_parameters: FreeParameters, all_inliers: bool
) -> CameraModel | None:
    """Refine a camera on its inliers with a tightening limit; return None if fewer than three arcs remain."""
    model: CameraModel = start
    # With inliers only, no selection follows; a few lines have several minima, so converge at once.
    for limit in SEARCH_LIMITS_PX[:1] if all_inliers else SEARCH_LIMITS_PX:
        fitted = fit_line_planes(model, arcs)
        rms = arcs.rms_by_chain(fitted.distances(arcs))
        inliers = np.arange(len(arcs)) if all_inliers else np.flatnonzero(rms < limit)
        if len(inliers) < MIN_LINES:
            return None
        iterations, tolerance = (40, 1e-7) if all_inliers else (10, 1e-3)
        initial = PlumbLineState(model, fitted.normals[inliers])
        model = refine_plumb_lines(
            initial, arcs.subset(inliers), free_parameters, iterations=iterations, tolerance=tolerance
        ).state.model
    return model


def _join_collinear_arcs(model: CameraModel, arcs: PixelChains, inliers: NDArray[np.intp]) -> list[list[int]]:
    """Group arcs of one image that one great circle explains, greedily from the longest."""
    if not len(inliers):
        return []
    grouping = _LineGrouping(model, arcs.subsample(SEARCH_PIXELS), inliers)
    longest_first = inliers[np.argsort(-arcs.arc_lengths[inliers], kind="stable")]
    for arc in longest_first.tolist():
        grouping.add(arc)
    return grouping.groups


class _LineGrouping:
    """Greedy grouping of arcs into lines."""

    # Arcs whose own normals differ by more than acos(0.9), about 26 degrees, or with a pixel farther than this from
    # the great circle, are not fitted jointly.
    MIN_NORMAL_COSINE, MAX_PIXEL_ANGLE_RAD = 0.9, np.radians(4.0)
    # An arc determines the direction of its line over a gap of about twice its own length.
    MAX_GAP_RATIO = 2.0
    # Increase of the rms distance that a joint fit may cause: about the scatter of the rms of 24 pixels.
    MAX_RMS_RATIO = 1.3

    def __init__(self, model: CameraModel, arcs: PixelChains, inliers: NDArray[np.intp]) -> None:
        self.model, self.arcs = model, arcs
        single = fit_line_planes(model, arcs)
        self.own_normals, self.own_rms = single.normals, arcs.rms_by_chain(single.distances(arcs))
        self.sigma = line_sigma(PlumbLineState(model, single.normals[inliers]), arcs.subset(inliers))
        self.bearings = np.nan_to_num(model.unproject_numpy(arcs.pixels)[0])
        self.groups: list[list[int]] = []
        self.normals: list[Array] = []

    def add(self, arc: int) -> None:
        """Add an arc to the first group that it is collinear with, or to a new one."""
        for k, members in enumerate(self.groups):
            if not self._is_near(arc, members, self.normals[k]):
                continue
            normal = self._joint_normal(arc, members)
            if normal is not None:
                members.append(arc)
                self.normals[k] = normal
                return
        self.groups.append([arc])
        self.normals.append(self.own_normals[arc])

    def _is_near(self, arc: int, members: list[int], normal: Array) -> bool:
        """Return whether an arc lies close to a group's great circle and to its arcs."""
        ids, slices = self.arcs.image_ids, self.arcs.groups
        if ids[members[0]] != ids[arc] or abs(normal @ self.own_normals[arc]) < self.MIN_NORMAL_COSINE:
            return False
        own = self.bearings[slices[arc]]
        if np.abs(own @ normal).max() > self.MAX_PIXEL_ANGLE_RAD:
            return False
        others = np.concatenate([self.bearings[slices[m]] for m in members])
        length, gap = (float(np.arccos(np.clip(c, -1, 1))) for c in (own[0] @ own[-1], (own @ others.T).max()))
        return gap <= self.MAX_GAP_RATIO * length

    def _joint_normal(self, arc: int, members: list[int]) -> Array | None:
        """Return the normal of a joint fit if it explains the arcs about as well as their own fits."""
        pixels = np.concatenate([self.arcs.pixels[self.arcs.groups[m]] for m in [*members, arc]])
        joined = PixelChains.from_arrays([pixels])
        joint = fit_line_planes(self.model, joined)
        distances = joint.distances(joined)
        rms_of_arc = np.sqrt((distances[-self.arcs.counts[arc] :] ** 2).mean())
        rms_of_all = np.sqrt((distances**2).mean())
        largest_own = self.own_rms[[*members, arc]].max()
        fits_arc = rms_of_arc < max(self.MAX_RMS_RATIO * self.own_rms[arc], self.sigma)
        fits_all = rms_of_all < max(self.MAX_RMS_RATIO * largest_own, self.sigma)
        return joint.normals[0] if fits_arc and fits_all else None
