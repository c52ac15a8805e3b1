"""The calibration of a camera from images of straight lines, without a board."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines.border import with_border, without_centre
from omnisight.calibration.lines.chains import Chains
from omnisight.calibration.lines.consensus import FEWEST, Consensus, find_lines, select
from omnisight.calibration.lines.once import seen_before
from omnisight.calibration.lines.plumb import Lines, lines_of, refine_lines
from omnisight.calibration.lines.rival import as_model, unlike
from omnisight.calibration.lines.scale import bends_freely, scale_deviation, without_scale
from omnisight.calibration.lines.split_half import widened
from omnisight.calibration.lines.uncertainty import Uncertainty, bearing_deviation
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

# The camera decides anew which arcs are lines, so often; where they are known it is refined so often.
ROUNDS, TRUSTED_ROUNDS = 5, 2
PIXELS = 150
# A doubtful result, and none at all, radians.
UNSURE, LOST = np.radians(3.0), np.radians(30.0)
FEW_LINES = 6
# Another model's bearings that are worth a word, radians.
UNLIKE = np.radians(1.0)
# Past this inflation the lines are of very different worth.
TOGETHER = 80.0
ROUGH_PX = 1.0


@dataclass(frozen=True)
class LinesCalibration:
    """A camera calibrated from lines, and what supports it.

    Attributes
    ----------
    camera
        The camera with its covariance; `theta_max` is how far the lines reach.
    state
        Its model with the plane of each line.
    chains
        The lines; arcs of one line are joined.
    line_of_arc
        (A,) the line that each given arc belongs to, -1 for those that are images of no line.
    uncertainty
        How surely the parameters are known.
    bearing_sd
        Standard deviation of a bearing where the lines are, radians; see `deviation_at`.
    misfit
        Part of it: what a model that bends freely makes of the lines, if it explains them clearly better; and what is
        held, if anything is.
    shape_known
        Whether a known xi tells the scale. It is else told by the model's shape, which no real camera quite has.
    rms
        Root mean square distance of the pixels from their lines, px.
    scale_held
        Whether the lines do not determine the scale of tan(theta) for this model, so that it is the unified model's.
    warnings
        What to doubt, a sentence each.
    """

    camera: Camera
    state: Lines
    chains: Chains
    line_of_arc: NDArray[np.intp]
    uncertainty: Uncertainty
    bearing_sd: float
    misfit: float
    shape_known: bool
    rms: float
    scale_held: bool
    warnings: tuple[str, ...]

    def deviation_at(self, pixels: Array) -> float:
        """Give the standard deviation of the bearings of pixels (N, 2), radians, rms, the camera turned to fit best.

        It is made of the covariance, of the misfit, and of the scale: what real cameras are off the unified model.
        """
        return _deviation(self.state.model, self.uncertainty, pixels, self.misfit, self.shape_known)


def calibrate_lines(
    arcs: Chains,
    size: tuple[int, int],
    *,
    model: str = "unified",
    centre: Array | None = None,
    trusted: bool = False,
    square: bool = True,
    known: Mapping[str, float] | None = None,
    loss: str = "huber",
    seed: int = 0,
    progress: Progress | None = None,
) -> LinesCalibration:
    """Calibrate a camera from images of straight lines, three or more.

    Parameters
    ----------
    arcs
        Pixels along edges of one camera's images. What one camera cannot explain together as images of lines is left
        out.
    size
        (width, height) of the images, px.
    model
        A camera model. What lines say: everything of the unified model but the handedness; of models that bend freely
        everything but the scale of tan(theta), which is then held where the unified model has it.
    centre
        (2,) the middle of the border of what the lens or mirror shows, if one is seen: it tells the principal point,
        but not so surely as many lines do. Lines alone are asked, from the image's middle on, unless it is given.
    trusted
        All arcs are lines: none is left out, none joined.
    square
        Pixels are square: fx = fy.
    known
        Parameters of the model by name that are known and stay: {"xi": 1} for a parabolic mirror.
    loss
        "huber", or "squared" for plain least squares.
    seed
        Of the search.
    progress
        Called with a stage, how much of it is done, and how much there is.

    Raises
    ------
    ValueError
        If a name is unknown, or the lines are too few, explain no camera or do not determine this one.
    """
    report = progress or (lambda stage, done, total: None)
    cls = model_class(model)
    known = known or {}
    if unknown := sorted(set(known) - set(cls.example().param_names)):
        raise ValueError(f"{model} has no {', '.join(unknown)}; it has {', '.join(cls.example().param_names)}")
    if len(arcs) < FEWEST:
        raise ValueError(f"{len(arcs)} lines are too few: {FEWEST} is the least, 10 and more all around are good")
    given = arcs
    told = np.full(len(given), -1) if trusted else seen_before(given)
    own = np.flatnonzero(told < 0)
    arcs = given.subset(own)
    middle = (np.array(size, float) - 1) / 2 if centre is None else centre
    report("find lines", 0, 1)
    found = find_lines(
        arcs, size, middle, known=known if model == "unified" else {}, square=square, trusted=trusted, seed=seed
    )
    report("find lines", 1, 1)

    freedom = FreeParameters.of(found.state.model, square=square, fixed=tuple(known) if model == "unified" else ())
    found = _settled(found, arcs, freedom, trusted, loss, lambda k: report("unified", k, ROUNDS))
    choice = None if trusted else arcs
    found, few, uncertainty = _weighed(found, choice, freedom, centre, loss)
    deviation = bearing_deviation(found.state.model, uncertainty.covariance, few.pixels)
    if model == "unified" and (uncertainty.singular or deviation > LOST):
        raise ValueError(
            f"the lines do not determine the camera: bearings are known to {np.degrees(deviation):.0f} degrees only."
            " Are they long, and bent in the image? A lens without distortion shows them straight whatever its focal"
            " length is: calibrate it with a board"
        )
    misfit = unlike(found.state, few, freedom, uncertainty, choice)
    held = False
    if model != "unified":
        scouted = np.hypot(deviation, misfit)
        start = as_model(cls, found.state, found.chains, square=square, known=known)
        found = Consensus(start, found.chains, found.line_of_arc)
        held = bends_freely(start.model)
        while True:
            freedom = FreeParameters.of(start.model, square=square, fixed=tuple(known))
            if held:
                freedom = without_scale(freedom, start.model, few.pixels)
            settled = _settled(found, arcs, freedom, trusted, loss, lambda k: report(model, k, ROUNDS))
            settled, few, uncertainty = _weighed(settled, choice, freedom, centre, loss)
            deviation = bearing_deviation(settled.state.model, uncertainty.covariance, few.pixels)
            lost = uncertainty.singular or deviation > LOST
            if not lost or held:
                break
            held = True
        found = settled
        if lost:
            raise ValueError(
                f"lines do not determine the parameters of {model}: with some of them changed all straight lines stay"
                " straight; choose another model, or calibrate with a board"
            )
        misfit = float(scouted) if held else unlike(found.state, few, freedom, uncertainty, choice)
    line = np.full(len(given), -1, np.intp)
    line[own] = found.line_of_arc
    line[told >= 0] = line[told[told >= 0]]
    found = Consensus(found.state, found.chains, line)
    return _concluded(found, size, uncertainty, misfit, "xi" in known, held, len(given))


def _settled(
    found: Consensus, arcs: Chains, freedom: FreeParameters, trusted: bool, loss: str, report: Callable[[int], None]
) -> Consensus:
    """Refine the camera on its lines, let it say anew which arcs are lines, and refine it on those."""
    rounds = TRUSTED_ROUNDS if trusted else ROUNDS
    for k in range(rounds):
        report(k)
        if k:
            found = select(found.state.model, arcs, trusted=trusted, joined=k == rounds - 1)
        if len(found.chains) < FEWEST:
            raise ValueError(
                f"of {len(arcs)} arcs only {len(found.chains)} are images of lines; {FEWEST} is the least: take a"
                " image of more straight lines, or draw them (--lines)"
            )
        state = refine_lines(found.state, found.chains.thinned(PIXELS), freedom, loss=loss).state
        found = Consensus(state, found.chains, found.line_of_arc)
    report(ROUNDS)
    return found


def _weighed(
    found: Consensus, arcs: Chains | None, freedom: FreeParameters, centre: Array | None, loss: str
) -> tuple[Consensus, Chains, Uncertainty]:
    """Say how sure the camera is, and let the border, if there is one, speak of its centre; give its thinned lines too.

    The camera then chooses its lines again out of `arcs`, if any are given.
    """
    few = found.chains.thinned(PIXELS)
    uncertainty = widened(Uncertainty.of(found.state, few, freedom), found.state, few, freedom)
    if centre is None or uncertainty.singular:
        return found, few, uncertainty
    model, uncertainty = with_border(found.state.model, uncertainty, centre, few.pixels)
    rest = without_centre(freedom, model)
    for k in range(1 if arcs is None else 2):
        if k and arcs is not None:
            chosen = select(model, arcs, joined=True)
            if len(chosen.chains) < FEWEST:
                break
            found, few = chosen, chosen.chains.thinned(PIXELS)
        state = refine_lines(lines_of(model, few), few, rest, loss=loss).state
        model = state.model
        found = Consensus(state, found.chains, found.line_of_arc)
    return found, few, uncertainty


def _concluded(
    found: Consensus,
    size: tuple[int, int],
    uncertainty: Uncertainty,
    misfit: float,
    shape_known: bool,
    held: bool,
    given: int,
) -> LinesCalibration:
    state, chains = found.state, found.chains
    distances = state.distances(chains)
    feet = state.bearings(chains)
    reach = float(np.nanmax(angle_from_axis(feet)))
    rms = float(np.sqrt((distances**2).mean()))
    total = _deviation(state.model, uncertainty, chains.thinned(PIXELS).pixels, misfit, shape_known)
    figures = {
        "method": "lines",
        "rms": rms,
        "sigma": uncertainty.sigma,
        "lines": len(chains),
        "arcs": int((found.line_of_arc >= 0).sum()),
        "arcs_rejected": int((found.line_of_arc < 0).sum()),
        "pixels": len(chains.pixels),
        "images": len(np.unique(chains.images)),
        "inflation": uncertainty.inflation,
        "bearing_sd_deg": float(np.degrees(total)),
        "model_error_deg": float(np.degrees(misfit)),
        "scale_held": held,
    }
    camera = Camera(state.model, size, theta_max=reach, calibration=figures, covariance=uncertainty.covariance)
    doubts = _doubts(state, chains, rms, total, 0.0 if held else misfit, uncertainty.inflation, held, given)
    line = found.line_of_arc
    return LinesCalibration(camera, state, chains, line, uncertainty, total, misfit, shape_known, rms, held, doubts)


def _deviation(model: CameraModel, uncertainty: Uncertainty, pixels: Array, misfit: float, shape_known: bool) -> float:
    parts = [bearing_deviation(model, uncertainty.covariance, pixels), misfit]
    return float(np.linalg.norm(parts if shape_known else [*parts, scale_deviation(model, pixels)]))


def _doubts(
    state: Lines,
    chains: Chains,
    rms: float,
    deviation: float,
    misfit: float,
    inflation: float,
    held: bool,
    given: int,
) -> tuple[str, ...]:
    found: list[str] = []
    if held:
        found.append(
            f"Lines do not determine the scale of {state.model.name}, for it bends freely: with tan(theta) times any"
            " factor every straight line stays straight. It is held where the unified model has it."
        )
    if len(chains) < FEW_LINES:
        found.append(f"{len(chains)} lines determine a camera, but tell little of its errors; 10 and more are good.")
    if deviation > UNSURE:
        found.append(
            f"Bearings are known to {np.degrees(deviation):.1f} degrees only: take more and longer lines, all around"
            " and bent, or more images."
        )
    if misfit > UNLIKE:
        found.append(
            f"A model that bends freely explains the lines better than {state.model.name}, and sees bearings"
            f" {np.degrees(misfit):.1f} degrees away: try --model kannala_brandt."
        )
    if inflation > TOGETHER:
        found.append(
            f"Whole lines are off {np.sqrt(inflation):.0f} times more than their pixels: among them are likely edges"
            " that are not straight, or the camera is not quite of this model. Look at the drawing (--draw); lines"
            " drawn by hand (--lines) may do better."
        )
    if rms > ROUGH_PX:
        found.append(
            f"The lines' pixels lie {rms:.1f} px off: does {state.model.name} describe this camera, and are these lines"
            " straight?"
        )
    if len(chains) < 0.3 * given:
        found.append(f"Most of the arcs ({given}) are images of no line to this camera; look at the drawing (--draw).")
    return tuple(found)
