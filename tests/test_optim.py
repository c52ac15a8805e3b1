import itertools

import numpy as np
import pytest
import scipy.optimize

from omnisight.optim.dense import least_squares
from omnisight.optim.levenberg_marquardt import minimise
from omnisight.optim.loss import Huber, robust_sigma
from omnisight.optim.schur import GroupedNormal


def rosenbrock(x):
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def rosenbrock_slope(x):
    return rosenbrock(x), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def powell(x):
    a, b, c, d = x
    return np.array([a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2])


def powell_slope(x):
    a, b, c, d = x
    slope = np.array(
        [
            [1, 10, 0, 0],
            [0, 0, 5**0.5, -(5**0.5)],
            [0, 2 * (b - 2 * c), -4 * (b - 2 * c), 0],
            [2 * 10**0.5 * (a - d), 0, 0, -2 * 10**0.5 * (a - d)],
        ]
    )
    return powell(x), slope


T = np.linspace(0, 4, 40)
SEEN = 3.0 * np.exp(-0.7 * T) + 0.5 + 0.02 * np.random.default_rng(1).normal(size=T.size)


def decay(x):
    return x[0] * np.exp(-x[1] * T) + x[2] - SEEN


def decay_slope(x):
    e = np.exp(-x[1] * T)
    return decay(x), np.stack([e, -x[0] * T * e, np.ones_like(T)], -1)


# -- dense problems ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (5.0, -7.0)])
def test_rosenbrocks_valley_is_followed_to_its_end(start):
    found = least_squares(rosenbrock, rosenbrock_slope, np.array(start))
    assert found.converged
    np.testing.assert_allclose(found.state, [1, 1], atol=1e-8)
    assert found.cost < 1e-16


def test_powells_singular_minimum_is_approached():
    found = least_squares(powell, powell_slope, np.array([3.0, -1.0, 0.0, 1.0]), iterations=200)
    assert found.cost < 1e-15
    np.testing.assert_allclose(found.state, 0, atol=1e-3)


def test_a_curve_fit_is_scipys():
    found = least_squares(decay, decay_slope, np.array([1.0, 0.1, 0.0]))
    truth = scipy.optimize.least_squares(decay, [1.0, 0.1, 0.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert found.converged
    np.testing.assert_allclose(found.state, truth.x, rtol=1e-6)
    assert found.cost == pytest.approx(truth.cost, rel=1e-10)


@pytest.mark.parametrize(
    ("low", "high"),
    [
        (np.array([-np.inf, 0.0, 0.6]), np.array([2.5, 0.5, np.inf])),
        (np.array([-np.inf, -np.inf, 0.8]), np.full(3, np.inf)),
        (np.full(3, -np.inf), np.array([np.inf, 0.5, np.inf])),
    ],
)
class TestBounds:
    start = np.array([1.0, 0.1, 0.9])

    def test_they_are_kept(self, low, high):
        found = least_squares(decay, decay_slope, self.start, low=low, high=high)
        assert (low <= found.state).all()
        assert (found.state <= high).all()
        assert found.cost < 0.5 * (decay(self.start) ** 2).sum()

    def test_the_best_within_them_is_found(self, low, high):
        found = least_squares(decay, decay_slope, self.start, low=low, high=high, iterations=1000)
        truth = scipy.optimize.least_squares(decay, self.start, bounds=(low, high), xtol=1e-14, ftol=1e-14)
        assert found.cost == pytest.approx(truth.cost, rel=1e-4)


def test_what_is_not_free_stays():
    start = np.array([1.0, 0.5, 0.4])
    found = least_squares(decay, decay_slope, start, free=np.array([True, False, True]))
    assert found.state[1] == 0.5
    design = np.stack([np.exp(-0.5 * T), np.ones_like(T)], -1)
    np.testing.assert_allclose(found.state[[0, 2]], np.linalg.lstsq(design, SEEN, rcond=None)[0], rtol=1e-6)
    np.testing.assert_array_equal(start, [1.0, 0.5, 0.4])


def test_a_parameter_that_nothing_depends_on_stays():
    def wide(x):
        r, slope = rosenbrock_slope(x[:2])
        return r, np.column_stack([slope, np.zeros(2)])

    found = least_squares(lambda x: rosenbrock(x[:2]), wide, np.array([-1.2, 1.0, 42.0]))
    np.testing.assert_allclose(found.state, [1, 1, 42], atol=1e-8)


def test_parameters_that_say_the_same_share_the_step():
    # Only the sum matters: singular, and still solved.
    def slope(x):
        return np.array([x[0] + x[1] - 3, 2 * (x[0] + x[1] - 3)]), np.array([[1.0, 1.0], [2.0, 2.0]])

    found = least_squares(lambda x: slope(x)[0], slope, np.zeros(2))
    assert found.state.sum() == pytest.approx(3, abs=1e-6)


def test_a_start_that_is_not_possible_is_told():
    found = least_squares(lambda x: np.array([np.nan]), lambda x: (x, np.eye(1)), np.zeros(1))
    assert not found.converged
    assert found.cost == np.inf
    assert found.iterations == 0
    assert found.reason == "the start is not possible"


def test_steps_into_the_impossible_are_taken_back():
    # log x past the edge at 0: the first full step from 5 would leave the domain.
    def r(x):
        return np.log(x) + 3 if x[0] > 0 else np.array([np.nan])

    found = least_squares(r, lambda x: (r(x), np.diag(1 / x)), np.array([5.0]))
    assert found.converged
    assert found.state[0] == pytest.approx(np.exp(-3))


def test_iterations_that_run_out_are_told():
    found = least_squares(rosenbrock, rosenbrock_slope, np.array([-1.2, 1.0]), iterations=3)
    assert not found.converged
    assert found.iterations == 3
    assert found.reason == "3 iterations were not enough"
    assert found.cost < 0.5 * (rosenbrock([-1.2, 1.0]) ** 2).sum()


def test_a_start_at_the_minimum_stays_there():
    found = least_squares(rosenbrock, rosenbrock_slope, np.ones(2))
    assert found.converged
    np.testing.assert_array_equal(found.state, [1, 1])


class Descent:
    """The parabola x^2/2 over states that are not vectors."""

    gradient = 1.0

    def __init__(self, at):
        self.at = at

    def cost(self, state):
        return 0.5 * state["x"] ** 2

    def linearise(self, state):
        return Descent(state["x"])

    def solve(self, damping):
        return np.array([-self.at / (1 + damping)])

    def decrease(self, step):
        return float(-self.at * step[0] - 0.5 * step[0] ** 2)

    def move(self, state, step):
        return {"x": state["x"] + step[0]}


def test_any_problem_that_linearises_itself_is_minimised_and_can_be_watched():
    seen = []
    found = minimise(Descent(0), {"x": 7.0}, watch=lambda i, cost: seen.append((i, cost)))
    assert found.converged
    assert abs(found.state["x"]) < 1e-3
    assert [i for i, _ in seen] == list(range(1, len(seen) + 1))
    assert [cost for _, cost in seen] == sorted((cost for _, cost in seen), reverse=True)


def test_no_state_is_moved_along_a_step_that_is_none():
    class Unsolved(Descent):
        def linearise(self, state):
            return Unsolved(state["x"])

        def solve(self, damping):
            return np.array([np.nan]) if damping < 1 else super().solve(damping)

        def move(self, state, step):
            assert np.isfinite(step).all()
            return super().move(state, step)

    assert abs(minimise(Unsolved(0), {"x": 7.0}).state["x"]) < 1e-3


def test_normal_equations_that_are_known_are_not_asked_for_again():
    class Counted(Descent):
        asked = 0

        def linearise(self, state):
            Counted.asked += 1
            return super().linearise(state)

    plain = minimise(Counted(0), {"x": 7.0})
    asked, Counted.asked = Counted.asked, 0
    known = minimise(Counted(0), {"x": 7.0}, first=Descent(7.0))
    assert Counted.asked == asked - 1
    assert known.state == plain.state


# -- normal equations with groups -------------------------------------------------------------------------------


def grouped(counts=(4, 6, 5), shared=3, local=2):
    rng = np.random.default_rng(3)
    rows = sum(counts)
    ends = np.cumsum([0, *counts])
    groups = [slice(a, b) for a, b in itertools.pairwise(ends)]
    a, b, r = rng.normal(size=(rows, 2, shared)), rng.normal(size=(rows, 2, local)), rng.normal(size=(rows, 2))
    dense = np.zeros((2 * rows, shared + local * len(counts)))
    dense[:, :shared] = a.reshape(2 * rows, shared)
    for i, part in enumerate(groups):
        block = b[part].reshape(-1, local)
        dense[2 * part.start : 2 * part.stop, shared + i * local : shared + (i + 1) * local] = block
    return GroupedNormal.assemble(a, b, r, groups), dense, r.ravel()


@pytest.mark.parametrize("damping", [0.0, 1e-3, 10.0])
def test_the_schur_complement_solves_the_whole_system(damping):
    normal, dense, r = grouped()
    hessian = dense.T @ dense
    expected = np.linalg.solve(hessian + damping * np.diag(np.diagonal(hessian)), -dense.T @ r)
    np.testing.assert_allclose(normal.solve(damping), expected, rtol=1e-9, atol=1e-12)


def test_the_predicted_fall_is_that_of_the_linearised_cost():
    normal, dense, r = grouped()
    step = np.random.default_rng(0).normal(size=dense.shape[1])
    expected = 0.5 * r @ r - 0.5 * ((r + dense @ step) ** 2).sum()
    assert normal.decrease(step) == pytest.approx(expected, rel=1e-10)


def test_the_covariance_of_the_shared_is_the_block_of_the_inverse():
    normal, dense, _ = grouped()
    expected = np.linalg.inv(dense.T @ dense)[:3, :3]
    np.testing.assert_allclose(normal.shared_covariance(), expected, rtol=1e-9)


def test_nothing_shared_and_nothing_local_are_problems_too():
    normal, dense, r = grouped(shared=0)
    np.testing.assert_allclose(normal.solve(0.0), np.linalg.lstsq(dense, -r, rcond=None)[0], atol=1e-10)


# -- losses -----------------------------------------------------------------------------------------------------


def test_hubers_loss_is_quadratic_then_linear():
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


def test_the_weight_is_the_slope_of_the_cost_over_the_length():
    loss = Huber(1.5)
    for length in (0.3, 1.4, 1.6, 20.0):
        slope = (loss.cost(np.array([length + 1e-6])) - loss.cost(np.array([length - 1e-6]))) / 2e-6
        assert loss.weight(np.array([length]))[0] == pytest.approx(slope / length, rel=1e-6)


def test_robust_sigma_is_that_of_the_inliers():
    rng = np.random.default_rng(2)
    length = np.linalg.norm(0.3 * rng.normal(size=(20000, 2)), axis=1)
    length[:2000] = 1e4
    assert robust_sigma(length) == pytest.approx(0.3, rel=0.1)
    assert robust_sigma(length[2000:]) == pytest.approx(0.3, rel=0.02)
    assert robust_sigma(np.array([])) == 0
