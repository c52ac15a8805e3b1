import numpy as np
import pytest
from scipy.stats import norm

from omnisight.optim.loss import NORMAL_MEDIAN, RAYLEIGH_MEDIAN, Huber, StudentT, geman_mcclure_weights, robust_sigma


def test_the_medians_are_those_of_normal_distributions():
    assert pytest.approx(norm.ppf(0.75), abs=1e-8) == NORMAL_MEDIAN
    assert 1 - np.exp(-(RAYLEIGH_MEDIAN**2) / 2) == pytest.approx(0.5)


def test_geman_mcclure_weight_is_the_derivative_of_half_the_loss_by_half_the_square():
    def loss(square):
        return 4.0 * square / (4.0 + square)

    for square in (0.0, 0.5, 4.0, 100.0):
        slope = (loss(square + 1e-6) - loss(square - 1e-6)) / 2e-6
        assert geman_mcclure_weights(np.array([square]), 4.0)[0] == pytest.approx(slope, rel=1e-6)
    assert geman_mcclure_weights(np.array([9.0]), np.inf)[0] == 1


def test_huber_loss_is_quadratic_then_linear():
    loss = Huber(2.0)
    assert loss.cost(np.array([1.0])) == pytest.approx(0.5)
    assert loss.cost(np.array([2.0])) == pytest.approx(2.0)
    assert loss.cost(np.array([5.0])) == pytest.approx(2.0 * 5 - 2.0)
    np.testing.assert_allclose(loss.weight(np.array([0.0, 1.0, 2.0, 8.0])), [1, 1, 1, 0.25])


def test_an_infinite_threshold_is_least_squares():
    length = np.array([0.0, 3.0, 1e6])
    assert Huber().cost(length) == pytest.approx(0.5 * (length**2).sum())
    np.testing.assert_array_equal(Huber().weight(length), 1)
    assert Huber().cost(np.array([])) == 0


def test_huber_weight_is_the_cost_derivative_over_the_length():
    loss = Huber(1.5)
    for length in (0.3, 1.4, 1.6, 20.0):
        slope = (loss.cost(np.array([length + 1e-6])) - loss.cost(np.array([length - 1e-6]))) / 2e-6
        assert loss.weight(np.array([length]))[0] == pytest.approx(slope / length, rel=1e-6)


def test_robust_sigma_ignores_outliers():
    rng = np.random.default_rng(2)
    length = np.linalg.norm(0.3 * rng.normal(size=(20000, 2)), axis=1)
    length[:2000] = 1e4
    assert robust_sigma(length) == pytest.approx(0.3, rel=0.1)
    assert robust_sigma(length[2000:]) == pytest.approx(0.3, rel=0.02)
    assert robust_sigma(np.array([])) == 0


def test_student_t_weight_is_the_cost_derivative():
    loss = StudentT(3.0, 1.5)
    for square in (0.1, 2.0, 40.0):
        slope = (loss.cost(np.array([square + 1e-6])) - loss.cost(np.array([square - 1e-6]))) / 2e-6
        assert loss.weight(np.array([square]))[0] == pytest.approx(2 * slope, rel=1e-6)
    assert loss.weight(np.array([np.inf])).tolist() == [0.0]
    assert np.isfinite(loss.cost(np.array([np.inf])))


def test_student_t_without_tails_is_least_squares():
    squares = np.array([0.0, 1.0, 25.0])
    assert StudentT(sigma=2.0).cost(squares) == pytest.approx(squares.sum() / 8)
    np.testing.assert_allclose(StudentT(sigma=2.0).weight(squares), 0.25)


@pytest.mark.parametrize("degrees", [2.0, 4.0, 1e9])
def test_student_t_is_recovered_from_its_samples_and_its_information_is_that_of_the_mean(degrees):
    rng = np.random.default_rng(1)
    tails = np.sqrt(rng.chisquare(min(degrees, 1e5), 20000) / min(degrees, 1e5))
    residuals = 0.7 * rng.normal(size=(20000, 2)) / tails[:, None]
    loss = StudentT.fit((residuals**2).sum(axis=1))
    assert loss.degrees == degrees
    assert loss.sigma == pytest.approx(0.7, rel=0.02)
    # Maximum likelihood estimates of the centre from 50 residuals each have the variance of the information.
    centres = []
    for sample in residuals.reshape(400, 50, 2):
        centre = np.zeros(2)
        for _ in range(30):
            weight = loss.weight(((sample - centre) ** 2).sum(axis=1))
            centre = (weight[:, None] * sample).sum(0) / weight.sum()
        centres.append(centre)
    assert np.var(centres) * 50 * loss.information == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("degrees", [2.0, 1e9])
def test_student_t_is_recovered_from_residuals_of_one_and_two_dimensions(degrees):
    rng = np.random.default_rng(2)
    tails = np.sqrt(rng.chisquare(min(degrees, 1e5), 40000) / min(degrees, 1e5))
    residuals = 0.7 * rng.normal(size=(40000, 2)) / tails[:, None]
    residuals[10000:, 1] = 0
    dimensions = np.where(np.arange(40000) < 10000, 2.0, 1.0)
    shares = np.where(np.arange(40000) % 2, 0.5, 1.0)
    loss = StudentT.fit((residuals**2).sum(axis=1), dimensions, shares)
    assert loss.degrees == degrees
    assert loss.sigma == pytest.approx(0.7, rel=0.03)
