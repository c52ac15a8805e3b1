"""Camera change: images of two cameras, and cameras that change during the set."""

import numpy as np
import pytest

from calibrating import SIZE, calibrate, observe
from lenses import lens, observe_boards

MODEL = "equisolid"  # that of the lens


def two_cameras(in_order, magnification=1.02, shift=10.0, views=20, name="{0}.png"):
    """Return observations of a lens whose magnification and principal point change, and which views changed."""
    first = lens(180)
    values = first.to_dict()
    focal = {name: values[name] * magnification for name in ("fx", "fy")}
    second = first.with_values({**focal, "cx": values["cx"] + shift})
    shots = [observe_boards(model, 180, np.random.default_rng(4), count=views) for model in (first, second)]
    changed = np.arange(views) >= views // 2 if in_order else np.arange(views) % 2 == 1
    names = [name.format(i, ("left", "right")[int(second)]) for i, second in enumerate(changed)]
    return observe([shots[int(second)][i] for i, second in enumerate(changed)], names=names), changed


@pytest.mark.parametrize("in_order", [True, False])
def test_change_of_focus_and_crop_is_found_and_named(in_order):
    observations, changed = two_cameras(in_order)
    calibration = calibrate(observations)
    change = calibration.quality.camera_change
    assert change is not None
    assert change.in_order is in_order
    assert change.orientation == ""
    assert (change.is_second == changed).mean() >= 0.9
    assert change.magnification == pytest.approx(1.02, abs=0.005)
    assert change.shift == pytest.approx(10.0, abs=2.0)
    assert str(calibration.verdict) == "do not use"
    expected = "The camera changed at image 10.png" if in_order else "The images are of two cameras"
    assert calibration.reasons[0].startswith(expected)
    assert not any("--model axial" in reason or "rolling" in reason for reason in calibration.reasons)


@pytest.mark.parametrize("in_order", [True, False])
def test_two_cameras_are_named_by_the_patterns_of_their_files(in_order):
    observations, is_right = two_cameras(in_order, magnification=1.004, shift=3.0, name="{1}{0}.png")
    calibration = calibrate(observations, model=MODEL)
    change = calibration.quality.camera_change
    assert change is not None
    assert change.patterns == ("left*.png", "right*.png")
    np.testing.assert_array_equal(change.is_second, is_right)
    assert str(calibration.verdict) != "good"
    assert calibration.reasons[0].startswith("The images are of 2 cameras, 'left*.png', 'right*.png'")


def test_names_alone_do_not_make_two_cameras():
    views = observe_boards(lens(180), 180, np.random.default_rng(7), count=16)
    observations = observe(views, names=[f"{('left', 'right')[i % 2]}{i}.png" for i in range(16)])
    assert calibrate(observations, model=MODEL).quality.camera_change is None


@pytest.mark.parametrize("seed", range(4))
def test_one_camera_does_not_change(seed):
    views = observe_boards(lens(180), 180, np.random.default_rng(seed), count=16)
    assert calibrate(observe(views), model=MODEL).quality.camera_change is None


def test_few_views_tell_nothing():
    observations, _ = two_cameras(in_order=True, views=6)
    assert calibrate(observations, model=MODEL).quality.camera_change is None


@pytest.mark.parametrize(("directions", "orientation"), [((-1, 1), "mirrored"), ((-1, -1), "rotated by 180°")])
def test_images_that_were_mirrored_or_rotated_are_named(directions, orientation):
    model = lens(180)
    model = model.with_values({"cx": model.to_dict()["cx"] + 8})
    views = observe_boards(model, 180, np.random.default_rng(1), count=16)
    last = np.array(SIZE) - 1
    # The corners of a plain board are numbered in the image: those of a mirrored image start at another corner.
    board = (np.prod(directions), 1, 1)
    changed = [
        (points * board, np.where(np.array(directions) < 0, last - pixels, pixels)) if i % 2 else (points, pixels)
        for i, (points, pixels) in enumerate(views)
    ]
    calibration = calibrate(observe(changed, names=[f"{i}.png" for i in range(16)]), model=MODEL)
    assert calibration.quality.camera_change.orientation == orientation
    assert calibration.reasons[0].startswith(f"8 of 16 images are {orientation} (1.png, 3.png, 5.png, ...)")
    assert not any("blur" in reason for reason in calibration.reasons)
