import numpy as np
import pytest
import scipy.optimize

from omnisight.geometry import rotation as so3
from omnisight.optim.gauss_newton import NormalEquations, gauss_newton, gauss_newton_batch
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.ransac import RansacOptions


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
MEASURED = 3.0 * np.exp(-0.7 * T) + 0.5 + 0.02 * np.random.default_rng(1).normal(size=T.size)


def decay(x):
    return x[0] * np.exp(-x[1] * T) + x[2] - MEASURED


def decay_slope(x):
    e = np.exp(-x[1] * T)
    return decay(x), np.stack([e, -x[0] * T * e, np.ones_like(T)], -1)


# -- dense problems ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (5.0, -7.0)])
def test_rosenbrock_minimum_is_found(start):
    found = gauss_newton(rosenbrock_slope, np.array(start))
    assert found.converged
    np.testing.assert_allclose(found.state, [1, 1], atol=1e-8)
    assert found.cost < 1e-16


def test_powell_singular_minimum_is_approached():
    found = gauss_newton(powell_slope, np.array([3.0, -1.0, 0.0, 1.0]), max_iterations=200)
    assert found.cost < 1e-15
    np.testing.assert_allclose(found.state, 0, atol=1e-3)


def test_curve_fit_agrees_with_scipy():
    found = gauss_newton(decay_slope, np.array([1.0, 0.1, 0.0]))
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

    def test_bounds_are_respected(self, low, high):
        found = gauss_newton(decay_slope, self.start, bounds=(low, high))
        assert (low <= found.state).all()
        assert (found.state <= high).all()
        assert found.cost < 0.5 * (decay(self.start) ** 2).sum()

    def test_constrained_minimum_agrees_with_scipy(self, low, high):
        found = gauss_newton(decay_slope, self.start, bounds=(low, high), max_iterations=1000)
        truth = scipy.optimize.least_squares(decay, self.start, bounds=(low, high), xtol=1e-14, ftol=1e-14)
        assert found.cost == pytest.approx(truth.cost, rel=1e-4)


def test_a_parameter_with_equal_bounds_is_fixed():
    start = np.array([1.0, 0.5, 0.4])
    found = gauss_newton(
        decay_slope, start, bounds=(np.array([-np.inf, 0.5, -np.inf]), np.array([np.inf, 0.5, np.inf]))
    )
    assert found.state[1] == 0.5
    design = np.stack([np.exp(-0.5 * T), np.ones_like(T)], -1)
    np.testing.assert_allclose(found.state[[0, 2]], np.linalg.lstsq(design, MEASURED, rcond=None)[0], rtol=1e-6)
    np.testing.assert_array_equal(start, [1.0, 0.5, 0.4])


def test_a_parameter_without_influence_keeps_its_value():
    def wide(x):
        r, slope = rosenbrock_slope(x[:2])
        return r, np.column_stack([slope, np.zeros(2)])

    found = gauss_newton(wide, np.array([-1.2, 1.0, 42.0]))
    np.testing.assert_allclose(found.state, [1, 1, 42], atol=1e-8)


def test_a_singular_system_is_solved():
    # Only the sum matters: singular, and still solved.
    def slope(x):
        return np.array([x[0] + x[1] - 3, 2 * (x[0] + x[1] - 3)]), np.array([[1.0, 1.0], [2.0, 2.0]])

    found = gauss_newton(slope, np.zeros(2))
    assert found.state.sum() == pytest.approx(3, abs=1e-6)


def test_an_impossible_initial_state_is_reported():
    found = gauss_newton(lambda x: (x * np.nan, np.eye(1)), np.zeros(1))
    assert not found.converged
    assert found.cost == np.inf
    assert found.iterations == 0
    assert found.reason == "the cost of the initial state is not finite"


def test_steps_to_an_impossible_state_are_rejected():
    # log x past the edge at 0: the first full step from 5 would leave the domain.
    def r(x):
        return np.log(x) + 3 if x[0] > 0 else np.array([np.nan])

    found = gauss_newton(lambda x: (r(x), np.diag(1 / x)), np.array([5.0]))
    assert found.converged
    assert found.state[0] == pytest.approx(np.exp(-3))


def test_running_out_of_iterations_is_reported():
    found = gauss_newton(rosenbrock_slope, np.array([-1.2, 1.0]), max_iterations=3)
    assert not found.converged
    assert found.iterations == 3
    assert found.reason == "not converged after 3 iterations"
    assert found.cost < 0.5 * (rosenbrock([-1.2, 1.0]) ** 2).sum()


def test_a_start_at_the_minimum_is_kept():
    found = gauss_newton(rosenbrock_slope, np.ones(2))
    assert found.converged
    np.testing.assert_array_equal(found.state, [1, 1])


def rotation_residuals(rotation, before, after):
    """Return the residuals of R a - b and their Jacobian by a rotation vector applied from the left."""
    turned = before @ rotation.T
    return (turned - after).ravel(), -so3.hat(turned).reshape(-1, 3)


def test_a_rotation_is_estimated_with_a_retraction():
    rng = np.random.default_rng(4)
    before, truth = rng.normal(size=(20, 3)), so3.exp([0.4, -1.1, 0.3])
    after = before @ truth.T
    found = gauss_newton(
        lambda r: rotation_residuals(r, before, after), np.eye(3), retract=lambda r, step: so3.exp(step) @ r
    )
    assert found.converged
    np.testing.assert_allclose(found.state, truth, atol=1e-9)
    np.testing.assert_allclose(found.hessian, sum(np.eye(3) * (p @ p) - np.outer(p, p) for p in after), rtol=1e-9)


def test_a_batch_solves_each_problem_as_if_it_were_alone():
    rng = np.random.default_rng(5)
    seen = MEASURED + 0.05 * rng.normal(size=(7, T.size))
    starts = np.array([1.0, 0.1, 0.0]) + 0.3 * rng.uniform(size=(7, 3))
    starts[4] = np.nan  # an impossible start affects no other problem
    sizes = []

    def linearize(x, problems):
        sizes.append(len(problems))
        e = np.exp(-x[:, 1:2] * T)
        jacobian = np.stack([e, -x[:, :1] * T * e, np.ones_like(e)], -1)
        return NormalEquations.of(x[:, :1] * e + x[:, 2:] - seen[problems], jacobian)

    found = gauss_newton_batch(linearize, starts)
    assert sizes[0] == 7
    assert sizes[-1] < 6  # converged problems are dropped
    for i in range(7):
        alone = gauss_newton(lambda x, i=i: (decay(x) + MEASURED - seen[i], decay_slope(x)[1]), starts[i])
        assert found.converged[i] == alone.converged == (i != 4)
        np.testing.assert_allclose(found.state[i], alone.state, rtol=1e-9)
        np.testing.assert_allclose(found.cost[i], alone.cost, rtol=1e-9)
        np.testing.assert_allclose(found.hessian[i], alone.hessian, rtol=1e-7)


def test_a_batch_of_poses_is_a_tuple_of_arrays():
    rng = np.random.default_rng(6)
    points = rng.normal(size=(4, 12, 3))
    rotations, translations = so3.exp(rng.normal(size=(4, 3))), rng.normal(size=(4, 3))
    target = points @ np.swapaxes(rotations, 1, 2) + translations[:, None]

    def linearize(state, problems):
        turned = points[problems] @ np.swapaxes(state[0], 1, 2)
        residuals = turned + state[1][:, None] - target[problems]
        jacobian = np.concatenate([-so3.hat(turned), np.broadcast_to(np.eye(3), (*turned.shape, 3))], -1)
        return NormalEquations.of(residuals.reshape(len(problems), -1), jacobian.reshape(len(problems), -1, 6))

    start = np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3))
    found = gauss_newton_batch(
        linearize, start, retract=lambda state, step: (so3.exp(step[:, :3]) @ state[0], state[1] + step[:, 3:])
    )
    assert found.converged.all()
    np.testing.assert_allclose(found.state[0], rotations, atol=1e-8)
    np.testing.assert_allclose(found.state[1], translations, atol=1e-8)
    np.testing.assert_array_equal(start[1], 0)


def test_weights_give_the_weighted_minimum():
    weights = np.linspace(0.1, 2.0, T.size)
    found = gauss_newton(lambda x: single(NormalEquations.of(*batched(decay_slope(x)), weights)), np.array([1, 0.1, 0]))
    truth = scipy.optimize.least_squares(lambda x: np.sqrt(weights) * decay(x), [1, 0.1, 0], xtol=1e-14, ftol=1e-14)
    np.testing.assert_allclose(found.state, truth.x, rtol=1e-6)


def batched(linearization):
    return tuple(values[None] for values in linearization)


def single(normal):
    return NormalEquations(*(values[0] for values in normal))


class Descent:
    """The parabola x^2/2 over states that are not vectors."""

    gradient = 1.0

    def __init__(self, at):
        self.at = at

    def cost(self, state):
        return 0.5 * state["x"] ** 2

    def linearize(self, state):
        return Descent(state["x"])

    def solve(self, damping):
        return np.array([-self.at / (1 + damping)])

    def decrease(self, step):
        return float(-self.at * step[0] - 0.5 * step[0] ** 2)

    def move(self, state, step):
        return {"x": state["x"] + step[0]}


def test_states_need_not_be_vectors_and_progress_is_reported():
    seen = []
    found = minimize(Descent(0), {"x": 7.0}, watch=lambda i, cost: seen.append((i, cost)))
    assert found.converged
    assert abs(found.state["x"]) < 1e-3
    assert [i for i, _ in seen] == list(range(1, len(seen) + 1))
    assert [cost for _, cost in seen] == sorted((cost for _, cost in seen), reverse=True)


def test_a_step_that_is_not_finite_is_not_taken():
    class Unsolved(Descent):
        def linearize(self, state):
            return Unsolved(state["x"])

        def solve(self, damping):
            return np.array([np.nan]) if damping < 1 else super().solve(damping)

        def move(self, state, step):
            assert np.isfinite(step).all()
            return super().move(state, step)

    assert abs(minimize(Unsolved(0), {"x": 7.0}).state["x"]) < 1e-3


def test_known_normal_equations_are_not_computed_again():
    class Counted(Descent):
        linearizations = 0

        def linearize(self, state):
            Counted.linearizations += 1
            return super().linearize(state)

    plain = minimize(Counted(0), {"x": 7.0})
    linearizations, Counted.linearizations = Counted.linearizations, 0
    known = minimize(Counted(0), {"x": 7.0}, first=Descent(7.0))
    assert Counted.linearizations == linearizations - 1
    assert known.state == plain.state


def test_a_problem_whose_steps_are_never_finite_has_not_converged():
    class Singular:
        def cost(self, state):
            return 1.0

        def linearize(self, state):
            return self

        def move(self, state, step):
            return state + step

        def solve(self, damping):
            return np.full(2, np.nan)

        def decrease(self, step):
            return 1.0

    found = minimize(Singular(), np.zeros(2))
    assert not found.converged
    assert "no finite solution" in found.reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": -1}, "seed must be 0 or more, got -1"),
        ({"max_iterations": 0}, "max_iterations must be at least 1"),
        ({"confidence": 1.0}, "confidence must be between 0 and 1"),
    ],
)
def test_options_of_the_search_are_checked(change, message):
    with pytest.raises(ValueError, match=message):
        RansacOptions(**change)
