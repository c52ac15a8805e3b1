"""Mirror designs, verified by ray tracing."""

import dataclasses

import numpy as np
import pytest

from omnisight.geometry.sphere import angle_from_axis
from omnisight.optics.design.mirror_design import design_mirror
from omnisight.optics.design.performance import blind_spot, evaluate_design, misalignments, resolution, viewpoint
from omnisight.optics.design.shapes import KINDS
from omnisight.optics.design.specification import FILL_FRACTION, MirrorSpecification
from omnisight.optics.design.tolerances import MAX_ERROR_PX, compute_tolerances
from omnisight.optics.viewpoint import lens_positions


def order(kind="hyperbolic", up=20.0, down=None, **more):
    down = (10.0 if kind == "conical" else 60.0) if down is None else down
    given = {"size": (1280, 960), "pixel": 3.75e-6} | more
    return MirrorSpecification(kind, float(np.radians(up)), float(np.radians(down)), **given)


def theta_at(design, radius):
    """Return the angle from straight down at an image radius (px), and the origin of the ray."""
    u, v = design.centre
    origins, bearings, valid = design.system().rays([u + radius, v])
    assert valid
    return angle_from_axis(-bearings), origins


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("up", [-20.0, 0.0, 20.0, 35.0])
def test_rim_shows_the_top_of_the_field(kind, up):
    design = design_mirror(order(kind, up, 30.0 if up < 0 else 5.0))
    theta, origin = theta_at(design, design.circle * (1 - 1e-12))
    assert np.degrees(theta) == pytest.approx(90 + up, abs=1e-8)
    assert origin[0] == pytest.approx(design.mirror.rim, rel=1e-9)
    assert design.circle == pytest.approx(FILL_FRACTION * 480, rel=1e-12)


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.central])
def test_central_design_has_its_lens_in_the_focus_and_matches_ray_tracing(kind):
    design = design_mirror(order(kind, 25.0))
    (place,) = lens_positions(design.mirror)
    assert -place.lens == (np.inf if kind == "parabolic" else pytest.approx(design.distance, rel=1e-12))
    found = viewpoint(design, blind_spot(design))
    assert found.worst < 1e-14
    np.testing.assert_allclose(found.point, [0, 0, design.distance + place.viewpoint], atol=1e-13)
    # The camera file's frame is the lens' turned about y, so that z looks down: a rotation.
    traced = design.system().rays(found.pixels).bearings
    modelled, valid = design.model().unproject(found.pixels)
    assert valid.all()
    assert np.abs(modelled - traced * [-1, 1, -1]).max() < 1e-12


@pytest.mark.parametrize("kind", ["spherical", "conical"])
def test_non_central_design_has_no_unified_model(kind):
    design = design_mirror(order(kind))
    assert viewpoint(design, blind_spot(design)).rms > 1e-4
    with pytest.raises(ValueError, match="has no single viewpoint"):
        design.model()


@pytest.mark.parametrize("kind", ["hyperbolic", "spherical", "conical"])
@pytest.mark.parametrize(
    "given",
    [
        {"diameter": 0.05},
        {"distance": 0.08},
        {"focal": 0.004},
        {"focal": 0.004, "diameter": 0.05},
        {"focal": 0.004, "distance": 0.1},
        {"diameter": 0.05, "distance": 0.03},
        {"diameter": 0.05, "distance": 0.03, "focal": 0.002},
    ],
)
def test_specified_sizes_are_kept_and_determine_the_others(kind, given):
    design = design_mirror(order(kind, 15.0, 1.0, **given))
    rim, mirror = design.mirror.rim, design.mirror
    if "diameter" in given:
        assert 2 * rim == pytest.approx(given["diameter"], rel=1e-12)
    if "distance" in given:
        assert design.distance == pytest.approx(given["distance"], rel=1e-9)
    if "focal" in given:
        assert design.focal == pytest.approx(given["focal"], rel=1e-12)
    if len(given) < 3:
        assert design.circle == pytest.approx(FILL_FRACTION * 480, rel=1e-9)
    # What the lens sees the rim at is what its image shows.
    across = rim / (design.distance + float(mirror.sag(rim)))
    assert design.circle == pytest.approx(design.focal * across / 3.75e-6, rel=1e-9)
    assert np.degrees(theta_at(design, design.circle * (1 - 1e-12))[0]) == pytest.approx(105, abs=1e-7)


def test_telecentric_lens_distance_is_arbitrary():
    near, far = (design_mirror(order("parabolic", distance=d, diameter=0.04)) for d in (0.05, 0.3))
    assert near.mirror == far.mirror
    assert (near.focal, near.magnification) == (None, pytest.approx(FILL_FRACTION * 480 * 3.75e-6 / 0.02))
    assert (near.distance, far.distance) == (0.05, 0.3)


def test_field_of_a_cone_is_the_half_angle_of_its_lens():
    design = design_mirror(order("conical", 20.0, 10.0))
    tip, _ = theta_at(design, 1e-6)
    assert np.degrees(tip) == pytest.approx(80, abs=1e-4)
    assert np.degrees(np.arctan(design.circle * 3.75e-6 / design.focal)) == pytest.approx(30, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_resolution_is_the_derivative_of_the_image_radius(kind):
    design = design_mirror(order(kind))
    found = resolution(design, 240.0)
    assert (found.radius[0], found.radius[-1]) == pytest.approx((240.0, design.circle))
    assert (np.diff(found.theta) > 0).all()
    slope = np.gradient(found.radius, found.theta, edge_order=2)
    np.testing.assert_allclose(found.up, slope, rtol=2e-4)
    np.testing.assert_allclose(found.around, found.radius / np.sin(found.theta), rtol=1e-12)


def test_paraboloid_is_conformal():
    """Stereographic projection is conformal; R m px, m = tan(theta/2)."""
    design = design_mirror(order("parabolic"))
    found = resolution(design, 30.0)
    np.testing.assert_allclose(found.up, found.around, rtol=1e-12)
    gamma = design.model().fy
    np.testing.assert_allclose(found.up, gamma / (1 + np.cos(found.theta)), rtol=1e-12)


@pytest.mark.parametrize("body", [0.01, 0.03, 0.05])
def test_blind_spot_of_a_hyperboloid_is_the_body_seen_from_the_viewpoint(body):
    design = design_mirror(order(down=89.9, body=body))
    blind = blind_spot(design)
    assert np.tan(blind.theta) == pytest.approx(body / 2 / design.mirror.focal_distance, rel=1e-9)
    u, v = design.centre
    inner, outer = (design.system().rays([u + s * blind.radius, v]) for s in (0.99, 1.01))
    at_lens = [o - o[2] / b[2] * b for o, b, _ in (inner, outer)]
    assert at_lens[0][0] < body / 2 < at_lens[1][0]


def test_blind_spot_of_a_telecentric_lens_is_as_wide_as_the_mirror():
    design = design_mirror(order("parabolic", down=89.9, body=0.01, diameter=0.06))
    above = design.distance + design.mirror.foci[0]
    assert np.tan(blind_spot(design).theta) == pytest.approx(0.03 / above, rel=1e-9)


@pytest.mark.parametrize("kind", ["hyperbolic", "parabolic", "spherical"])
@pytest.mark.parametrize("down", [-5.0, 20.0, 50.0])
def test_hole_ends_the_field_at_the_specified_elevation(kind, down):
    design = design_mirror(order(kind, down=down))
    edge = design.image_radius(design.mirror.hole)
    theta, origin = theta_at(design, edge * (1 + 1e-9))
    assert np.degrees(theta) == pytest.approx(90 - down, abs=1e-6)
    assert np.hypot(*origin[:2]) == pytest.approx(design.mirror.hole, rel=1e-8)
    u, v = design.centre
    assert not design.system().rays([u + edge * (1 - 1e-9), v]).valid
    assert (blind_spot(design).radius, evaluate_design(design).blind.radius) == (edge, edge)


@pytest.mark.parametrize("kind", KINDS)
def test_tolerances_keep_the_parallax_and_the_image_within_their_limits(kind):
    design = design_mirror(order(kind))
    performance = evaluate_design(design)
    limits = compute_tolerances(design, performance)
    margin = 480 - design.circle
    moves = {"along": min(limits.axial, 0.005), "across": limits.lateral, "tilt": limits.tilt}
    nominal = viewpoint(design, performance.blind).parallax(1.0).max()
    for name, amount in moves.items():
        moved = viewpoint(design, performance.blind, **{name: amount}).parallax(1.0).max()
        assert moved - nominal < 1.3 * MAX_ERROR_PX, name
        # The image of the mirror's rim moves by at most the margin of the sensor.
        before, after = (s.project(_far_ring(design))[0] for s in (design.system(), design.system(**{name: amount})))
        assert np.nanmax(np.linalg.norm(after - before, axis=-1)) < 1.3 * margin, name
    finest = max(performance.resolution.up.max(), performance.resolution.around.max())
    assert 2 * limits.slope * finest == pytest.approx(MAX_ERROR_PX)


def _far_ring(design):
    """Return distant points shown well inside the rim."""
    phi = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    theta = design.specification.theta - np.radians(8)
    return 1e3 * np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.full(12, -np.cos(theta))], -1)


def test_cone_has_a_blind_spot_without_image():
    blind = blind_spot(design_mirror(order("conical")))
    assert blind.radius == 0
    assert np.degrees(blind.theta) == pytest.approx(80, abs=1e-3)


def test_viewpoint_error_is_proportional_to_the_misalignment():
    design = design_mirror(order())
    rows = {row.description: row for row in misalignments(design, blind_spot(design))}
    assert rows["as designed"].worst < 1e-14
    assert rows["as designed"].moved_px == 0
    for small, large in (
        ("0.1 mm axial", "1 mm axial"),
        ("0.1 mm lateral", "1 mm lateral"),
        ("tilt 0.1°", "tilt 1°"),
    ):
        for figure in ("rms", "worst", "rms_px", "worst_px", "moved_px"):
            ratio = getattr(rows[large], figure) / getattr(rows[small], figure)
            assert ratio == pytest.approx(10, rel=0.2), (small, figure)
        assert rows[small].rms < rows[small].worst


def test_paraboloid_keeps_its_viewpoint_if_displaced_but_not_if_tilted():
    design = design_mirror(order("parabolic"))
    rows = {row.description: row for row in misalignments(design, blind_spot(design))}
    assert max(rows[name].worst for name in ("1 mm axial", "1 mm lateral")) < 1e-14
    assert rows["1 mm lateral"].moved_px > 10
    assert rows["tilt 1°"].worst > 1e-4


def test_parallax_decreases_with_the_working_distance():
    near, far = (misalignments(d := design_mirror(order(working_distance=w)), blind_spot(d))[-1] for w in (0.5, 5.0))
    assert near.worst == pytest.approx(far.worst)
    assert near.worst_px == pytest.approx(10 * far.worst_px, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_scaled_design_has_the_same_resolution(kind):
    one = design_mirror(order(kind, diameter=0.03, body=0.015))
    other = design_mirror(order(kind, diameter=0.06, body=0.03))
    a, b = evaluate_design(one), evaluate_design(other)
    assert other.distance == pytest.approx(2 * one.distance)
    np.testing.assert_allclose(a.resolution.up, b.resolution.up, rtol=1e-9)
    np.testing.assert_allclose(2 * a.viewpoint.distances, b.viewpoint.distances, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kind": "cubic"}, "unknown kind of mirror 'cubic'; there are: hyperbolic, parabolic, spherical, conical"),
        ({"up": 75.0}, "no mirror shows more than 70.0 degrees up, --up is 75: reduce --up, or use a longer"),
        ({"up": 95.0}, "less than 90 degrees, got 95 and 60"),
        ({"up": -30.0, "down": 20.0}, "the field from -20 to -30 degrees is empty"),
        (
            {"up": -75.0, "down": 89.0},
            "the lens sees the rim at 20.0 degrees from the axis and would have to show 15 degrees there",
        ),
        (
            {"kind": "conical", "down": 30.0, "focal": 0.004},
            "half angle of its lens, 23.8 degrees here, but the field is 50",
        ),
        (
            {"kind": "conical", "down": 60.0},
            "10.0 degrees up, --up is 20: reduce --up or --down; 2 up + down",
        ),
        ({"kind": "parabolic", "focal": 0.004}, "needs a telecentric lens"),
        ({"diameter": 0.0}, "the diameter must be a positive length, got 0.0"),
        ({"pixel": np.nan}, "the pixel must be a positive length"),
        ({"size": (10, 10)}, "sensor of 10x10 px: width and height must be from 16"),
        ({"size": (10**6, 960)}, "sensor of 1000000x960 px: width and height must be"),
        ({"pixel": 3.75e-3}, "the pixel is 0.00375 m, more than 0.0001 m: check its unit"),
        ({"focal": 8.0}, "the focal length is 8 m, more than 1 m: check its unit"),
        ({"diameter": 50.0}, "the diameter is 50 m"),
        (
            {"focal": 0.9},
            "the mirror fills only 0.2246 degrees, less than 0.4",
        ),
        (
            {"kind": "spherical", "diameter": 0.06, "distance": 0.004},
            "shows 20 degrees up needs a lens distance of at least 5.6",
        ),
        ({"diameter": 0.001, "distance": 30.0}, "is too large for a mirror of 1mm"),
        ({"diameter": 0.06, "distance": 0.06, "focal": 0.02}, "px wide, the sensor 960 px: use 4.625mm, a smaller"),
    ],
)
def test_impossible_specifications_are_rejected_with_the_remedy(given, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        design_mirror(order(**given))
    assert message in str(error.value)


def test_body_that_hides_the_field_is_rejected():
    with pytest.raises(ValueError, match=r"hides everything more than 78\.1 degrees below the horizon, --down is 85"):
        evaluate_design(design_mirror(order(down=85.0)))
    assert evaluate_design(design_mirror(order(down=85.0, body=0.005))).blind.theta == pytest.approx(
        np.radians(5), rel=1e-8
    )


def test_large_displacements_of_a_small_mirror_are_skipped():
    small = evaluate_design(design_mirror(order(diameter=0.004, body=0.002)))
    assert [row.description for row in small.misalignments] == [
        "as designed",
        "0.1 mm axial",
        "0.1 mm lateral",
        "tilt 0.1°",
        "tilt 1°",
    ]


def test_reported_limit_of_the_field_is_accepted():
    assert evaluate_design(design_mirror(order(down=78.1))).blind.theta == pytest.approx(np.radians(11.9), rel=1e-8)
    with pytest.raises(ValueError, match=r"more than 78\.1 degrees below the horizon, --down is 78\.2:"):
        evaluate_design(design_mirror(order(down=78.2)))


def test_working_distance_inside_the_mirror_is_rejected():
    with pytest.raises(ValueError, match=r"the working distance 20mm is inside the mirror, which is 60mm wide"):
        evaluate_design(design_mirror(order("spherical", working_distance=0.02)))


def test_design_keeps_its_specification():
    one = order()
    assert design_mirror(one).specification == dataclasses.replace(one)
