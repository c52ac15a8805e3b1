"""The cameras to remap to: what they reach, and what they refuse."""

import numpy as np
import pytest

import omnisight as om


@pytest.mark.parametrize("fov", [150.1, 180, 360, 0, -10, np.nan])
def test_too_wide_perspective_is_rejected_with_alternatives(fov):
    with pytest.raises(
        ValueError, match=r"perspective view cannot show .* only up to 150: use cylinder, panini, sphere"
    ):
        om.perspective(fov=fov)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: om.perspective(90, (640, 360)), r"got \(640, 360\): the order is perspective\(size, fov\)"),
        (lambda: om.fisheye(180, (640, 360)), r"the order is fisheye\(size, fov\)"),
        (lambda: om.panini(fov=360), "Panini view of distance 1 cannot show 360 degrees, only up to 353"),
        (lambda: om.panini(fov=190, distance=0.0), "distance 0 cannot show 190 degrees, only up to 176"),
        (lambda: om.panini(fov=np.nan), "Panini view .* cannot show nan degrees"),
        (lambda: om.fisheye(100, 361), "equidistant fisheye cannot show 361 degrees, only up to 360"),
        (lambda: om.fisheye(100, 200, "orthographic"), "orthographic fisheye cannot show 200 degrees, only up to 180"),
        (lambda: om.fisheye(100, 0), "cannot show 0 degrees"),
        (
            lambda: om.fisheye(100, 180, "fthetalens"),
            "unknown fisheye projection 'fthetalens'; there are: equidistant",
        ),
        (lambda: om.planet(100, 360), "stereographic fisheye cannot show 360 degrees, only up to 359"),
        (lambda: om.cylinder(100, (-95, 30)), r"within -89 to 89 degrees, got \(-95, 30\)"),
        (lambda: om.mercator(100, (-30, 90)), "within -89 to 89"),
        (lambda: om.sphere(100, (30, -30)), r"elevation must be \(low, high\) within -90 to 90"),
        (lambda: om.sphere(100, (-90, 91)), "within -90 to 90 degrees"),
        (lambda: om.sphere(100, (-90, 90), (-200, 10)), "azimuth must be .* within -180 to 180"),
        (lambda: om.sphere(0), "must be from 1 to 32767 px, got 0"),
        (lambda: om.sphere(70000), "from 1 to 32767 px"),
        (lambda: om.perspective((40000, 10), 90), "from 1 to 32767 px, got 40000 x 10"),
        (lambda: om.cube_face(-3), "from 1 to 32767 px"),
        (lambda: om.look(up="bottom"), "up must be one of top, back, front, got 'bottom'"),
    ],
)
def test_impossible_views_are_rejected_with_their_limit(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("target", "half"),
    [
        (om.perspective((301, 201), 110), 55),
        (om.panini((301, 201), 170), 85),
        (om.fisheye(301, 220), 110),
        (om.fisheye(301, 150, "equisolid"), 75),
        (om.fisheye(301, 150, "stereographic"), 75),
        (om.fisheye(301, 150, "orthographic"), 75),
        (om.planet(301, 260), 130),
        (om.cube_face(301), 45),
    ],
)
def test_field_of_view_extends_to_the_outer_pixel_edges(target, half):
    middle = (target.height - 1) / 2
    angles = target.angle_of([[-0.5 + 1e-9, middle], [target.width - 0.5 - 1e-9, middle]])
    np.testing.assert_allclose(np.degrees(angles), half, atol=1e-4)


@pytest.mark.parametrize("make", [om.sphere, om.cylinder, om.mercator])
def test_ranges_extend_to_the_outer_pixel_edges(make):
    target = make(400, (-20.0, 35.0), (-100.0, 60.0))
    corners = [[-0.5, -0.5], [target.width - 0.5, target.height - 0.5]]
    (x, y, z) = target.unproject(corners)[0].T
    np.testing.assert_allclose(np.degrees(np.arctan2(x, z)), [-100, 60], atol=1e-6)
    np.testing.assert_allclose(np.degrees(np.arcsin(-y)), [35, -20], atol=1e-6)
