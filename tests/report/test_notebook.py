"""HTML of results in notebooks."""

from pathlib import Path

import numpy as np

import omnisight as om
from notebook_html import assert_html
from omnisight.models import model_class
from omnisight.pipeline.inputs.photo import Photo
from omnisight.pipeline.two_views.stereo import RigCheck
from omnisight.targets.detections import ImageDetection
from omnisight.twoview.dense_stereo import DenseStereo
from omnisight.views.stitching.seam_plan import SeamQuality

LENS = model_class("kannala_brandt")(200.0, 199.0, 321.0, 242.0, 0.02, -0.01, 0.003, -0.001)
CAMERA = om.Camera(LENS, (640, 480), theta_max=1.2, covariance=1e-4 * np.eye(8))
BOARD = om.Checkerboard(9, 6, 0.03)
SMALL = om.perspective((64, 48), 70)


def detections(images=40):
    """Return detections of the board that fill most of the image."""
    found = []
    for k in range(images):
        pixels = 40.0 + k + 50.0 * BOARD.points[:, :2] / BOARD.square
        board = om.Detection(np.arange(len(pixels)), pixels, np.tile(np.eye(2), (len(pixels), 1, 1)), board=BOARD)
        found.append(ImageDetection(Path(f"{k}.jpg"), (640, 480), (board,)))
    return om.Detections(BOARD, [*found, ImageDetection(Path("none.jpg"), (640, 480))], hint="<try another board>")


def test_a_comparison_is_shown_with_its_maps():
    comparison = om.compare(CAMERA, om.Camera(LENS.with_params(LENS.params * 1.001), (640, 480), theta_max=1.1))
    page = assert_html(comparison, comparison.sentence, comparison.worst_place, f"{comparison.rms:.3g} px rms")
    assert "data:image/jpeg" in page


def test_the_field_of_view_of_a_camera_states_where_it_is_extrapolated():
    assert CAMERA.fov.horizontal > np.degrees(2 * 1.2) > CAMERA.fov.vertical
    assert_html(CAMERA, f"{CAMERA.fov.horizontal:.1f}° horizontal", "extrapolated beyond 137.5°")
    assert "extrapolated beyond" not in om.Camera(LENS, (640, 480))._repr_html_()


def test_detections_are_shown_with_their_corners():
    page = assert_html(detections(), "40 of 41 show the board", str(40 * len(BOARD.points)), "640 x 480 px")
    assert "<try" not in page
    assert "img" not in om.Detections(None)._repr_html_()


def test_an_evaluation_is_shown_with_its_corners():
    rng = np.random.default_rng(0)
    images = []
    for k in range(6):
        pose = om.Pose(om.look(yaw=10 * k - 25, pitch=5 * k), np.array([-0.12, -0.08, 0.25 + 0.02 * k]))
        pixels, valid = CAMERA.project(pose @ BOARD.points)
        assert valid.all()
        pixels = pixels + 0.1 * rng.standard_normal(pixels.shape)
        board = om.Detection(np.arange(len(pixels)), pixels, np.tile(np.eye(2), (len(pixels), 1, 1)), board=BOARD)
        images.append(ImageDetection(Path(f"{k}.jpg"), (640, 480), (board,)))
    (evaluation,) = om.evaluate(CAMERA, om.Detections(BOARD, images)).values()
    statistics = evaluation.statistics()
    assert_html(evaluation, "kannala_brandt", f"{statistics.rms:.3f} px", f"{statistics.corners}, ")


def stereo_result(reason=""):
    """Return distances of 2 m to 3 m."""
    image = np.full((48, 64, 3), 90, np.uint8)
    pose = om.Pose(translation=np.array([-0.1, 0.0, 0.0]))
    distance = np.linspace(2.0, 3.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    photos = Photo("left", image, SMALL, None), Photo("right", image, SMALL, None)
    dense, check = DenseStereo(distance, 0.1 * distance, distance), RigCheck((90, 80), 70, 60, row_px=0.25)
    return om.StereoResult(
        photos, pose, om.rectify((SMALL, SMALL), pose, 0.5), (image, image), dense, check, 1.0, reason
    )


def test_distances_are_shown_in_colours():
    page = assert_html(stereo_result(), "60 of 70", "0.25 px (median)", "median 2.5 m")
    assert "data:image/jpeg" in page
    assert "no texture" in stereo_result("no texture")._repr_html_()


def test_a_sphere_is_shown_with_its_seams():
    sphere, rig = om.sphere(2048), om.Rig((SMALL, SMALL), (om.Pose(), om.Pose(om.look(yaw=180))), ("front", "rear"))
    image = np.random.default_rng(0).integers(0, 60, (sphere.height, sphere.width, 3)).astype(np.uint8)
    seams = (SeamQuality(3.0, 1.0, 0.5, 0.04, 0.2, 12.0),)
    result = om.StitchResult(image, sphere, rig, np.eye(3), np.inf, seams, None, None, 0.98, 1, 2.0, 0.5)
    page = assert_html(result, "2048 x 1024 px", "front, rear", "98.0% of the sphere", "disparity 0.04°", "infinite")
    assert "data:image/jpeg" in page
