"""The scenes: free space for cameras, features that can be matched, and parallax."""

import cv2
import numpy as np
import pytest
from render_cameras import GRAY, still_life

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.images import to_gray8
from omnisight.simulation import (
    Renderer,
    Scene,
    box,
    cylinder,
    dense_correspondences,
    ellipsoid,
    render,
    roof,
    scene_named,
    scene_names,
)
from omnisight.simulation.preset_motion import PRESETS, preset_trajectory

NEXT = om.Pose(exp((0.02, 0.12, 0.03)), np.array((0.15, 0.03, 0.12)))


def test_scenes_are_discovered_by_their_files():
    assert {"boards", "lines", "room", "rooms", "street", "town"} <= set(scene_names())
    with pytest.raises(ValueError, match="unknown scene 'moon'; there are: boards, lines"):
        scene_named("moon")


@pytest.mark.parametrize("name", scene_names())
def test_preset_trajectories_are_free_of_collisions(name):
    """Rays in all directions from the camera positions hit nothing near and something far."""
    scene = scene_named(name)
    rng = np.random.default_rng(0)
    bearings = rng.normal(size=(200, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    for motion in PRESETS:
        for pose in preset_trajectory(motion, scene.free, route=scene.route).poses[::60]:
            assert scene.solids_at(pose.translation) == [""]
            met = scene.cast(np.tile(pose.translation, (200, 1)), bearings)
            assert np.nanmin(met.distances) > 0.15
            assert (met.instances > 0).mean() > 0.4


def route_of(name):
    scene = scene_named(name)
    return np.array([pose.translation for pose in preset_trajectory("loop", scene.free, route=scene.route).poses])


def test_town_has_a_loop_of_400_m_on_its_sloping_roads():
    scene, places = scene_named("town"), route_of("town")
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).sum() > 400
    below = scene.cast(places[::40], np.array((0.0, 1.0, 0.0)))
    assert np.ptp(places[:, 1]) > 2
    # The camera of a car, 1.6 m above roads and crossings. The spline rounds the beginnings of the slopes.
    np.testing.assert_allclose(below.distances, 1.6, atol=0.1)
    on = {scene.names[i - 1].split()[0] for i in below.instances}
    assert on == {"street", "crossing"}


def test_house_fronts_of_the_town_are_repeated():
    walls = [solid for solid in scene_named("town").solids if solid.name.startswith("house") and solid.shape == "box"]
    fronts = [solid.textures[4] for solid in walls if solid.textures[4] is not solid.textures[0]]
    assert len(fronts) > 100
    assert len(set(fronts)) <= 8


def test_loop_of_the_flat_enters_all_rooms():
    """The rooms are in a grid of three columns on both sides of the corridor."""
    places = route_of("rooms")
    inside = places[np.abs(places[:, 2]) > 1.5]
    rooms = {(round(float(x) / 4.2), z > 0) for x, _, z in inside}
    assert rooms == {(column, side) for column in (-1, 0, 1) for side in (False, True)}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "side", "least"), [("room", 1000, 2000), ("street", 600, 1000)])
def test_feature_matches_agree_with_the_ground_truth(name, side, least):
    """SIFT finds thousands of features per megapixel, and at least 80 % of the matches are correct."""
    scene, camera = scene_named(name), om.fisheye(side, 180)
    views = [Renderer(camera, pose, scene, samples=1) for pose in (om.Pose(), NEXT)]
    sift = cv2.SIFT_create()
    (first, a), (second, b) = (sift.detectAndCompute(to_gray8(view().image), None) for view in views)
    assert min(len(first), len(second)) >= least
    pairs = cv2.BFMatcher().knnMatch(a, b, k=2)
    good = [m for m, n in pairs if m.distance < 0.75 * n.distance]
    assert len(good) > 0.4 * least
    here = np.array([first[m.queryIdx].pt for m in good])
    there = np.array([second[m.trainIdx].pt for m in good])
    rays = camera.rays(here)
    met = scene.cast(rays.origins, rays.bearings)
    points = np.where(
        np.isnan(met.distances)[:, None], 1e6 * rays.bearings, met.distances[:, None] * rays.bearings
    )  # the sky is far away
    expected, _ = camera.project(NEXT.inverse() @ points)
    assert np.mean(np.linalg.norm(expected - there, axis=1) < 2) > 0.8


def test_motion_through_the_room_causes_parallax():
    """Near points move more; neither a plane nor a rotation explains the motion."""
    camera = om.fisheye(200, 170)
    first, second = (Renderer(camera, pose, scene_named("room")) for pose in (om.Pose(), NEXT))
    truth, found = first.truth(), dense_correspondences(first, second)
    bearings, _ = camera.unproject(_grid(camera))
    turned, _ = camera.project(bearings @ NEXT.rotation)
    moved = np.linalg.norm(found - turned, axis=-1)
    near, far = truth.depth < 1.6, truth.depth > 2.6
    assert np.nanmedian(moved[near]) > 1.5 * np.nanmedian(moved[far])


def _grid(camera):
    return np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(float)


def test_seed_changes_the_scene():
    first, second = (scene_named("lines", seed) for seed in (0, 1))
    assert first.names == second.names
    images = [render(om.fisheye(100, 180), scene=scene, noise=0).image for scene in (first, second)]
    assert (images[0] != images[1]).mean() > 0.05
    assert scene_named("lines", 1) is second


def test_wires_are_straight():
    """The points of a wire are collinear, although its image is curved."""
    scene = scene_named("lines")
    truth = Renderer(om.fisheye(500, 190), om.Pose(), scene).truth()
    seen = 0
    for name in scene.names:
        points = truth.points[truth.instances == scene.instance(name)]
        if not name.startswith("wire") or len(points) < 60:
            continue
        spread = np.linalg.svd(points - points.mean(0))[1] / np.sqrt(len(points))
        assert spread[1] < 0.009  # the wire's own radius
        assert spread[0] > 20 * spread[1]
        seen += 1
    assert seen > 10
    with pytest.raises(ValueError, match="no object 'rope' in the scene"):
        scene.instance("rope")


def test_solids_at_returns_the_solid_that_contains_a_point():
    """As rays tell it: from inside a closed solid every ray meets it, from the far side of its wall."""
    turned = om.Pose(exp((0.3, 0.5, -0.2)), np.array((0.2, 0.1, -0.3)))
    rng = np.random.default_rng(2)
    points, bearings = rng.uniform(-2, 2, (300, 3)), rng.normal(size=(12, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    for solid in (
        ellipsoid((0, 0, 0), (1.2, 0.8, 1.5), GRAY, "solid"),
        box((-1, -0.5, -1.4), (1, 0.9, 1.2), GRAY, "solid"),
        cylinder((-0.5, -1, 0), (0.4, 1.2, 0.3), 0.9, GRAY, "solid"),
        roof((-1.5, -1, -1), (1.5, 1, 1), GRAY, "solid"),
    ):
        scene = Scene((solid.moved(turned),))
        met = scene.cast(points[:, None], bearings)
        # The two ends of a line through a point inside a convex solid both meet it.
        inside = ((met.instances > 0) & (scene.cast(points[:, None], -bearings).instances > 0)).all(1)
        assert 10 < inside.sum() < 290
        assert scene.solids_at(points) == ["solid" if i else "" for i in inside]
    shell = Scene((box((-1, -1, -1), (1, 1, 1), GRAY, "hall", inside=True), still_life().solids[0]))
    assert shell.solids_at([(0, 0, 0), (0, 0, 1.5)]) == ["", "hall"]
