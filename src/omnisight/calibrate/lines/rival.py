"""Another camera model for the same lines: as the one that is asked for, and as a rival."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom, squared
from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.consensus import select
from omnisight.calibrate.lines.plumb import HUBER_SIGMAS, Lines, PlumbLine, lines_of, refine_lines
from omnisight.calibrate.lines.scale import without_scale
from omnisight.calibrate.lines.uncertainty import Uncertainty
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optim.loss import Huber

Array = NDArray[np.float64]

STILL = ("skew", "c", "d", "e")
# The fall of chi^2 that the rival's four more numbers bring by chance, on average.
CHANCE = 4.0
PIXELS = 60
# How often the rival chooses its lines.
CHOICES = 2


def as_model(
    cls: type[CameraModel], state: Lines, chains: Chains, *, square: bool, known: Mapping[str, float]
) -> Lines:
    """Give a state with another camera model, fitted to the directions of the lines' pixels.

    Raises
    ------
    ValueError
        If that model cannot describe them.
    """
    few = chains.thinned(PIXELS)
    bearings, valid = state.model.unproject_numpy(few.pixels)
    try:
        model = cls.fit(bearings[valid], few.pixels[valid], fixed=STILL)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"{cls.name} cannot describe this camera: {error}") from None
    return Lines((squared(model) if square else model).with_values(known), state.normals)


def unlike(state: Lines, chains: Chains, freedom: Freedom, uncertainty: Uncertainty, arcs: Chains | None) -> float:
    """Give by how much (radians, rms over the pixels) a model that bends freely sees other bearings.

    It is Kannala and Brandt's, of the same scale, for lines do not tell it. It chooses its own lines out of `arcs`, if
    any are given: those that the first model chose agree with it. Zero where it explains them no better than by chance:
    the model is then as good as the lines can tell.
    """
    few = chains.thinned(PIXELS)
    try:
        rival = as_model(KannalaBrandt, state, few, square=True, known={})
    except ValueError:
        return 0.0
    for _ in range(1 if arcs is None else CHOICES):
        bends = without_scale(Freedom.of(rival.model, square=True), rival.model, few.pixels)
        rival = refine_lines(rival, few, bends, iterations=30, tolerance=1e-6).state
        if arcs is not None:
            few = select(rival.model, arcs).chains.thinned(PIXELS)
            rival = lines_of(rival.model, few)
    bends = without_scale(Freedom.of(rival.model, square=True), rival.model, few.pixels)
    rival = refine_lines(rival, few, bends, iterations=30, tolerance=1e-6).state
    own = refine_lines(lines_of(state.model, few), few, freedom, iterations=10, tolerance=1e-6).state
    judge = PlumbLine(few, Huber(max(HUBER_SIGMAS * uncertainty.sigma, 1e-3)), freedom)
    # Each line counts as one observation, for its pixels err together.
    fall = judge.cost(own) / max(judge.cost(rival), 1e-300) - 1
    if fall * max(len(few) - 4, 1) < CHANCE:
        return 0.0
    return apart(state.model, rival.model, few.pixels)


def apart(first: CameraModel, second: CameraModel, pixels: Array) -> float:
    """Give the angle (radians, rms) between the bearings that two cameras give to pixels (N, 2), turned best."""
    a, valid_a = first.unproject_numpy(pixels)
    b, valid_b = second.unproject_numpy(pixels)
    a, b = a[valid_a & valid_b], b[valid_a & valid_b]
    if not len(a):
        return float(np.pi)
    turned = a @ so3.nearest(b.T @ a).T
    return float(np.sqrt(((turned - b) ** 2).sum(1).mean()))
