"""Positions on the ellipsoid, against the examples of IOGP Guidance note 7-2 (373-7-2, sec. 4.1.1 and 4.1.2)."""

import numpy as np

from omnisight.geometry.geodesy import earth_centered, east_north_up, from_east_north_up

POSITION = (53 + 48 / 60 + 33.820 / 3600, 2 + 7 / 60 + 46.380 / 3600, 73.0)


def test_cartesian_coordinates_are_those_of_the_guidance_note():
    np.testing.assert_allclose(earth_centered(POSITION), (3771793.968, 140253.342, 5124304.349), atol=1e-3)


def test_local_coordinates_are_those_of_the_guidance_note():
    local = east_north_up(POSITION, (55.0, 5.0, 200.0))
    np.testing.assert_allclose(local, (-189013.869, -128642.040, -4220.171), atol=1e-3)


def test_positions_from_local_coordinates_invert_local_coordinates():
    np.testing.assert_allclose(
        from_east_north_up((-189013.869, -128642.040, -4220.171), (55.0, 5.0, 200.0)), POSITION, atol=1e-3
    )
    rng = np.random.default_rng(0)
    for origin in ((47.4, 8.5, 400.0), (-89.9, 100.0, 0.0), (0.0, 0.0, 0.0)):
        local = rng.uniform(-1e4, 1e4, (20, 3))
        again = east_north_up(from_east_north_up(local, origin), origin)
        np.testing.assert_allclose(again, local, atol=1e-6)
