"""The scale of one frame of a rig, which the distances of its cameras determine."""

import re

import numpy as np

import omnisight as om
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.example_rigs import ladybug

WORLD_FROM_RIG = om.Pose(om.look(20.0), np.array([0.3, 0.0, -0.2]))


def test_the_scale_of_one_frame_of_a_rig_has_the_uncertainty_of_its_points(run, tmp_path):
    rig, scene = ladybug(480, 0.15), scene_named("room")
    for name, camera, sensor_from_rig in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        (tmp_path / "images" / name).mkdir(parents=True)
        image = Renderer(camera, WORLD_FROM_RIG @ sensor_from_rig.inverse(), scene, samples=1)().image
        om.write_image(tmp_path / "images" / name / "0.png", image)
    om.save(rig, tmp_path / "rig.json")
    arguments = tmp_path / "images", "--rig", tmp_path / "rig.json", "-o", tmp_path / "model"
    status, out, _ = run("reconstruct", *arguments)
    assert status == 0
    assert re.search(r"scale       metres, ± \d\.\d\d% \(1σ, median of the distances of points\)", out)
    model = om.read_reconstruction(tmp_path / "model")
    assert len(model.rig_from_world) == 1
    offsets = model.rig_from_world[0] @ model.points.position
    distances = np.linalg.norm(offsets, axis=1)
    bearings = (offsets / distances[:, None]) @ WORLD_FROM_RIG.rotation.T
    true = scene.cast(np.tile(WORLD_FROM_RIG.translation, (len(bearings), 1)), bearings).distances
    error = float(np.median(np.abs(distances / true - 1)))
    assert error < 0.6745 * model.scale_sigma < 5 * error  # the median of a normal distribution
