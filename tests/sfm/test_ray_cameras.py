"""Structure from motion of a non-central camera: its rays are used once the model is in metres."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry.pose import Pose
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.models.axial import Axial
from omnisight.sfm.georeference import scaled
from omnisight.sfm.mapping import map_images, refine_with_ray_cameras
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around, similarity_errors

LENS = KannalaBrandt(fx=200.0, fy=200.0, cx=400.0, cy=400.0, k1=0.0, k2=0.0, k3=0.0, k4=0.0)
# Its entrance pupil moves by 5 cm, and the points are 4 to 10 m away.
RAY_CAMERA = om.RayCamera(Axial(LENS, (0.09, 0.0)), (800, 800), theta_max=np.radians(95))
SIGMA_PX = 0.1


def keypoints_of(poses, points):
    """Return keypoints whose pixels are those of the non-central camera, and whose bearings are central."""
    central, found = RAY_CAMERA.central(float("inf"))[0], []
    for k, (pose, exact) in enumerate(zip(poses, observe(poses, points, 1e-9), strict=True)):
        exact = exact[exact.bearings[:, 2] > 0.1]
        point = (exact.bearings @ unit_rows(pose @ points).T).argmax(axis=1)
        pixels, valid = RAY_CAMERA.project((pose @ points)[point])
        assert valid.all()
        pixels = pixels + np.random.default_rng(k).normal(0, SIGMA_PX, pixels.shape)
        bearings, _, by_pixel, _ = central.model.unproject_with_jacobians(pixels)
        covariance = SIGMA_PX**2 * by_pixel @ by_pixel.transpose(0, 2, 1)
        found.append(replace(exact, pixels=pixels, bearings=bearings, covariance=covariance))
    return found


def unit_rows(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_exact_rays_remove_the_error_of_the_central_approximation():
    poses = [Pose(np.eye(3), pose.translation) for pose in circle_of_poses(8)]
    keypoints = keypoints_of(poses, points_around(1200))
    graph = match_pairs(keypoints, list(combinations(range(8), 2)), lambda *_: None)
    (found,) = map_images(keypoints, RigImages.of(keypoints), graph, lambda *_: None)
    distance = np.linalg.norm(poses[4].translation - poses[0].translation)
    central, _ = scaled(found, 0, 4, float(distance))
    exact = refine_with_ray_cameras(central, [RAY_CAMERA], keypoints, graph.edges, lambda *_: None)
    assert exact.frames.tolist() == list(range(8))
    of_central, of_exact = (similarity_errors(each.rig_from_world, poses) for each in (central, exact))
    assert np.median(of_central[0]) > 5 * np.median(of_exact[0])
    assert of_exact[0].max() < 0.002
    assert of_exact[1].max() < 0.02
    assert exact.noise.sigma < central.noise.sigma


def test_a_non_central_camera_needs_a_model_in_metres(tmp_path):
    om.save(RAY_CAMERA, tmp_path / "camera.json")
    for k in range(2):
        om.write_image(tmp_path / f"{k}.png", np.zeros((800, 800, 3), np.uint8))
    with pytest.raises(ValueError, match="the model must be in metres: specify --scale, --positions, or a rig"):
        om.reconstruct(tmp_path, tmp_path / "camera.json")


def test_a_non_central_camera_in_squares_is_refused(tmp_path):
    om.write_image(tmp_path / "1.png", np.zeros((800, 800, 3), np.uint8))
    with pytest.raises(ValueError, match="its lengths are in squares, not metres: calibrate it with --square"):
        om.reconstruct(tmp_path, replace(RAY_CAMERA, unit="squares"))
