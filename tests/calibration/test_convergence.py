"""A slice of the convergence benchmark: the search reaches the optimum that the true camera leads to."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibrating import calibrate
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.multistart import low_discrepancy
from omnisight.calibration.resection import linear_board_poses, refine_board_poses
from omnisight.models import initial_models, model_class, model_names
from omnisight.targets.observations import Observations

ROOT = Path(__file__).resolve().parents[2]

# Every field of view; few images, noise, outliers; decentred axes; boards behind the camera, near, partial, clustered.
CELLS = (
    "60/radial_tangential/aside/parts/1/0.1/10",
    "60/kannala_brandt/middle/usual/0.2/0.1/10",
    "100/equisolid/middle/parts/0.2/0.1/10",
    "140/unified/aside/usual/1/0/4",
    "180/equidistant/aside/narrow/0.2/0/10",
    "200/kannala_brandt/middle/near/1/0.1/10",
    "240/ocam/aside/past90/0.2/0.1/10",
    "280/stereographic/middle/past90/0/0/4",
    "280/parabola/aside/usual/1/0.1/4",
    "280/mirror_ocam/aside/parts/0.2/0.1/10",
)
# Cells, each with a model, in which earlier versions of the search did not reach the optimum.
HARD = (
    ("240/stereographic/aside/past90/0/0/20", "radial_polynomial"),
    ("240/ocam/aside/parts/0.2/0.1/4", "ocam"),
    ("280/equidistant/middle/past90/0/0/20", "double_sphere"),
    ("100/equidistant/aside/narrow/0.2/0.1/4", "rational"),
    ("180/stereographic/aside/narrow/0.2/0.1/4", "rational"),
    ("60/kannala_brandt/middle/parts/0.2/0/4", "thin_prism_fisheye"),
    ("240/double_sphere/aside/parts/1/0.1/10", "double_sphere"),
    ("200/double_sphere/aside/near/1/0/60", "mei"),
    # The costs of its local minima differ by a thousandth.
    ("200/fov/middle/usual/1/0.1/60", "double_sphere"),
    # So wide that hardly another xi fits.
    ("280/stereographic/middle/near/0.2/0.1/20", "mei"),
    # A pole of the distortion close to an outlier.
    ("140/equidistant/middle/parts/1/0.1/10", "rational"),
    ("200/stereographic/aside/narrow/1/0.1/20", "rational"),
    # Slow convergence of a model with many parameters.
    ("100/division/middle/usual/1/0.1/60", "rational"),
    ("280/mirror_ocam/middle/near/0.2/0/10", "mei"),
    # Two local minima with opposite tilts.
    ("240/mirror_ocam/middle/usual/1/0.1/60", "fisheye624"),
    # The optimum nearly folds inside the corners.
    ("100/stereographic/aside/parts/1/0.1/4", "rational"),
    ("280/hyperbola/middle/past90/0.2/0/4", "kannala_brandt"),
    # Outliers dominate subsets of the corners.
    ("140/stereographic/middle/narrow/0.2/0.1/60", "rational"),
    # The polynomial of one degree less is a nearer start, but leads to a higher cost.
    ("60/kannala_brandt/middle/parts/1/0.1/4", "ocam"),
    # Optima right at a fold inside the corners.
    ("100/equisolid/middle/parts/1/0.1/4", "rational"),
    ("100/pinhole/middle/near/0.2/0.1/4", "rational"),
    # The optimum depends on the barrier.
    ("100/pinhole/middle/near/0/0/4", "rational"),
    ("140/unified/middle/near/0/0/4", "fisheye624"),
    # Few corners, many parameters.
    ("60/pinhole/middle/parts/1/0.1/4", "fisheye624"),
    # A fold among the outermost corners.
    ("280/equidistant/aside/past90/0/0/20", "ocam"),
    # Without noise, outliers gain more than the inliers lose.
    ("140/equidistant/middle/parts/0/0.1/4", "rational"),
)
# The candidates of `--model auto`, and one model with a planar profile.
MODELS = ("unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam", "division")


@pytest.fixture
def convergence(monkeypatch):
    """The module of the benchmark."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import convergence

    return convergence


@pytest.mark.parametrize("text", CELLS)
def test_every_model_that_represents_the_lens_reaches_the_optimum(convergence, text):
    cell = convergence.Cell.parse(text)
    runs = convergence.run(cell, MODELS)
    assert {"ocam"} <= {run.model.split()[0] for run in runs}
    assert [str((run.model, run.excess)) for run in runs if not run.reached] == []


@pytest.mark.parametrize(("text", "model"), HARD)
def test_hard_cells_reach_the_optimum(convergence, text, model):
    runs = convergence.run(convergence.Cell.parse(text), [model])
    assert runs
    assert [str((run.model, run.excess)) for run in runs if not run.reached] == []


def test_benchmark_runs_what_calibrate_runs(convergence):
    cell = convergence.Cell.parse("240/double_sphere/aside/usual/0.2/0.1/10")
    simulated = convergence.scene(cell)
    calibration = calibrate(simulated.views, model="double_sphere", flat=True)
    best = convergence.fitted("double_sphere", simulated.state, simulated.views)
    assert convergence.bearing_error(calibration.camera.model, simulated) < 0.5
    np.testing.assert_allclose(calibration.state.lengths(simulated.views), best.lengths(simulated.views), atol=1e-2)
    assert np.array_equal(~calibration.outliers, simulated.clean)


def test_benchmark_detects_a_search_that_fails(convergence, monkeypatch):
    def with_permuted_poses(views):
        initial = estimate_initial_camera(views)
        initial.rotations[:] = np.roll(initial.rotations, 1, 0)
        initial.translations[:] = np.roll(initial.translations, 1, 0)
        return initial

    monkeypatch.setattr(convergence, "estimate_initial_camera", with_permuted_poses)
    (run,) = convergence.run(convergence.Cell.parse("180/equidistant/middle/usual/0.2/0/4"), ["equidistant"])
    assert not run.reached


@cache
def boards(count=40):
    """Return boards of 5 x 4 corners, small and far, anywhere around the camera, a fifth of their corners outliers."""
    from omnisight.geometry import rotation as so3

    rng = np.random.default_rng(0)
    plane = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), -1).reshape(-1, 2)
    points = np.pad(plane, ((0, 0), (0, 1)))
    rotations, translations, bearings = [], [], []
    for _ in range(count):
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        # The board faces the camera, tilted by half a radian.
        facing = so3.nearest(np.column_stack([*rng.normal(size=(2, 3)), towards]))
        facing = so3.nearest(facing + 2 * np.outer(towards, [0, 0, 1]))
        rotation = facing @ so3.exp([0.5, -0.3, rng.uniform(-3, 3)])
        translation = towards * rng.uniform(8, 14) - rotation @ points.mean(0)
        in_camera = points @ rotation.T + translation
        in_camera += rng.normal(0, 5e-4, in_camera.shape) * np.linalg.norm(in_camera, axis=1)[:, None]
        is_outlier = np.arange(len(points)) % 5 == rng.integers(5)
        in_camera[is_outlier] = rng.normal(size=(is_outlier.sum(), 3))
        rotations.append(rotation)
        translations.append(translation)
        bearings.append(in_camera / np.linalg.norm(in_camera, axis=1)[:, None])
    unused = 10 * points[:, :2]  # the pixels, which the poses of bearings do not depend on
    views = Observations.from_arrays([points] * count, [unused] * count, size=(640, 480))
    return views, np.concatenate(bearings), np.array(rotations), np.array(translations)


def angles_between(rotations, others):
    """Return the angles (V,) between rotations (V, 3, 3), degrees."""
    return np.degrees(np.arccos(np.clip((np.einsum("vij,vij->v", rotations, others) - 1) / 2, -1, 1)))


def test_small_boards_anywhere_on_the_sphere_are_resected_with_a_fifth_of_outliers():
    views, bearings, rotations, translations = boards()
    estimated_rotations, estimated_translations = refine_board_poses(
        views, bearings, *linear_board_poses(views, bearings)
    )
    angle = angles_between(estimated_rotations, rotations)
    assert np.median(angle) < 1
    assert (angle < 6).mean() > 0.95
    assert np.median(np.linalg.norm(estimated_translations - translations, axis=1)) < 0.1


def test_flipped_boards_are_corrected():
    views, bearings, rotations, translations = boards()
    middle = rotations @ views.points[views.groups[0]].mean(0) + translations
    direction = middle / np.linalg.norm(middle, axis=1)[:, None]
    flipped = (np.eye(3) - 2 * direction[:, :, None] * direction[:, None, :]) @ rotations * (1.0, 1.0, -1.0)
    shifted = middle - flipped @ views.points[views.groups[0]].mean(0)
    estimated_rotations, _ = refine_board_poses(views, bearings, flipped, shifted)
    angle = angles_between(estimated_rotations, rotations)
    assert (angle < 6).mean() > 0.95


def test_views_with_too_few_corners_have_no_pose():
    views, bearings, _, _ = boards()
    partial = bearings.copy()
    partial[views.groups[2]] = np.nan
    partial[5 + views.groups[1].start : views.groups[1].stop] = np.nan
    rotations, translations = linear_board_poses(views, partial)
    assert np.isnan(rotations[[1, 2]]).all()
    assert np.isnan(translations[[1, 2]]).all()
    assert np.isfinite(np.delete(rotations, [1, 2], 0)).all()


def test_low_discrepancy_points_are_those_of_scipy():
    expected = pytest.importorskip("scipy.stats").qmc.Halton(4, scramble=False).random(41)[1:]
    np.testing.assert_allclose(low_discrepancy(40, 4), expected, rtol=0, atol=1e-15)


def test_priors_of_the_starts_lie_within_the_bounds():
    drawn = [
        p
        for name in model_names()
        for p in model_class(name).example().parameters
        if p.start_scale > 0 or p.start_range is not None
    ]
    assert drawn
    assert all(p.free and not p.start_zero for p in drawn)
    assert all(p.start_range is None or p.low <= p.start_range[0] < p.start_range[1] <= p.high for p in drawn)


def test_models_of_the_initial_search_cover_pinholes_and_more_than_a_hemisphere():
    models = initial_models()
    assert models
    reach = [
        cls.from_dict({"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0} | shape).theta_max
        for cls in models
        for shape in cls.INITIAL_SHAPES
    ]
    assert max(reach) > np.radians(150)
