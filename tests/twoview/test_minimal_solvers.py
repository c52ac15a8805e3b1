"""The laws of all minimal solvers: exact samples over the whole sphere, degenerate samples, wrong shapes."""

import numpy as np
import pytest
from motions import SUBJECTS, unit

SAMPLES = 500


@pytest.fixture(params=SUBJECTS)
def subject(request):
    return SUBJECTS[request.param]


def samples(subject, count=SAMPLES):
    return [subject.sample(np.random.default_rng(seed)) for seed in range(count)]


def are_rotations(rotations):
    gram = np.einsum("sij,sik->sjk", rotations, rotations)
    return np.allclose(gram, np.eye(3), rtol=0, atol=1e-9) and (np.linalg.det(rotations) > 0).all()


def test_an_exact_sample_over_the_whole_sphere_yields_its_motion(subject):
    errors = []
    for a, b, truth in samples(subject):
        poses = subject.solve(a, b)
        assert len(poses) <= subject.max_solutions
        assert are_rotations(poses[:, :, :3])
        errors.append(np.abs(poses - truth).max((1, 2)).min(initial=np.inf))
    assert np.mean(np.array(errors) < 1e-6) >= 0.995


def test_samples_reach_behind_both_cameras(subject):
    for camera in range(2):
        is_behind = np.array([sample[camera][:, 2] < 0 for sample in samples(subject, 100)])
        assert 0.3 < is_behind.mean() < 0.7


def test_every_solution_explains_its_sample_with_positive_distances(subject):
    found = 0
    for a, b, _ in samples(subject, 100):
        for pose in subject.solve(a, b):
            assert subject.residuals(pose, a, b).max() < 1e-5
            found += 1
    assert found >= 100


def test_a_degenerate_sample_yields_finite_poses_or_none(subject):
    for a, b, _ in samples(subject, 20):
        repeated = [np.repeat(x[:1], len(x), axis=0) for x in (a, b)]
        twice = [np.concatenate([x[:1], x[:-1]]) for x in (a, b)]
        same = (a, b if a.shape != b.shape else unit(a))
        for sample in (repeated, twice, same, (np.zeros_like(a), b), (a, np.zeros_like(b))):
            poses = subject.solve(*sample)
            assert len(poses) <= subject.max_solutions
            assert np.isfinite(poses).all()


def test_values_that_are_not_finite_yield_no_nan(subject):
    a, b, _ = subject.sample(np.random.default_rng(0))
    a[0] = np.nan
    assert np.isfinite(subject.solve(a, b)).all()


def test_another_shape_is_an_error(subject):
    a, b, _ = subject.sample(np.random.default_rng(0))
    with pytest.raises(ValueError, match="shape"):
        subject.solve(a[:-1], b[:-1])
    with pytest.raises(ValueError, match="shape"):
        subject.solve(a, b[:, :2])
