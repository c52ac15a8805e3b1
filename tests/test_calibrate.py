"""Calibration from corners: it starts by itself on every lens and mirror, tells the truth, and says what to doubt."""

import json
from functools import cache

import numpy as np
import pytest

from omnisight.calibrate import BoardViews, calibrate_camera
from omnisight.calibrate.refine import refine
from omnisight.geometry import rotation as so3
from omnisight.models import model_class, model_names
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6)
SIZE = (960, 960)
CENTRE = (481.3, 476.2)
RIM = 470.0  # px from the centre to the edge of the picture's circle
NOISE = 0.2
# The length of a residual has two coordinates, each with the noise.
NOISE_RMS = NOISE * np.sqrt(2)

# Field of view (degrees), and a lens or mirror that has it; the focal length follows.
LENSES = {
    60: ("radial_tangential", {"k1": -0.12, "k2": 0.03, "p1": 1e-3, "p2": -5e-4, "k3": 0.0}),
    100: ("stereographic", {}),
    140: ("equidistant", {}),
    180: ("equisolid", {}),
    200: ("kannala_brandt", {"k1": 0.02, "k2": -0.006, "k3": 0.001, "k4": -0.0002}),
    240: ("double_sphere", {"xi": -0.2, "alpha": 0.6}),
    280: ("unified", {"xi": 0.97}),
}


def lens(fov, centre=CENTRE, **changes):
    """Give the lens of that field of view, its rim RIM px from the centre."""
    name, shape = LENSES[fov]
    half = np.radians(fov / 2)
    rim = [[np.sin(half), 0.0, np.cos(half)]]
    plain = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, **shape}
    radius = model_class(name).from_dict(plain).project(rim)[0][0, 0]
    focal = RIM / radius
    return model_class(name).from_dict({**plain, "fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1], **changes})


def facing(direction):
    """Give the shortest rotation that turns the axis to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = np.linalg.norm(axis)
    return so3.exp(axis / max(sine, 1e-12) * np.arctan2(sine, direction[2]))


def shoot(model, fov, rng, count=8, noise=NOISE, tilt=(0.35, 0.7), size=None):
    """Pose boards towards directions spread over the cone, tilted, and see their corners with noise.

    A board stays inside the cone; with a size, corners outside the picture are left out.
    """
    middle = BOARD.points.mean(0)
    half = np.radians(fov / 2)
    near = (6, 12) if fov > 70 else (12, 20)
    views = []
    for i in range(count):
        while True:
            distance = rng.uniform(*near)
            theta = max(half - 0.95 * np.arctan(4.7 / distance), 0) * np.sqrt((i + 0.5) / count)
            phi = 2.4 * i + rng.uniform(-0.3, 0.3)
            towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
            about = rng.normal(size=2)
            lean = so3.exp([*(about / np.linalg.norm(about) * rng.uniform(*tilt)), 0.0])
            turn = facing(towards) @ so3.exp([0.0, 0.0, rng.uniform(-3, 3)]) @ lean
            points = (BOARD.points - middle) @ turn.T + distance * towards
            pixels, valid = model.project(points)
            if valid.all() and np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]).max() < half:
                break
        pixels = pixels + rng.normal(0, noise, pixels.shape)
        seen = np.ones(len(pixels), bool) if size is None else ((pixels > 0) & (pixels < np.array(size) - 1)).all(1)
        if seen.sum() >= 12:
            views.append((BOARD.points[seen], pixels[seen]))
    return views


def bearing_error(camera, truth, theta_max):
    """Give the largest angle (degrees) between the bearings that two cameras give a pixel, over a cone.

    The cameras may be turned against each other: a centre a little aside is a rotation, and no pose of a board knows.
    """
    theta = np.linspace(0.02, theta_max, 20)[:, None]
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    parts = np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    true = np.stack(parts, -1).reshape(-1, 3)
    pixels, _ = truth.project(true)
    found, valid = camera.unproject(pixels)
    assert valid.all()
    aligned = found @ so3.nearest(true.T @ found).T
    return float(np.degrees(np.linalg.norm(aligned - true, axis=1).max()))


@cache
def calibrated(fov, seed=0, count=8, noise=NOISE, **options):
    truth = lens(fov)
    views = shoot(truth, fov, np.random.default_rng(seed), count, noise)
    return truth, calibrate_camera(BoardViews.of(views), SIZE, **options)


def shown(pictures, **options):
    """Calibrate on the first pictures of a fisheye of 180 degrees."""
    return calibrate_camera(BoardViews.of(shoot(lens(180), 180, np.random.default_rng(0))[:pictures]), SIZE, **options)


# -- it starts by itself -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fov", "seed"), [*((fov, 0) for fov in LENSES), (60, 1), (180, 1), (280, 1)])
def test_every_field_of_view_starts_without_a_guess_and_ends_at_the_noise(fov, seed):
    truth, found = calibrated(fov, seed)
    # 8 pictures of 54 corners leave the camera about 0.95 of the noise to explain.
    assert 0.85 * NOISE_RMS < found.rms < 1.1 * NOISE_RMS
    assert 0.8 * found.rms < found.mean < found.rms
    assert not found.outliers.any()
    assert bearing_error(found.camera, truth, 0.95 * found.camera.theta_max) < 0.3
    assert found.camera.size == SIZE
    assert np.radians(fov / 2) * 0.75 < found.camera.theta_max < np.radians(fov / 2) * 1.05
    assert not any(check.name in ("tilt", "residuals", "halves") and check.sentence for check in found.verdict.checks)


@pytest.mark.parametrize("fov", [60, 180, 280])
def test_wrong_corners_are_outvoted_and_named(fov):
    truth = lens(fov)
    rng = np.random.default_rng(3)
    views = shoot(truth, fov, rng)
    wrong = []
    for _, pixels in views:
        bad = rng.random(len(pixels)) < 0.1
        pixels[bad] += rng.uniform(8, 40, (bad.sum(), 1)) * rng.choice([-1, 1], (bad.sum(), 2))
        wrong.append(bad)
    found = calibrate_camera(BoardViews.of(views), SIZE)
    assert np.array_equal(found.outliers, np.concatenate(wrong))
    kept = found.residual_lengths[~found.outliers]
    assert np.sqrt((kept**2).mean()) < 1.2 * NOISE_RMS
    assert bearing_error(found.camera, truth, 0.95 * found.camera.theta_max) < 0.6
    assert found.camera.theta_max < np.radians(fov / 2) * 1.05


@pytest.mark.parametrize("fov", [100, 180, 240])
def test_a_centre_far_from_the_pictures_middle_is_found(fov):
    size = (960, 720)
    truth = lens(fov, centre=(690.0, 230.0))
    views = shoot(truth, fov, np.random.default_rng(5), count=14, size=size)
    found = calibrate_camera(BoardViews.of(views), size)
    assert found.rms < 1.1 * NOISE_RMS
    centre, _ = found.camera.project([0.0, 0.0, 1.0])
    assert np.linalg.norm(centre - (690.0, 230.0)) < 3
    assert bearing_error(found.camera, truth, 0.9 * found.camera.theta_max) < 0.2


@pytest.mark.parametrize("fov", LENSES)
def test_exact_corners_are_explained_exactly(fov):
    truth, found = calibrated(fov, noise=0.0, model=LENSES[fov][0])
    assert found.rms < 1e-6
    assert bearing_error(found.camera, truth, found.camera.theta_max) < 1e-5


@pytest.mark.parametrize("handed", [1.0, -1.0])
def test_numbers_may_be_of_any_scale_and_the_board_seen_from_behind(handed):
    truth = lens(180)
    views = shoot(truth, 180, np.random.default_rng(0))
    flip = np.array([handed, 1.0])
    metres = [(points * 1e-3, (pixels - CENTRE) * flip + CENTRE) for points, pixels in views]
    found = calibrate_camera(BoardViews.of(metres), SIZE, model="equisolid")
    assert found.rms < 1.1 * NOISE_RMS
    assert np.linalg.norm(found.state.translations, axis=1).max() < 0.05


# -- which model -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fov", LENSES)
def test_auto_takes_what_represents_the_lens_and_says_why(fov):
    _, found = calibrated(fov, 0)
    asked = [c for c in found.candidates if c.held_out_rms is not None]
    assert len(asked) >= 2
    chosen = found.candidates[[c.state is found.state for c in found.candidates].index(True)]
    assert chosen.name.split()[0] == found.camera.model.name
    assert found.held_out_rms == chosen.held_out_rms
    assert NOISE_RMS * 0.9 < found.held_out_rms < 1.1 * NOISE_RMS
    assert found.held_out_rms <= 1.0101 * min(c.held_out_rms for c in asked)
    # One sentence: the model, its figure, and what it was measured against.
    assert found.reason.startswith(f"{chosen.name}: {found.held_out_rms:.3f} px on pictures it was not calibrated on")
    assert found.reason.endswith(".")
    assert ". " not in found.reason
    assert chosen is found.candidates[0]
    order = [c.held_out_rms for c in found.candidates[1:] if c.held_out_rms is not None]
    assert order == sorted(order)


def test_a_model_that_cannot_bend_so_far_is_worse_and_says_so_in_figures():
    _, plain = calibrated(240, model="stereographic")
    _, good = calibrated(240, model="double_sphere")
    assert plain.rms > 3 * good.rms
    assert plain.held_out_rms > 3 * good.held_out_rms


def test_candidates_hold_their_figures():
    _, found = calibrated(140, 0)
    for candidate in found.candidates:
        figures = candidate.as_dict()
        assert set(figures) == {"model", "parameters", "rms", "mean", "held_out_rms"}
        assert figures["mean"] <= figures["rms"]
        assert figures["parameters"] == candidate.freedom.directions.shape[1]
    assert json.dumps([c.as_dict() for c in found.candidates])


@pytest.mark.parametrize("model", ["unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam", "division"])
def test_one_model_by_name(model):
    _, found = calibrated(180, model=model)
    assert found.camera.model.name == model
    assert {c.name.split()[0] for c in found.candidates} == {model}


# -- what moves --------------------------------------------------------------------------------------------------


def skewed():
    truth = lens(280, skew=4.0)
    return truth, BoardViews.of(shoot(truth, 280, np.random.default_rng(1), count=10))


def test_a_skew_stands_still_unless_freed():
    truth, views = skewed()
    still = calibrate_camera(views, SIZE, model="unified")
    moved = calibrate_camera(views, SIZE, model="unified", free=("skew",))
    assert still.camera.model.skew == 0
    assert moved.camera.model.skew == pytest.approx(truth.skew, abs=0.5)
    assert moved.rms < 1.1 * NOISE_RMS < still.rms
    assert moved.candidates[0].parameters == still.candidates[0].parameters + 1


def test_a_fixed_parameter_is_not_estimated_and_has_no_deviation():
    truth, views = skewed()
    found = calibrate_camera(views, SIZE, model="unified", free=("skew",), fixed=("xi",))
    at = found.camera.model.param_names.index("xi")
    assert found.candidates[0].parameters == truth.params.size - 1
    assert np.all(found.camera.covariance[at] == 0)
    assert np.all(np.delete(np.diag(found.camera.covariance), at) > 0)


def test_least_squares_has_the_least_squares():
    truth = lens(180)
    rng = np.random.default_rng(3)
    views = shoot(truth, 180, rng)
    for _, pixels in views:
        pixels[rng.random(len(pixels)) < 0.05] += 6
    joined = BoardViews.of(views)
    squared, huber = (calibrate_camera(joined, SIZE, model="equisolid", loss=loss) for loss in ("squared", "huber"))
    assert squared.rms <= huber.rms
    assert huber.mean < squared.mean
    reach = 0.95 * np.radians(90)
    assert bearing_error(huber.camera, truth, reach) < bearing_error(squared.camera, truth, reach)


# -- how sure ----------------------------------------------------------------------------------------------------


def test_the_covariance_predicts_the_spread():
    truth, first = calibrated(240, 0, model="double_sphere")
    predicted = np.sqrt(np.diag(first.camera.covariance))
    exact = shoot(truth, 240, np.random.default_rng(0), noise=0.0)
    found = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        views = BoardViews.of([(x, p + rng.normal(0, NOISE, p.shape)) for x, p in exact])
        found.append(refine(first.state, views).state.model.params)
    ratio = np.std(found, axis=0, ddof=1) / predicted
    assert np.all((ratio > 1 / 1.5) & (ratio < 1.5)), ratio
    # And the estimate is not beside the truth.
    assert np.all(np.abs(np.mean(found, axis=0) - truth.params) < 4 * predicted / np.sqrt(25))


def test_the_cameras_figures_are_those_of_the_calibration():
    _, found = calibrated(180, 0)
    figures = found.camera.calibration
    assert figures["verdict"] == str(found.verdict)
    assert figures["reasons"] == list(found.verdict.reasons)
    assert figures["uncertainty_px"] == found.trust.uncertainty.worst()[0]
    assert "board_warp" not in figures
    assert {name: figures[name] for name in ("rms", "mean", "held_out_rms", "pictures", "corners", "outliers")} == {
        "rms": found.rms,
        "mean": found.mean,
        "held_out_rms": found.held_out_rms,
        "pictures": 8,
        "corners": 8 * BOARD.size,
        "outliers": 0,
    }
    lengths = found.residual_lengths
    assert found.rms == pytest.approx(np.sqrt((lengths**2).mean()))
    assert found.mean == pytest.approx(lengths.mean())


def test_progress_tells_its_stages_and_the_same_corners_give_the_same_camera():
    told = []
    truth, first = calibrated(140, 0)
    views = BoardViews.of(shoot(truth, 140, np.random.default_rng(0)))
    second = calibrate_camera(views, SIZE, progress=lambda *state: told.append(state))
    assert list(dict.fromkeys(stage for stage, _, _ in told)) == ["start", "fit", "hold out", "judge"]
    assert all(0 <= done <= total for _, done, total in told)
    assert np.array_equal(first.camera.model.params, second.camera.model.params)


# -- what to doubt, and what to refuse ---------------------------------------------------------------------------


def test_too_few_pictures_are_refused_with_the_number_and_the_remedy():
    with pytest.raises(ValueError, match=r"2 pictures with a board are too few: 3 is the least.*tilted"):
        shown(2)
    forced = shown(2, force=True)
    assert forced.rms < NOISE_RMS * 1.1
    assert forced.held_out_rms is None
    assert "too few pictures to hold any out" in forced.reason


@pytest.mark.parametrize("pictures", [1, 2])
def test_a_forced_calibration_takes_few_parameters_and_is_doubted(pictures):
    forced = shown(pictures, force=True)
    assert forced.candidates[0].parameters <= 6
    assert str(forced.verdict) == "do not use"
    assert "leave" in forced.verdict.reasons[0]


@pytest.mark.parametrize("force", [False, True])
def test_no_picture_at_all_is_refused_even_by_force(force):
    with pytest.raises(ValueError, match="0 pictures with a board are too few"):
        calibrate_camera(BoardViews.of([]), SIZE, force=force)


def test_copies_of_a_picture_are_refused_and_named():
    view = shoot(lens(180), 180, np.random.default_rng(0))[3]
    views = BoardViews.of([view] * 3, ["a.png", "b.png", "c.png"])
    said = r"3 pictures with a board, but only 1 that differ \(a\.png = b\.png, a\.png = c\.png\): 3 is.*--force"
    with pytest.raises(ValueError, match=said):
        calibrate_camera(views, SIZE)
    found = calibrate_camera(views, SIZE, model="kannala_brandt", force=True)
    (same,) = [reason for reason in found.verdict.reasons if "repeat" in reason]
    assert str(found.verdict) == "do not use"
    assert "that repeat another one: 2 (a.png = b.png, a.png = c.png)" in same
    assert "move the board" in same


def test_boards_that_never_tilt_are_doubted_with_the_angle():
    truth = lens(60)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    views = []
    for x, y, distance in ((0, 0, 14), (3, 1, 16), (-3, 2, 18), (1, -3, 15), (-2, -2, 17)):
        points = (BOARD.points - middle) @ so3.exp([0.0, 0.0, x / 3]).T + [x, y, distance]
        pixels, _ = truth.project(points)
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    found = calibrate_camera(BoardViews.of(views), SIZE, model="pinhole")
    assert str(found.verdict) == "do not use"
    (tilt,) = [reason for reason in found.verdict.reasons if "tilt only" in reason]
    assert tilt.startswith("The boards tilt only ")
    assert float(tilt.split("only ")[1].split()[0]) < 10
    assert "tilted by 30 to 45 degrees" in tilt
    assert "leaves the focal length open (+-1000 % or more)" in tilt


def test_an_unknown_model_lists_those_there_are():
    with pytest.raises(ValueError, match="unknown camera model 'fisheye9'") as said:
        shown(8, model="fisheye9")
    assert all(name in str(said.value) for name in ("auto", *model_names()))


def test_an_unknown_loss_is_refused():
    with pytest.raises(ValueError, match="loss must be 'huber' or 'squared', got 'cauchy'"):
        shown(8, model="equisolid", loss="cauchy")


@pytest.mark.parametrize("options", [{"fixed": ("skwe",)}, {"free": ("skwe",)}])
def test_a_parameter_that_the_model_lacks_is_refused(options):
    with pytest.raises(ValueError, match="unified has no skwe; it has fx, fy, cx, cy, xi, skew"):
        shown(8, model="unified", **options)


def hopeless():
    """Give corners that no camera explains, and a model that cannot reach the corners it is given."""
    rng = np.random.default_rng(0)
    noise = [(BOARD.points, rng.uniform(0, 960, (BOARD.size, 2))) for _ in range(6)]
    return {"noise": (noise, "kannala_brandt"), "pinhole": (shoot(lens(280), 280, rng), "pinhole")}


@pytest.mark.parametrize("case", ["noise", "pinhole"])
def test_what_explains_nothing_is_not_called_a_camera_without_a_word(case):
    views, model = hopeless()[case]
    try:
        found = calibrate_camera(BoardViews.of(views), SIZE, model=model)
    except ValueError as error:
        said = str(error)
    else:
        said = " ".join(found.verdict.reasons)
        assert str(found.verdict) == "do not use"
    assert "explain" in said or "describe" in said


def test_the_corners_given_are_left_alone():
    views = shoot(lens(180), 180, np.random.default_rng(0))
    before = [(x.copy(), p.copy()) for x, p in views]
    calibrate_camera(BoardViews.of(views), SIZE, model="equisolid")
    assert all(
        np.array_equal(a, b) for old, new in zip(before, views, strict=True) for a, b in zip(old, new, strict=True)
    )


# -- real corners ------------------------------------------------------------------------------------------------

CORNERS = {
    "kaidan": (640, 480),
    "fish1": (1032, 778),
    "fstereo_left": (960, 600),
    "fstereo_right": (960, 600),
    "ai360_a": (1920, 1920),
    "derlunz": (1000, 750),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CORNERS)
def test_real_corners_are_explained_as_well_as_opencv_explains_them(data, name):
    # The sets of which OpenCV keeps every picture, so that both figures are over the same corners.
    folder = data("corners")
    theirs = json.loads((folder / "opencv_omnidir.json").read_text())[name]
    assert theirs["used"] == theirs["views"]
    with np.load(folder / f"{name}.npz") as stored:
        columns, rows = (int(n) for n in stored["pattern"])
        corners = stored["corners"].astype(float)
    points = Checkerboard(columns, rows).points
    views = BoardViews.of([(points, pixels) for pixels in corners])
    found = calibrate_camera(views, CORNERS[name], model="mei", free=("skew",), loss="squared")
    assert found.rms <= 1.01 * theirs["mei_rms"]
