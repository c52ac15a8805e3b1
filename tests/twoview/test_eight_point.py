"""The linear solver for many pairs of bearings, beyond the laws of all minimal solvers."""

import numpy as np
import pytest
from motions import bearing_pairs, unit

from omnisight.geometry.rotation import exp
from omnisight.twoview import eight_point

ROTATION, TRANSLATION = exp([0.1, -0.3, 0.2]), np.array([0.6, 0.0, 0.8])


def narrow_pairs(rng, count, degrees):
    """Return pairs in a narrow field of view around an oblique direction behind the camera."""
    axis = unit(np.array([1.0, 2.0, -2.0]))
    a = unit(axis + np.tan(np.radians(degrees / 2)) * rng.uniform(-1, 1, (count, 3)))
    points = a * rng.uniform(2, 6, (count, 1))
    return a, unit(points @ ROTATION.T + TRANSLATION)


def direction_error(pose):
    return np.degrees(np.arccos(np.clip(pose[:, 3] @ TRANSLATION, -1, 1)))


@pytest.mark.parametrize("degrees", [5, 30, 120])
def test_exact_pairs_of_a_narrow_field_of_view_yield_their_motion(degrees):
    a, b = narrow_pairs(np.random.default_rng(0), 30, degrees)
    (pose,) = eight_point(a, b)
    np.testing.assert_allclose(pose, np.column_stack([ROTATION, TRANSLATION]), rtol=0, atol=1e-6)


def test_the_normalization_limits_the_error_in_a_narrow_field_of_view():
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        a, b = (unit(x + 3e-3 * rng.normal(size=x.shape)) for x in narrow_pairs(rng, 200, 10))
        (pose,) = eight_point(a, b)
        errors.append(direction_error(pose))
    assert np.median(errors) < 4  # 2.5 degrees; 78 degrees without normalization


def test_pairs_without_weight_do_not_count():
    rng = np.random.default_rng(4)
    a, b = bearing_pairs(rng, 40, ROTATION, TRANSLATION)
    b[:20] = unit(rng.normal(size=(20, 3)))
    weights = np.repeat([0.0, 1.0], 20)
    (pose,) = eight_point(a, b, weights)
    np.testing.assert_allclose(pose, np.column_stack([ROTATION, TRANSLATION]), rtol=0, atol=1e-8)
    assert np.abs(eight_point(a, b) - pose).max() > 0.01


def test_weights_of_another_shape_are_an_error():
    a, b = bearing_pairs(np.random.default_rng(5), 9, ROTATION, TRANSLATION)
    with pytest.raises(ValueError, match="weights of shape"):
        eight_point(a, b, np.ones(8))
