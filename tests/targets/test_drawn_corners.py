"""Images onto which OpenCV drew its corners are recognized, in PNG and JPEG; photographs are not taken for them."""

import cv2
import pytest

from omnisight.targets.detection import detect_boards

pytestmark = pytest.mark.slow
PATTERN = (9, 6)


@pytest.fixture
def photographs(data):
    return [data("everyday") / "opencv_left" / f"left{number:02}.jpg" for number in (1, 2, 6, 7)]


@pytest.fixture
def drawn(photographs, tmp_path, extension):
    paths = []
    for source in photographs:
        image = cv2.imread(str(source))
        found, corners = cv2.findChessboardCorners(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), PATTERN)
        cv2.drawChessboardCorners(image, PATTERN, corners, found)
        paths.append(tmp_path / f"{source.stem}{extension}")
        cv2.imwrite(str(paths[-1]), image)
    return paths


@pytest.mark.parametrize("extension", [".png", ".jpg"])
def test_images_with_drawn_corners_are_left_out_beside_others(photographs, drawn):
    found = detect_boards([*photographs, *drawn], cache=False)
    assert [bool(image.boards) for image in found.images] == [True] * 4 + [False] * 4
    assert all("drawn" not in image.note for image in found.images[:4])
    assert {image.note for image in found.images[4:]} == {"detected corners were drawn onto the image: left out"}
    assert any(note.startswith("4 images have detected corners drawn onto them") for note in found.notes)


@pytest.mark.parametrize("extension", [".png"])
def test_a_set_that_only_has_such_images_is_used_with_a_remark(drawn):
    found = detect_boards(drawn, cache=False)
    assert all(image.boards for image in found.images)
    assert all("which hides the true ones" in image.note for image in found.images)
    assert any("use the original images" in note for note in found.notes)


def test_drawn_corners_of_a_public_folder_are_recognized(data):
    found = detect_boards(sorted((data("everyday") / "own_results").glob("*_r.jpg")), cache=False)
    assert sum("corners were drawn" in image.note for image in found.images) == 10
