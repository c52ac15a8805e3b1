"""Calibration from lines: the camera is found, the uncertainty is true, and what is no line is left out."""

import numpy as np
import pytest

from arcs import HYPERBOLIC, PARABOLIC, SIZE, line_images
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines import (
    Chains,
    Lines,
    Uncertainty,
    apart,
    bearing_deviation,
    calibrate_lines,
    lines_of,
    refine_lines,
)
from omnisight.calibration.lines.border import with_border, without_centre
from omnisight.calibration.lines.once import seen_before
from omnisight.calibration.lines.scale import shape_doubt
from omnisight.models import model_class
from omnisight.models.unified import Unified

# -- the whole calibration ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("truth", [PARABOLIC, HYPERBOLIC, Unified(760.0, 760.0, 630.0, 520.0, 2.0)])
@pytest.mark.parametrize("count", [3, 6])
def test_exact_lines_give_the_exact_camera(truth, count):
    arcs, _ = line_images(truth, count)
    found = calibrate_lines(Chains.of(arcs), SIZE, trusted=True)
    assert found.camera.model.params == pytest.approx(truth.params, abs=1e-4)
    assert found.rms < 1e-6


def test_errors_are_as_large_as_stated():
    off = []
    for seed in range(6):
        arcs, _ = line_images(HYPERBOLIC, 8, noise=1.0, seed=seed, pixels=60)
        found = calibrate_lines(Chains.of(arcs), SIZE, trusted=True)
        deviation = np.sqrt(np.diagonal(found.camera.covariance))[[0, 2, 3, 4]]
        off.append((found.camera.model.params - HYPERBOLIC.params)[[0, 2, 3, 4]] / deviation)
        assert found.uncertainty.sigma == pytest.approx(1.0, rel=0.12)
    # 24 normal variables, many of them correlated.
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_pixels_that_err_together_widen_the_uncertainty():
    rng = np.random.default_rng(3)
    arcs, _ = line_images(HYPERBOLIC, 12, noise=0.1)
    waves = [0.5 * np.sin(np.linspace(0, 9, len(arc)) + rng.uniform(0, 6)) for arc in arcs]
    wavy = [arc + wave[:, None] for arc, wave in zip(arcs, waves, strict=True)]
    found = calibrate_lines(Chains.of(wavy), SIZE, trusted=True)
    assert found.uncertainty.inflation > 3
    assert apart(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sd


def test_a_known_parabola_is_found_better_and_xi_stays():
    arcs, _ = line_images(PARABOLIC, 6, noise=1.0, seed=1)
    free = calibrate_lines(Chains.of(arcs), SIZE, trusted=True)
    known = calibrate_lines(Chains.of(arcs), SIZE, known={"xi": 1.0}, trusted=True)
    assert known.camera.model.to_dict()["xi"] == 1.0
    assert known.bearing_sd < free.bearing_sd
    assert known.camera.covariance[0, 0] < 0.25 * free.camera.covariance[0, 0]
    assert apart(known.camera.model, PARABOLIC, np.concatenate(arcs)) < 3 * known.bearing_sd


def test_curved_edges_are_left_out_and_parts_of_a_line_joined():
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.3, seed=5, pixels=160)
    rng = np.random.default_rng(1)
    bent = []
    for k in range(8):  # circles of the scene: of any place and bend
        turn = np.linspace(0, 1.6, 160) + rng.uniform(0, 6)
        middle, radius = rng.uniform((400, 300), (880, 720)), 60 + 12 * k
        bent.append(middle + radius * np.stack([np.cos(turn), np.sin(turn)], -1) + 0.3 * rng.normal(size=(160, 2)))
    halves = [part for arc in arcs[:4] for part in (arc[:70], arc[90:])]
    chains = Chains.of([*halves, *arcs[4:], *bent])
    found = calibrate_lines(chains, SIZE)
    true, false = found.line_of_arc[:18], found.line_of_arc[18:]
    assert (true >= 0).all()
    assert (false >= 0).sum() <= 1
    assert (true[0:8:2] == true[1:8:2]).all()
    assert apart(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sd
    assert found.camera.calibration["method"] == "lines"
    assert found.camera.calibration["arcs_rejected"] == (found.line_of_arc < 0).sum()


def test_an_edge_that_stands_still_in_many_pictures_is_told_once():
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.2, seed=5, pixels=160)
    rng = np.random.default_rng(2)
    again = [arc + 0.2 * rng.normal(size=arc.shape) for _ in range(3) for arc in arcs[:6]]
    chains = Chains.of([*arcs, *again], [0] * 14 + [1] * 6 + [2] * 6 + [3] * 6)
    told = seen_before(chains)
    assert (told >= 0).sum() == 18
    found = calibrate_lines(chains, SIZE)
    assert len(found.chains) == 14
    assert (found.line_of_arc[14:].reshape(3, 6) == found.line_of_arc[:6]).all()
    assert (seen_before(Chains.of([*arcs, *again])) < 0).all()  # in one image they are different edges


def test_a_line_spans_the_angle_between_its_ends():
    turn = np.linspace(0, np.radians(70), 40)[:, None]
    bearings = np.cos(turn) * [0.6, 0, 0.8] + np.sin(turn) * [0, 1.0, 0]
    chains = Chains.of([HYPERBOLIC.project_numpy(bearings)[0]])
    assert lines_of(HYPERBOLIC, chains).extents(chains) == pytest.approx([np.radians(70)], abs=1e-6)


@pytest.mark.parametrize("name", ["equidistant", "equisolid", "fov"])
def test_what_is_stated_holds_what_a_lens_of_another_shape_takes_from_the_scale(name):
    values = model_class(name).example().to_dict()
    values |= {"cx": 640.0, "cy": 512.0, "fy": values["fx"]}
    truth = model_class(name).from_dict(values)
    pixels = np.concatenate(arcs := line_images(truth, 30, radii=(30, 400))[0])
    found = calibrate_lines(Chains.of(arcs), SIZE, trusted=True)
    # Its lines are straight to a unified model of another scale: their residuals tell nothing of that.
    error = apart(found.camera.model, truth, pixels)
    assert error > 5 * bearing_deviation(found.camera.model, found.camera.covariance, pixels)
    assert error < 2 * found.deviation_at(pixels)


def bearings_between(low_deg, high_deg):
    theta, turn = np.radians(np.linspace(low_deg, high_deg, 200)), 2.4 * np.arange(200)
    return np.stack([np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)], -1)


def test_families_of_shapes_agree_on_the_scale_of_a_parabolic_mirror_and_disagree_on_that_of_a_lens():
    mirror, rim = shape_doubt(PARABOLIC, bearings_between(18, 105)), bearings_between(1, 90)
    assert mirror < 1e-6  # r = tan(theta/2) is of both
    equidistant = model_class("equidistant")(318.0, 318.0, 520.0, 506.0)
    # To lines of 90 degrees an equidistant lens is the unified one of xi = 1.51, with tan(theta) 6 % larger.
    assert shape_doubt(equidistant, rim) == pytest.approx(0.06, abs=0.005)
    assert shape_doubt(Unified(318.0, 318.0, 520.0, 506.0, 1.51), rim) == pytest.approx(0.06, abs=0.005)
    # The rarer the shape, the less sure: a lens between orthographic and none.
    doubts = [shape_doubt(Unified(300.0, 300.0, 500.0, 500.0, xi), rim) for xi in (1.2, 1.6, 2.5, 6.0)]
    assert (np.diff(doubts) > 0.02).all()
    # Where the image's scale cannot be told apart at all, that is said.
    assert shape_doubt(PARABOLIC, np.zeros((0, 3))) == 0.5


def test_the_middle_of_the_border_is_weighed_by_what_is_stated_of_the_lines():
    pixels = HYPERBOLIC.project_numpy(bearings_between(20, 100))[0]
    names = HYPERBOLIC.param_names
    u = names.index("cx")
    said = np.zeros((len(names), len(names)))
    said[u, u] = said[u + 1, u + 1] = 3.0**2
    said[0, 0], said[0, u], said[u, 0] = 4.0**2, 6.0, 6.0
    lines = Uncertainty(said, 0.1, 4.0, False)
    middle = np.array([HYPERBOLIC.cx + 1.0, HYPERBOLIC.cy])
    aside = 0.009 * np.linalg.norm(pixels - middle, axis=1).max()
    model, both = with_border(HYPERBOLIC, lines, middle, pixels)
    # Two measurements of one number: the mean by their information.
    share = 9 / (9 + aside**2)
    assert model.cx == pytest.approx(HYPERBOLIC.cx + share)
    assert both.covariance[u, u] == pytest.approx(1 / (1 / 9 + 1 / aside**2))
    assert model.fx == pytest.approx(HYPERBOLIC.fx + 6 / (9 + aside**2))  # what goes with the centre follows it
    # A border that lies where neither has it: both are said to be less sure.
    far = with_border(HYPERBOLIC, lines, middle + 40, pixels)[1]
    assert far.covariance[u, u] > 4 * both.covariance[u, u]
    # Sure lines do not follow it.
    sure = Uncertainty(said * 1e-4, 0.1, 1.0, False)
    assert abs(with_border(HYPERBOLIC, sure, middle, pixels)[0].cx - HYPERBOLIC.cx) < 1e-3


def test_a_border_tells_the_centre_where_few_lines_do_not():
    arcs, _ = line_images(PARABOLIC, 4, noise=1.0, seed=4)
    pixels, middle = np.concatenate(arcs), np.array([PARABOLIC.cx + 1.0, PARABOLIC.cy - 1.0])
    alone = calibrate_lines(Chains.of(arcs), SIZE, trusted=True)
    helped = calibrate_lines(Chains.of(arcs), SIZE, trusted=True, centre=middle)
    errors = [apart(found.camera.model, PARABOLIC, pixels) for found in (alone, helped)]
    assert errors[1] < 0.5 * errors[0]
    assert helped.bearing_sd < alone.bearing_sd
    assert errors[1] < 2 * helped.bearing_sd


def test_a_centre_that_is_held_stays_whatever_else_moves():
    freedom = without_centre(FreeParameters.of(HYPERBOLIC, square=True), HYPERBOLIC)
    names = HYPERBOLIC.param_names
    assert freedom.directions.shape[1] == 2  # the focal length and xi
    assert np.abs(freedom.directions[[names.index("cx"), names.index("cy")]]).max() < 1e-12


def test_an_arc_far_along_a_great_circle_is_no_part_of_its_line():
    # Of one great circle, but 90 degrees away: who sees 12 degrees of a line cannot say that it comes back there.
    turn = np.radians(np.concatenate([np.linspace(-50, -10, 60), np.linspace(80, 92, 40)]))[:, None]
    bearings = np.cos(turn) * [0.8, 0, 0.6] + np.sin(turn) * [0, 1.0, 0]
    pixels, valid = HYPERBOLIC.project_numpy(bearings)
    assert valid.all()
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.05, seed=5, pixels=160)
    chains = Chains.of([*arcs, pixels[:60], pixels[60:]])
    found = calibrate_lines(chains, SIZE)
    assert found.line_of_arc[14] >= 0
    assert found.line_of_arc[15] != found.line_of_arc[14]


def test_a_known_xi_leaves_no_doubt_about_the_scale():
    known = calibrate_lines(Chains.of(line_images(PARABOLIC, 8)[0]), SIZE, known={"xi": 1.0}, trusted=True)
    assert known.bearing_sd < 1e-6


def test_lines_that_come_in_bundles_say_less_than_their_number():
    rng = np.random.default_rng(3)
    arcs, normals = line_images(HYPERBOLIC, 50, noise=0.1)
    chains = Chains.of(arcs)
    free = FreeParameters.of(HYPERBOLIC, square=True)
    once = Uncertainty.of(refine_lines(Lines(HYPERBOLIC, normals), chains, free).state, chains, free)
    bundle = Chains.of([arc + 0.1 * rng.normal(size=2) for arc in arcs for _ in range(4)])
    state = refine_lines(Lines(HYPERBOLIC, np.repeat(normals, 4, axis=0)), bundle, free).state
    many = Uncertainty.of(state, bundle, free)
    # Four copies of the same errors: half the deviation would be said if they were independent.
    deviations = [np.sqrt(np.diagonal(u.covariance))[[0, 2, 3, 4]] for u in (once, many)]
    assert (deviations[1] > 0.75 * deviations[0]).all()


@pytest.mark.parametrize(
    ("arcs", "message"),
    [
        ([np.zeros((5, 3))], r"line 1: needs pixels of shape \(n, 2\), got \(5, 3\)"),
        ([np.zeros((2, 2))], "line 1: has 2 pixels; 3 is the least"),
        ([np.full((5, 2), np.nan)], "line 1: a pixel is not a finite number"),
    ],
)
def test_chains_that_are_none_are_refused(arcs, message):
    with pytest.raises(ValueError, match=message):
        Chains.of(arcs)


def test_too_few_lines_and_unknown_names_are_refused():
    arcs, _ = line_images(HYPERBOLIC, 3)
    with pytest.raises(ValueError, match="2 lines are too few: 3 is the least"):
        calibrate_lines(Chains.of(arcs[:2]), SIZE)
    with pytest.raises(ValueError, match="unified has no k1; it has fx"):
        calibrate_lines(Chains.of(arcs), SIZE, known={"k1": 0.0})
    with pytest.raises(ValueError, match="unknown camera model 'nonsense'"):
        calibrate_lines(Chains.of(arcs), SIZE, model="nonsense")
