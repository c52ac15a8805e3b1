"""COLMAP's mapper in place of averaging: on synthetic worlds, and with modules that fail in its place."""

import os
import time
from itertools import combinations

import numpy as np
import pytest

from omnisight.sfm.colmap_mapper import ColmapError, colmap_poses, map_images_with_colmap
from omnisight.sfm.mapping import map_images
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.test_mapping import ignore, rig_views
from sfm.worlds import circle_of_poses, observe, points_around, sensors_apart, similarity_errors

CIRCLE = circle_of_poses(6)


def view_graph(keypoints, images=None):
    images = RigImages.of(keypoints) if images is None else images
    pairs = list(combinations(range(len(keypoints)), 2))
    return images, match_pairs(keypoints, pairs, ignore, images.known_pose)


@pytest.fixture(scope="module")
def circle():
    return view_graph(observe(CIRCLE, points_around(150), 0.1))


@pytest.mark.peer
@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_cameras_on_a_circle_are_mapped_as_by_averaging(circle, mapper):
    pytest.importorskip("pycolmap")
    images, graph = circle
    counts = []
    (found,) = map_images_with_colmap(images, graph, counts.append, mapper, refines_sensors=False)
    assert found.frames.tolist() == list(range(6))
    assert max(counts) == 6
    positions, rotations = similarity_errors(found.rig_from_world, CIRCLE)
    assert positions.max() < 0.01
    assert rotations.max() < 0.1
    (averaged,) = map_images(observe(CIRCLE, points_around(150), 0.1), images, graph, ignore)
    np.testing.assert_allclose(found.rig_from_world[:, :, :3], averaged.rig_from_world[:, :, :3], atol=1e-4)
    assert found.noise.sigma == pytest.approx(averaged.noise.sigma, rel=1e-3)
    assert len(found.points) == len(averaged.points)
    assert not found.has_scale


@pytest.mark.peer
@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_a_rig_of_sensors_apart_is_mapped_in_metres(mapper):
    pytest.importorskip("pycolmap")
    frames, sensors = circle_of_poses(7), sensors_apart(2)
    keypoints, sensor, frame = rig_views(frames, sensors, points_around(200), field_deg=220.0)
    matrices = np.array([pose.matrix for pose in sensors])
    images, graph = view_graph(keypoints, RigImages.of(keypoints, sensor, 2).on_rig(frame, matrices, is_known=True))
    (found,) = map_images_with_colmap(images, graph, ignore, mapper, refines_sensors=False)
    assert found.frames.tolist() == list(range(7))
    assert found.has_scale
    np.testing.assert_allclose(found.rig_from_world, [pose.matrix for pose in frames], atol=5e-3)


@pytest.mark.peer
def test_frames_without_the_first_sensor_are_mapped():
    """The frame of the rig is not that of its first sensor, which took no image of three of the frames."""
    pytest.importorskip("pycolmap")
    sensors, frames = sensors_apart(3)[1:], circle_of_poses(7)
    keypoints, sensor, frame = rig_views(frames, sensors, points_around(200), field_deg=300.0)
    keep = np.flatnonzero((sensor != 0) | (frame % 2 == 0))
    matrices = np.array([pose.matrix for pose in sensors])
    chosen = [keypoints[i] for i in keep]
    images = RigImages.of(chosen, sensor[keep], 2).on_rig(frame[keep], matrices, is_known=True)
    images, graph = view_graph(chosen, images)
    (found,) = map_images_with_colmap(images, graph, ignore, refines_sensors=False)
    assert found.frames.tolist() == list(range(7))
    np.testing.assert_allclose(found.rig_from_world, [pose.matrix for pose in frames], atol=5e-3)


@pytest.mark.peer
def test_two_places_give_two_maps():
    pytest.importorskip("pycolmap")
    here = observe(circle_of_poses(6), points_around(150), 0.1)
    there = observe(circle_of_poses(5), points_around(150, seed=8), 0.1, seed=9)
    images, graph = view_graph([*here, *there])
    maps = map_images_with_colmap(images, graph, ignore, refines_sensors=False)
    assert [found.frames.tolist() for found in maps] == [[0, 1, 2, 3, 4, 5], [6, 7, 8, 9, 10]]
    assert all(len(found.points) > 100 for found in maps)


def test_without_edges_there_is_no_model(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    assert colmap_poses(RigImages.of(observe(CIRCLE[:1], points_around(5), 0.1)), [], ignore) == []


def test_a_missing_pycolmap_is_reported_with_the_remedy(circle, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ColmapError, match=r"not installed: pip install 'omnisight\[colmap\]'"):
        colmap_poses(circle[0], circle[1].edges, ignore)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise RuntimeError('no camera')", "COLMAP failed: RuntimeError: no camera; use the engine omnisight"),
        ("import os; os.kill(os.getpid(), 11)", r"COLMAP crashed \(SIGSEGV\): no reason stated"),
        (
            "import os, sys; sys.stderr.write('F20261125 02:00:00.123456 77 mapper.cc:12] Check failed: x > 0\\n"
            "*** Check failure stack trace: ***\\n    @ 0x7f\\n'); sys.stderr.flush(); os.abort()",
            r"COLMAP crashed \(SIGABRT\): Check failed: x > 0",
        ),
    ],
)
def test_a_failure_of_the_process_is_reported_with_its_reason(circle, tmp_path, monkeypatch, code, message):
    (tmp_path / "pycolmap.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ColmapError, match=message):
        colmap_poses(circle[0], circle[1].edges, ignore)


def test_an_interruption_ends_the_process(circle, tmp_path, monkeypatch):
    file = tmp_path / "process"
    (tmp_path / "pycolmap.py").write_text(
        f"import os, time, pathlib; pathlib.Path({str(file)!r}).write_text(str(os.getpid()))\n"
        "print(3, flush=True); time.sleep(60)"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def interrupt(count):
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        colmap_poses(circle[0], circle[1].edges, interrupt)
    assert time.monotonic() - start < 30
    with pytest.raises(ProcessLookupError):
        os.kill(int(file.read_text()), 0)
