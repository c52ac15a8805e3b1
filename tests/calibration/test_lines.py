"""Calibration from lines: accuracy, stated uncertainty, rejection of outliers."""

import numpy as np
import pytest

from arcs import HYPERBOLIC, PARABOLIC, calibrate_arcs, calibrate_drawn, line_images
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines import (
    LinesUncertainty,
    PixelChains,
    PlumbLineState,
    bearing_difference,
    bearing_sigma,
    deduplicate_static_arcs,
    fit_line_planes,
    refine_plumb_lines,
)
from omnisight.calibration.lines.focal_scale import scale_ambiguity
from omnisight.calibration.lines.uncertainty import fix_principal_point, update_with_border_centre
from omnisight.models import model_class
from omnisight.models.unified import Unified


@pytest.mark.parametrize("truth", [PARABOLIC, HYPERBOLIC, Unified(760.0, 760.0, 630.0, 520.0, 2.0)])
@pytest.mark.parametrize("count", [3, 6])
def test_exact_lines_give_the_exact_camera(truth, count):
    arcs, _ = line_images(truth, count)
    found = calibrate_drawn(arcs)
    assert found.camera.model.params == pytest.approx(truth.params, abs=1e-4)
    assert found.rms < 1e-6


def test_errors_match_the_stated_uncertainty():
    off = []
    for seed in range(6):
        arcs, _ = line_images(HYPERBOLIC, 8, noise=1.0, seed=seed, pixels=60)
        found = calibrate_drawn(arcs)
        deviation = np.sqrt(np.diagonal(found.camera.covariance))[[0, 2, 3, 4]]
        off.append((found.camera.model.params - HYPERBOLIC.params)[[0, 2, 3, 4]] / deviation)
        assert found.uncertainty.sigma == pytest.approx(1.0, rel=0.12)
    # 24 normal variables, many of them correlated.
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_correlated_pixel_errors_inflate_the_covariance():
    rng = np.random.default_rng(3)
    arcs, _ = line_images(HYPERBOLIC, 12, noise=0.1)
    waves = [0.5 * np.sin(np.linspace(0, 9, len(arc)) + rng.uniform(0, 6)) for arc in arcs]
    wavy = [arc + wave[:, None] for arc, wave in zip(arcs, waves, strict=True)]
    found = calibrate_drawn(wavy)
    assert found.uncertainty.inflation > 3
    assert bearing_difference(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sigma


def test_a_fixed_xi_is_kept_and_reduces_the_uncertainty():
    arcs, _ = line_images(PARABOLIC, 6, noise=1.0, seed=1)
    free = calibrate_drawn(arcs)
    known = calibrate_drawn(arcs, fixed={"xi": 1.0})
    assert known.camera.model.to_dict()["xi"] == 1.0
    assert known.bearing_sigma < free.bearing_sigma
    assert known.camera.covariance[0, 0] < 0.25 * free.camera.covariance[0, 0]
    assert bearing_difference(known.camera.model, PARABOLIC, np.concatenate(arcs)) < 3 * known.bearing_sigma


def test_curved_edges_are_rejected_and_parts_of_a_line_joined():
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.3, seed=5, pixels=160)
    rng = np.random.default_rng(1)
    bent = []
    for k in range(8):  # circles of the scene, of random position and radius
        turn = np.linspace(0, 1.6, 160) + rng.uniform(0, 6)
        middle, radius = rng.uniform((400, 300), (880, 720)), 60 + 12 * k
        bent.append(middle + radius * np.stack([np.cos(turn), np.sin(turn)], -1) + 0.3 * rng.normal(size=(160, 2)))
    halves = [part for arc in arcs[:4] for part in (arc[:70], arc[90:])]
    chains = PixelChains.from_arrays([*halves, *arcs[4:], *bent])
    found = calibrate_arcs(chains)
    true, false = found.line_of_arc[:18], found.line_of_arc[18:]
    assert (true >= 0).all()
    assert (false >= 0).sum() <= 1
    assert (true[0:8:2] == true[1:8:2]).all()
    assert bearing_difference(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sigma
    assert found.camera.calibration["method"] == "lines"
    assert found.camera.calibration["arcs_rejected"] == (found.line_of_arc < 0).sum()


def test_a_static_edge_in_several_images_counts_once():
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.2, seed=5, pixels=160)
    rng = np.random.default_rng(2)
    again = [arc + 0.2 * rng.normal(size=arc.shape) for _ in range(3) for arc in arcs[:6]]
    chains = PixelChains.from_arrays([*arcs, *again], [0] * 14 + [1] * 6 + [2] * 6 + [3] * 6)
    assert (deduplicate_static_arcs(chains) >= 0).sum() == 18
    found = calibrate_arcs(chains)
    assert len(found.lines) == 14
    assert (found.line_of_arc[14:].reshape(3, 6) == found.line_of_arc[:6]).all()
    assert (
        deduplicate_static_arcs(PixelChains.from_arrays([*arcs, *again])) < 0
    ).all()  # within one image they are different edges


def test_the_angular_extent_is_the_angle_between_the_ends():
    turn = np.linspace(0, np.radians(70), 40)[:, None]
    bearings = np.cos(turn) * [0.6, 0, 0.8] + np.sin(turn) * [0, 1.0, 0]
    chains = PixelChains.from_arrays([HYPERBOLIC.project_numpy(bearings)[0]])
    assert fit_line_planes(HYPERBOLIC, chains).angular_extents(chains) == pytest.approx([np.radians(70)], abs=1e-6)


@pytest.mark.parametrize("name", ["equidistant", "equisolid", "fov"])
def test_the_stated_uncertainty_covers_the_scale_error_of_a_lens_of_another_profile(name):
    values = model_class(name).example().to_dict()
    values |= {"cx": 640.0, "cy": 512.0, "fy": values["fx"]}
    truth = model_class(name).from_dict(values)
    pixels = np.concatenate(arcs := line_images(truth, 30, radii=(30, 400))[0])
    found = calibrate_drawn(arcs)
    # Its lines are straight for a unified model of another scale, so the residuals do not show the error.
    error = bearing_difference(found.camera.model, truth, pixels)
    assert error > 5 * bearing_sigma(found.camera.model, found.camera.covariance, pixels)
    assert error < 2 * found.bearing_sigma_at(pixels)


def bearings_between(low_deg, high_deg):
    theta, turn = np.radians(np.linspace(low_deg, high_deg, 200)), 2.4 * np.arange(200)
    return np.stack([np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)], -1)


def test_the_scale_is_unambiguous_for_a_parabolic_mirror_and_ambiguous_for_a_lens():
    mirror, rim = scale_ambiguity(PARABOLIC, bearings_between(18, 105)), bearings_between(1, 90)
    assert mirror < 1e-6  # r = tan(theta/2) belongs to both families
    equidistant = model_class("equidistant")(318.0, 318.0, 520.0, 506.0)
    # Up to 90 degrees the best unified fit of an equidistant lens has xi = 1.51 and tan(theta) 6 % larger.
    assert scale_ambiguity(equidistant, rim) == pytest.approx(0.06, abs=0.005)
    assert scale_ambiguity(Unified(318.0, 318.0, 520.0, 506.0, 1.51), rim) == pytest.approx(0.06, abs=0.005)
    # The ambiguity grows beyond xi = 1, towards the orthographic lens.
    ambiguities = [scale_ambiguity(Unified(300.0, 300.0, 500.0, 500.0, xi), rim) for xi in (1.2, 1.6, 2.5, 6.0)]
    assert (np.diff(ambiguities) > 0.02).all()
    # Without any bearing the scale is unknown.
    assert scale_ambiguity(PARABOLIC, np.zeros((0, 3))) == 0.5


def test_the_border_centre_is_weighted_by_the_covariance_of_the_lines():
    pixels = HYPERBOLIC.project_numpy(bearings_between(20, 100))[0]
    names = HYPERBOLIC.param_names
    u = names.index("cx")
    covariance = np.zeros((len(names), len(names)))
    covariance[u, u] = covariance[u + 1, u + 1] = 3.0**2
    covariance[0, 0], covariance[0, u], covariance[u, 0] = 4.0**2, 6.0, 6.0
    lines = LinesUncertainty(covariance, 0.1, 4.0, False)
    middle = np.array([HYPERBOLIC.cx + 1.0, HYPERBOLIC.cy])
    aside = 0.009 * np.linalg.norm(pixels - middle, axis=1).max()
    model, both = update_with_border_centre(HYPERBOLIC, lines, middle, pixels)
    # The update is the information-weighted mean of two measurements.
    share = 9 / (9 + aside**2)
    assert model.cx == pytest.approx(HYPERBOLIC.cx + share)
    assert both.covariance[u, u] == pytest.approx(1 / (1 / 9 + 1 / aside**2))
    assert model.fx == pytest.approx(HYPERBOLIC.fx + 6 / (9 + aside**2))  # correlated parameters follow
    # A border that contradicts the lines widens the uncertainty.
    far = update_with_border_centre(HYPERBOLIC, lines, middle + 40, pixels)[1]
    assert far.covariance[u, u] > 4 * both.covariance[u, u]
    # A precise principal point hardly moves.
    sure = LinesUncertainty(covariance * 1e-4, 0.1, 1.0, False)
    assert abs(update_with_border_centre(HYPERBOLIC, sure, middle, pixels)[0].cx - HYPERBOLIC.cx) < 1e-3


def test_a_border_improves_the_principal_point_of_few_lines():
    arcs, _ = line_images(PARABOLIC, 4, noise=1.0, seed=4)
    pixels, middle = np.concatenate(arcs), np.array([PARABOLIC.cx + 1.0, PARABOLIC.cy - 1.0])
    alone = calibrate_drawn(arcs)
    helped = calibrate_drawn(arcs, border_centre=middle)
    errors = [bearing_difference(found.camera.model, PARABOLIC, pixels) for found in (alone, helped)]
    assert errors[1] < 0.5 * errors[0]
    assert helped.bearing_sigma < alone.bearing_sigma
    assert errors[1] < 2 * helped.bearing_sigma


def test_a_fixed_principal_point_does_not_move():
    free_parameters = fix_principal_point(FreeParameters.of(HYPERBOLIC, square=True), HYPERBOLIC)
    names = HYPERBOLIC.param_names
    assert free_parameters.directions.shape[1] == 2  # the focal length and xi
    assert np.abs(free_parameters.directions[[names.index("cx"), names.index("cy")]]).max() < 1e-12


def test_arcs_far_apart_on_a_great_circle_are_not_joined():
    # 90 degrees away on the same great circle: 12 degrees of a line do not determine its direction so far.
    turn = np.radians(np.concatenate([np.linspace(-50, -10, 60), np.linspace(80, 92, 40)]))[:, None]
    bearings = np.cos(turn) * [0.8, 0, 0.6] + np.sin(turn) * [0, 1.0, 0]
    pixels, valid = HYPERBOLIC.project_numpy(bearings)
    assert valid.all()
    arcs, _ = line_images(HYPERBOLIC, 14, noise=0.05, seed=5, pixels=160)
    chains = PixelChains.from_arrays([*arcs, pixels[:60], pixels[60:]])
    found = calibrate_arcs(chains)
    assert found.line_of_arc[14] >= 0
    assert found.line_of_arc[15] != found.line_of_arc[14]


def test_a_fixed_xi_determines_the_scale():
    known = calibrate_drawn(line_images(PARABOLIC, 8)[0], fixed={"xi": 1.0})
    assert known.bearing_sigma < 1e-6


def test_lines_of_one_plane_count_as_one_cluster():
    rng = np.random.default_rng(3)
    arcs, normals = line_images(HYPERBOLIC, 50, noise=0.1)
    chains = PixelChains.from_arrays(arcs)
    free = FreeParameters.of(HYPERBOLIC, square=True)
    once = LinesUncertainty.estimate(
        refine_plumb_lines(PlumbLineState(HYPERBOLIC, normals), chains, free).state, chains, free
    )
    bundle = PixelChains.from_arrays([arc + 0.1 * rng.normal(size=2) for arc in arcs for _ in range(4)])
    state = refine_plumb_lines(PlumbLineState(HYPERBOLIC, np.repeat(normals, 4, axis=0)), bundle, free).state
    many = LinesUncertainty.estimate(state, bundle, free)
    # Four copies of the same errors would halve the standard deviation if they were independent.
    sigmas = [np.sqrt(np.diagonal(u.covariance))[[0, 2, 3, 4]] for u in (once, many)]
    assert (sigmas[1] > 0.75 * sigmas[0]).all()


@pytest.mark.parametrize(
    ("arcs", "message"),
    [
        ([np.zeros((5, 3))], r"line 1: expected pixels of shape \(n, 2\), got \(5, 3\)"),
        ([np.zeros((2, 2))], "line 1: has 2 pixels, at least 3 are needed"),
        ([np.full((5, 2), np.nan)], "line 1: has a pixel that is not finite"),
    ],
)
def test_invalid_chains_are_rejected(arcs, message):
    with pytest.raises(ValueError, match=message):
        PixelChains.from_arrays(arcs)


def test_too_few_lines_and_unknown_names_are_rejected():
    arcs, _ = line_images(HYPERBOLIC, 3)
    with pytest.raises(ValueError, match="2 lines are too few: at least 3 are needed"):
        calibrate_drawn(arcs[:2])
    with pytest.raises(ValueError, match="unified has no k1; it has fx"):
        calibrate_drawn(arcs, fixed={"k1": 0.0})
    with pytest.raises(ValueError, match="unknown camera model 'nonsense'"):
        calibrate_drawn(arcs, model="nonsense")
