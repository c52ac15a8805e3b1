"""Calibration from lines: conics and circles are right, the uncertainty is true, and what is no line is left out."""

import mpmath
import numpy as np
import pytest

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines import (
    Chains,
    Lines,
    Uncertainty,
    apart,
    bearing_deviation,
    calibrate_lines,
    fit_circle,
    line_conic,
    lines_of,
    parabolic_camera,
    refine_lines,
)
from omnisight.calibrate.lines.once import seen_before
from omnisight.calibrate.lines.plumb import PlumbLine
from omnisight.models import model_class
from omnisight.models.unified import Unified
from omnisight.optim.loss import Huber

SIZE = (1280, 1024)
PARABOLIC = Unified(300.0, 300.0, 652.0, 498.0, 1.0)
HYPERBOLIC = Unified(330.0, 330.0, 640.0, 512.0, 0.85)


def line_images(model, count, noise=0.0, seed=0, pixels=80, radii=(100, 480)):
    """See straight lines: arcs of 40 to 110 degrees of great circles, all around, with noise; and their normals."""
    rng = np.random.default_rng(seed)
    arcs, normals = [], []
    while len(arcs) < count:
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        across = np.linalg.svd(n[None])[2][1:]
        start = rng.uniform(0, 2 * np.pi)
        turn = np.linspace(start, start + np.radians(rng.uniform(40, 110)), pixels)[:, None]
        seen, valid = model.project_numpy(np.cos(turn) * across[0] + np.sin(turn) * across[1])
        away = np.linalg.norm(seen - (model.cx, model.cy), axis=1)
        if valid.all() and away.max() < radii[1] and away.min() > radii[0]:
            arcs.append(seen + noise * rng.normal(size=seen.shape))
            normals.append(n)
    return arcs, np.array(normals)


# -- geometry ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("xi", [0.3, 0.85, 1.0, 1.4])
def test_the_image_of_a_line_lies_on_its_conic(xi):
    model = Unified(310.0, 305.0, 640.0, 500.0, xi, skew=0.7)
    arcs, normals = line_images(model, 4)
    for arc, normal in zip(arcs, normals, strict=True):
        conic = line_conic(model, normal)
        p = np.column_stack([arc, np.ones(len(arc))])
        value, slope = np.einsum("ni,ij,nj->n", p, conic, p), 2 * (p @ conic)[:, :2]
        assert np.abs(value / np.linalg.norm(slope, axis=1)).max() < 1e-8  # px


def test_the_conic_of_a_parabolic_mirror_is_the_circle_of_the_closed_form():
    normal = np.array([0.4, -0.7, 0.5])
    conic = line_conic(PARABOLIC, normal)
    conic = conic / conic[0, 0]
    centre = -conic[:2, 2]
    with mpmath.workdps(40):
        nx, ny, nz = (mpmath.mpf(n) for n in normal)
        expected = (652 + 300 * nx / nz, 498 + 300 * ny / nz)
        radius = 300 * mpmath.sqrt(nx**2 + ny**2 + nz**2) / nz
    assert abs(conic[0, 1]) < 1e-12
    assert conic[1, 1] == pytest.approx(1, abs=1e-12)
    assert centre == pytest.approx([float(c) for c in expected], abs=1e-9)
    assert np.sqrt(centre @ centre - conic[2, 2]) == pytest.approx(float(radius), abs=1e-9)


def test_three_circles_give_the_parabolic_camera():
    arcs, _ = line_images(PARABOLIC, 3)
    found = parabolic_camera([fit_circle(arc) for arc in arcs])
    assert found.params == pytest.approx(PARABOLIC.params, abs=1e-6)


def test_two_circles_and_parallel_lines_give_none():
    arcs, _ = line_images(PARABOLIC, 2)
    assert parabolic_camera([fit_circle(arc) for arc in arcs]) is None
    across = np.stack([np.linspace(0, 100, 20), np.zeros(20)], -1)
    assert parabolic_camera([fit_circle(across + np.array([0, 30 * k])) for k in range(3)]) is None


def test_a_line_through_the_centre_counts_as_a_circle_does():
    arcs, _ = line_images(PARABOLIC, 2)
    for direction in ((1.0, 0.3), (-0.2, 1.0)):
        arcs.append(np.array([652.0, 498.0]) + np.linspace(100, 400, 50)[:, None] * direction)
    found = parabolic_camera([fit_circle(arc) for arc in arcs])
    assert found.params == pytest.approx(PARABOLIC.params, abs=1e-5)


def test_a_short_arc_is_fitted_by_distance_and_not_by_algebra():
    # An algebraic fit (Kasa) of 30 degrees of a circle of 200 px, 1 px of noise, is 10 to 20 % too small.
    turn = np.linspace(0, np.radians(30), 60)
    true = np.stack([500 + 200 * np.cos(turn), 400 + 200 * np.sin(turn)], -1)
    curvature, spread = [], []
    for seed in range(200):
        circle = fit_circle(true + np.random.default_rng(seed).normal(size=true.shape))
        curvature.append(2 * abs(circle.coefficients[0]))
        spread.append(2 * np.sqrt(circle.covariance[0, 0]))
    deviation = np.std(curvature)
    assert np.mean(curvature) == pytest.approx(1 / 200, abs=3 * deviation / np.sqrt(200))
    assert np.mean(spread) == pytest.approx(deviation, rel=0.2)


def test_distances_from_a_circle_are_exact():
    turn = np.linspace(0, 2, 30)
    circle = fit_circle(np.stack([100 + 50 * np.cos(turn), 80 + 50 * np.sin(turn)], -1))
    points = np.array([[100.0, 90.0], [100, 140], [130, 120], [175, 80]])
    assert np.abs(circle.distance(points)) == pytest.approx([40, 10, 0, 25], abs=1e-6)


# -- the plumb line ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["unified", "mei", "ocam", "kannala_brandt", "double_sphere", "equidistant"])
def test_the_gradient_is_that_of_the_cost(name):
    model = model_class(name).example()
    arcs, normals = line_images(model, 4, noise=0.4, radii=(20, 300))
    chains = Chains.of(arcs)
    bent = model.with_params(model.params * (1 + 2e-3 * np.cos(np.arange(model.params.size))))
    state = Lines(bent, normals)
    problem = PlumbLine(chains, Huber(), Freedom.of(model))
    normal = problem.linearise(state)
    gradient = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    # Steps that change pixels alike, whatever the unit of the parameter.
    size = np.concatenate([1 / np.sqrt(np.diagonal(normal.shared)), np.full(8, 1e-2)]) * 1e-2
    for i in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[i] = size[i]
        slope = (problem.cost(problem.move(state, step)) - problem.cost(problem.move(state, -step))) / 2
        assert slope == pytest.approx(gradient[i] * size[i], abs=2e-3 * np.abs(gradient * size).max())


def test_distances_are_those_of_the_image_in_pixels():
    (arc,), normals = line_images(HYPERBOLIC, 1)
    tangent = np.gradient(arc, axis=0)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], -1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    moved = Chains.of([arc + 1.5 * across])
    assert Lines(HYPERBOLIC, normals).distances(moved) == pytest.approx(np.full(len(arc), 1.5), abs=0.02)


@pytest.mark.parametrize("name", ["unified", "equidistant", "equisolid", "orthographic"])
def test_the_plumb_line_finds_a_rigid_model_from_lines_alone(name):
    truth = model_class(name).example()
    truth = truth.with_params([truth.params[0], *truth.params[[0, 2, 3]], *truth.params[4:]])
    if "skew" in truth.param_names:
        truth = model_class(name).from_dict(truth.to_dict() | {"skew": 0.0})
    arcs, _ = line_images(truth, 8, radii=(30, 300))
    chains = Chains.of(arcs)
    off = truth.with_params(truth.params * np.array([1.04, 1.04, 1.01, 0.99, *[1.03] * (truth.params.size - 4)]))
    found = refine_lines(lines_of(off, chains), chains, Freedom.of(off, square=True)).state
    assert found.distances(chains).max() < 1e-5
    assert found.model.params == pytest.approx(truth.params, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", ["ocam", "kannala_brandt", "mei"])
def test_a_model_that_bends_freely_keeps_the_scale_of_the_unified_model(name):
    arcs, _ = line_images(HYPERBOLIC, 12, noise=0.1)
    found = calibrate_lines(Chains.of(arcs), SIZE, model=name, trusted=True)
    assert found.scale_held
    assert any("the scale of" in warning for warning in found.warnings)
    assert apart(found.camera.model, HYPERBOLIC, np.concatenate(arcs)) < 3 * found.bearing_sd
    assert found.bearing_sd < np.radians(1)


def test_a_rigid_model_that_scaling_changes_into_itself_is_known_for_one():
    truth = model_class("fov")(430.0, 430.0, 640.0, 512.0, 0.92)
    arcs, _ = line_images(truth, 12, noise=0.1)
    assert calibrate_lines(Chains.of(arcs), SIZE, model="fov", trusted=True).scale_held
    assert not calibrate_lines(Chains.of(arcs), SIZE, model="equidistant", trusted=True).scale_held


def test_a_pinhole_is_refused_for_its_lines_are_straight_whatever_it_is():
    arcs, _ = line_images(Unified(400.0, 400.0, 640.0, 512.0, 0.2), 8, radii=(20, 300))
    with pytest.raises(ValueError, match="lines do not determine the parameters of pinhole"):
        calibrate_lines(Chains.of(arcs), SIZE, model="pinhole", trusted=True)


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
    assert (seen_before(Chains.of([*arcs, *again])) < 0).all()  # in one picture they are different edges


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


def test_a_known_xi_leaves_no_doubt_about_the_scale():
    known = calibrate_lines(Chains.of(line_images(PARABOLIC, 8)[0]), SIZE, known={"xi": 1.0}, trusted=True)
    assert known.bearing_sd < 1e-6


def test_lines_that_come_in_bundles_say_less_than_their_number():
    rng = np.random.default_rng(3)
    arcs, normals = line_images(HYPERBOLIC, 50, noise=0.1)
    chains = Chains.of(arcs)
    free = Freedom.of(HYPERBOLIC, square=True)
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
