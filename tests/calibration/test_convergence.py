"""A slice of the convergence matrix: every start ends where a start at the truth ends, with no flags."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from omnisight.calibration.board_pose import linear_board_poses, refine_board_poses
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets.observations import Observations

ROOT = Path(__file__).resolve().parents[2]

# Every field of view; few images, noise and gross errors; axes aside, boards behind, near, cut, in one place.
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
# Cells that were lost once, each with the model that was.
LOST = (
    ("240/stereographic/aside/past90/0/0/20", "radial_polynomial"),
    ("240/ocam/aside/parts/0.2/0.1/4", "ocam"),
    ("280/equidistant/middle/past90/0/0/20", "double_sphere"),
    ("100/equidistant/aside/narrow/0.2/0.1/4", "rational"),
    ("180/stereographic/aside/narrow/0.2/0.1/4", "rational"),
    ("60/kannala_brandt/middle/parts/0.2/0/4", "thin_prism_fisheye"),
    ("240/double_sphere/aside/parts/1/0.1/10", "double_sphere"),
    ("200/double_sphere/aside/near/1/0/60", "mei"),
    # Its valleys differ by a thousandth.
    ("200/fov/middle/usual/1/0.1/60", "double_sphere"),
    # So wide that its xi can be hardly another.
    ("280/stereographic/middle/near/0.2/0.1/20", "mei"),
    # A pole that runs through a wrong corner.
    ("140/equidistant/middle/parts/1/0.1/10", "rational"),
    ("200/stereographic/aside/narrow/1/0.1/20", "rational"),
    # The slow valley of a rich model.
    ("100/division/middle/usual/1/0.1/60", "rational"),
    ("280/mirror_ocam/middle/near/0.2/0/10", "mei"),
    # Its frame may tilt two ways.
    ("240/mirror_ocam/middle/usual/1/0.1/60", "fisheye624"),
    # The optimum nearly folds over inside the corners.
    ("100/stereographic/aside/parts/1/0.1/4", "rational"),
    ("280/hyperbola/middle/past90/0.2/0/4", "kannala_brandt"),
    # Wrong corners among some lead astray, among all they do not.
    ("140/stereographic/middle/narrow/0.2/0.1/60", "rational"),
    # A polynomial of one degree less is nearer than a fresh one, and ends higher.
    ("60/kannala_brandt/middle/parts/1/0.1/4", "ocam"),
    # Optima right at a fold inside the corners.
    ("100/equisolid/middle/parts/1/0.1/4", "rational"),
    ("100/pinhole/middle/near/0.2/0.1/4", "rational"),
    # Lowest with the wall before a fold, not without.
    ("100/pinhole/middle/near/0/0/4", "rational"),
    ("140/unified/middle/near/0/0/4", "fisheye624"),
    # Few corners, many parameters.
    ("60/pinhole/middle/parts/1/0.1/4", "fisheye624"),
    # A fold among the outermost corners.
    ("280/equidistant/aside/past90/0/0/20", "ocam"),
    # Wrong corners gain more than the good ones, of which none is off, lose.
    ("140/equidistant/middle/parts/0/0.1/4", "rational"),
)
# What `auto` tries, and the model that stands for those made of a plane and a distortion.
MODELS = ("unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam", "division")


@pytest.fixture
def convergence(monkeypatch):
    """Give the benchmark's module: the test runs a slice of what it runs."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import convergence

    return convergence


@pytest.mark.parametrize("text", CELLS)
def test_every_model_that_can_represent_the_lens_reaches_the_optimum_that_the_truth_reaches(convergence, text):
    cell = convergence.Cell.parse(text)
    runs = convergence.run(cell, MODELS)
    assert {"ocam"} <= {run.model.split()[0] for run in runs}
    assert [str((run.model, run.excess)) for run in runs if not run.reached] == []


@pytest.mark.parametrize(("text", "model"), LOST)
def test_what_was_lost_once_is_reached(convergence, text, model):
    runs = convergence.run(convergence.Cell.parse(text), [model])
    assert runs
    assert [str((run.model, run.excess)) for run in runs if not run.reached] == []


def test_a_calibration_with_no_flags_is_what_the_matrix_runs(convergence):
    cell = convergence.Cell.parse("240/double_sphere/aside/usual/0.2/0.1/10")
    made = convergence.scene(cell)
    found = calibrate_camera(made.views, convergence.SIZE, model="double_sphere", flat=True)
    best = convergence.fitted("double_sphere", made.state, made.views)
    assert convergence.bearing_error(found.camera.model, made) < 0.5
    np.testing.assert_allclose(found.state.lengths(made.views), best.lengths(made.views), atol=1e-2)
    assert np.array_equal(~found.outliers, made.clean)


def test_the_benchmark_notices_a_start_that_goes_nowhere(convergence, monkeypatch):
    def astray(views, size):
        begun = estimate_initial_camera(views, size)
        begun.rotations[:] = np.roll(begun.rotations, 1, 0)
        begun.translations[:] = np.roll(begun.translations, 1, 0)
        return begun

    monkeypatch.setattr(convergence, "estimate_initial_camera", astray)
    (run,) = convergence.run(convergence.Cell.parse("180/equidistant/middle/usual/0.2/0/4"), ["equidistant"])
    assert not run.reached


@cache
def boards(count=40):
    """Give boards of 4 x 3 corners, small and far, anywhere around the camera, a fifth of their corners wrong."""
    from omnisight.geometry import rotation as so3

    rng = np.random.default_rng(0)
    plane = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), -1).reshape(-1, 2)
    points = np.pad(plane, ((0, 0), (0, 1)))
    rotations, translations, bearings, wrong = [], [], [], []
    for _ in range(count):
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        # The board's face to the camera, tilted by half a radian.
        facing = so3.nearest(np.column_stack([*rng.normal(size=(2, 3)), towards]))
        facing = so3.nearest(facing + 2 * np.outer(towards, [0, 0, 1]))
        rotation = facing @ so3.exp([0.5, -0.3, rng.uniform(-3, 3)])
        translation = towards * rng.uniform(8, 14) - rotation @ points.mean(0)
        seen = points @ rotation.T + translation
        seen += rng.normal(0, 5e-4, seen.shape) * np.linalg.norm(seen, axis=1)[:, None]
        bad = np.arange(len(points)) % 5 == rng.integers(5)
        seen[bad] = rng.normal(size=(bad.sum(), 3))
        rotations.append(rotation)
        translations.append(translation)
        bearings.append(seen / np.linalg.norm(seen, axis=1)[:, None])
        wrong.append(bad)
    views = Observations.of([(points, np.zeros((len(points), 2)))] * count)
    return views, np.concatenate(bearings), np.array(rotations), np.array(translations)


def test_small_boards_anywhere_on_the_sphere_are_posed_though_a_fifth_of_their_corners_is_wrong():
    views, bearings, rotations, translations = boards()
    found, place = refine_board_poses(views, bearings, *linear_board_poses(views, bearings))
    angle = np.degrees(np.arccos(np.clip((np.einsum("vij,vij->v", found, rotations) - 1) / 2, -1, 1)))
    assert np.median(angle) < 1
    assert (angle < 6).mean() > 0.95
    assert np.median(np.linalg.norm(place - translations, axis=1)) < 0.1


def test_a_board_turned_over_is_turned_back():
    views, bearings, rotations, translations = boards()
    middle = rotations @ views.points[views.groups[0]].mean(0) + translations
    sight = middle / np.linalg.norm(middle, axis=1)[:, None]
    over = (np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]) @ rotations * (1.0, 1.0, -1.0)
    moved = middle - over @ views.points[views.groups[0]].mean(0)
    found, _ = refine_board_poses(views, bearings, over, moved)
    angle = np.degrees(np.arccos(np.clip((np.einsum("vij,vij->v", found, rotations) - 1) / 2, -1, 1)))
    assert (angle < 6).mean() > 0.95


def test_pictures_with_too_few_corners_have_no_pose():
    views, bearings, _, _ = boards()
    some = bearings.copy()
    some[views.groups[2]] = np.nan
    some[5 + views.groups[1].start : views.groups[1].stop] = np.nan
    rotations, translations = linear_board_poses(views, some)
    assert np.isnan(rotations[[1, 2]]).all()
    assert np.isnan(translations[[1, 2]]).all()
    assert np.isfinite(np.delete(rotations, [1, 2], 0)).all()
