"""Unusual corner files: shuffled, repeated, missing or exchanged corners are used, or left out with a note."""

import re

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import BOARD, bearing_error, lens, observe_boards
from omnisight.corners import read_corners
from omnisight.formats import FormatError
from omnisight.images import write_image
from omnisight.targets import Checkerboard

SIZE = (960, 962)
TRUTH = lens(180)


@pytest.fixture
def views():
    """Return points and pixels of eight images, for a test to change."""
    simulated = observe_boards(TRUTH, 180, np.random.default_rng(5), count=8, noise=0.02)
    return [[points.copy(), pixels.copy()] for points, pixels in simulated]


@pytest.fixture
def read(tmp_path):
    """Return a function that writes views to a file and reads them by `read_corners`."""

    def read_views(views, size=SIZE, **options):
        longest = max(len(points) for points, _ in views)
        points, pixels = np.zeros((len(views), longest, 3)), np.full((len(views), longest, 2), np.nan)
        for k, (x, p) in enumerate(views):
            points[k, : len(x)], points[k, len(x) :], pixels[k, : len(p)] = x, x[-1], p
        extra = {} if size is None else {"image_size": size}
        np.savez(tmp_path / "v.npz", imgpoints=pixels, objpoints=points, **extra)
        return read_corners([tmp_path / "v.npz"], **options)

    return read_views


def calibration_error(detections):
    """Calibrate, and return the angle between the estimated and the true camera, degrees."""
    camera = calibrate(detections, model="equisolid", flat=True).camera
    return bearing_error(camera, TRUTH, np.radians(80))


def test_complete_views_from_a_file_calibrate_like_arrays(views, read):
    detections = read(views)
    assert (len(detections.found), detections.notes) == (8, ())
    from_file = calibrate(detections, model="equisolid", flat=True)
    from_arrays = calibrate(observe(views, SIZE), model="equisolid", flat=True)
    assert from_file.rms == pytest.approx(from_arrays.rms, abs=1e-6)
    np.testing.assert_allclose(from_file.camera.model.params, from_arrays.camera.model.params, atol=1e-3)


def shuffled(views, rng):
    for view in views:
        order = rng.permutation(len(view[0]))
        view[:] = view[0][order], view[1][order]


def repeated(views, rng):
    for view in views:
        rows = np.concatenate([np.arange(54), rng.integers(0, 54, 20)])
        view[:] = view[0][rows], view[1][rows]


def missing(views, rng):
    for view in views:
        view[1][rng.random(54) < 0.2] = np.nan


def marked(mark):
    def change(views, rng):
        for view in views:
            view[1][rng.random(54) < 0.1] = mark

    return change


def few(views, rng):
    for view in views[:2]:
        rows = rng.permutation(54)[:4]
        view[:] = view[0][rows], view[1][rows]


def in_line(views, rng):
    views[0][:] = views[0][0][:9], views[0][1][:9]


def exchanged(views, rng):
    views[3][1] = views[3][1][:, ::-1]


def upright(views, rng):
    for view in views:
        view[0] = view[0][:, [0, 2, 1]]


def far_away(views, rng):
    for view in views:
        view[0] = view[0] + [4e5, 5e6, 0]


def in_microns(views, rng):
    for view in views:
        view[0] = 3e4 * view[0]


@pytest.mark.parametrize(
    ("change", "kept", "message"),
    [
        (shuffled, 8, ""),
        (repeated, 8, "duplicate corners, left out: 160"),
        (missing, 8, r"corners that are not finite, or at \(0, 0\), left out: \d+$"),
        (marked(0), 8, r"corners that are not finite, or at \(0, 0\), left out: \d+$"),
        (marked(-1), 8, r"corners outside the image, left out: \d+$"),
        (few, 6, ""),
        (in_line, 7, ""),
        (exchanged, 7, r"show the board from behind: 1 of 8 \(v-4\); are x and y, .* exchanged\? Left out"),
        (upright, 8, "the points lie on a plane other than z = 0"),
        (far_away, 8, "the points lie far from their origin: poses are those of their centroid"),
        (in_microns, 8, ""),
    ],
)
def test_unusual_corners_are_used_or_left_out_with_note(change, kept, message, views, read):
    change(views, np.random.default_rng(0))
    detections = read(views)
    assert len(detections.found) == kept
    if message:
        (note,) = detections.notes
        assert re.search(message, note)
    # A pixel is 0.17 degrees.
    assert calibration_error(detections) < 0.05


def test_left_out_image_has_reason(views, read):
    few(views, np.random.default_rng(0))
    in_line(views[4:], None)
    exchanged(views, None)
    notes = [image.note for image in read(views).images]
    assert notes[0] == "4 corners, at least 6 are needed: left out"
    assert notes[4] == "all corners on one line: left out"
    assert notes[3] == "shows the board from behind: left out"
    assert notes[5] == ""


def test_pixels_counted_from_one_shift_only_the_principal_point(views, read):
    before = calibrate(read(views), model="equisolid", flat=True)
    for view in views:
        view[1] += 1
    after = calibrate(read(views), model="equisolid", flat=True)
    assert after.rms == pytest.approx(before.rms, abs=1e-6)
    moved = after.camera.model.params - before.camera.model.params
    np.testing.assert_allclose(moved, [0, 0, 1, 1], atol=1e-3)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (None, r"the image size is in neither .* specify --image-size, such as 1280x800 \(corners reach \d+"),
        ((480, 480), r"\d+% of them outside images of 480x480: specify the --image-size of the images that"),
    ],
)
def test_missing_or_wrong_size_is_refused(size, message, views, read):
    with pytest.raises(FormatError, match=message):
        read(views, size=size)


def test_exchanged_width_and_height_are_detected(views, read):
    for view in views:
        view[1] *= (0.5, 1.0)
    with pytest.raises(FormatError, match=r"the size is height x width \(specify --image-size 480x962\), or x and y"):
        read(views, size=(962, 480))


def test_size_is_read_from_images_next_to_the_file(views, tmp_path):
    names = [f"{k}.png" for k in range(8)]
    for name in names:
        write_image(tmp_path / name, np.zeros((4, 6), np.uint8) if name == "7.png" else np.zeros(SIZE[::-1], np.uint8))
    np.savez(tmp_path / "v.npz", corners=[p for _, p in views], pattern=(9, 6), files=[f"/old/{n}" for n in names])
    detections = read_corners([tmp_path / "v.npz"])
    assert detections.size == SIZE
    assert len(detections.found) == 7
    assert "images have 2 sizes" in detections.notes[0]
    assert detections.images[7].note.startswith("6x4 where others have 960x962")
    assert detections.images[0].path == tmp_path / "0.png"


def test_image_name_cannot_leave_the_folder(views, tmp_path):
    (tmp_path / "in").mkdir()
    write_image(tmp_path / "a.png", np.zeros(SIZE[::-1], np.uint8))
    names = ["../a.png", "/etc/hosts", "x\x1b[2Jy", *"abcde"]
    np.savez(tmp_path / "in" / "v.npz", corners=[p for _, p in views], pattern=(9, 6), files=names)
    detections = read_corners([tmp_path / "in" / "v.npz"], size=SIZE)
    assert [p.path.parent for p in detections.images] == [tmp_path / "in"] * 8
    assert detections.images[2].path.name == "x?[2Jy"


def test_several_files_of_one_camera_are_merged(views, tmp_path):
    for k in range(2):
        pixels = [p for _, p in views[4 * k : 4 * k + 4]]
        np.savez(tmp_path / f"part{k}.npz", corners=pixels, pattern=(9, 6), image_size=SIZE)
    detections = read_corners([tmp_path / "part0.npz", tmp_path / "part1.npz"])
    assert [p.path.name for p in detections.images][3:5] == ["part0-4", "part1-1"]
    assert len(detections.board.points) == len(Checkerboard(9, 6).points) == len(BOARD.points)
