"""The rotation in the affine map of ocam cameras, when their rig is converted."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load_rig
from omnisight.pipeline.conversion.ocam_roll import with_upright_ocam


def test_the_rotation_in_ocam_cameras_becomes_part_of_the_poses(data):
    rig = load_rig(data("omnimvs_rig") / "config.yaml")
    rig = dataclasses.replace(rig, covariance=np.diag(np.arange(24.0)))
    upright = with_upright_ocam(rig)
    assert abs(rig.cameras[1].model.e) > 0.03
    for camera in upright.cameras:
        assert camera.model.d == camera.model.e
        assert abs(camera.model.e) < 1e-3
    points = np.random.default_rng(0).normal(0, 5, (200, 3))
    (before, valid), (after, again) = rig.project(points), upright.project(points)
    assert valid.any()
    np.testing.assert_array_equal(valid, again)
    np.testing.assert_allclose(after[valid], before[valid], atol=1e-8)
    assert np.trace(upright.covariance) == pytest.approx(np.trace(rig.covariance))


def test_a_rig_of_ocam_cameras_is_converted(data, tmp_path):
    options = om.ConvertOptions("kalibr", output=tmp_path / "k.yaml", max_error_px=3.0)
    result = om.convert_rig(data("omnimvs_rig") / "config.yaml", options)
    source, written = load_rig(data("omnimvs_rig") / "config.yaml"), load_rig(tmp_path / "k.yaml")
    assert all(conversion.max_px < 3 for conversion in result.conversions)
    directions = np.random.default_rng(0).normal(0, 1, (300, 3))
    turned = result.source.sensor_from_rig[0]  # the frame of the chain
    (before, valid), (after, _) = source.project(100 * directions), written.project(turned @ (100 * directions))
    seen = source.in_view(100 * directions) & valid
    assert seen.sum() > 300
    assert np.linalg.norm(after[seen] - before[seen], axis=1).max() < 3.0
