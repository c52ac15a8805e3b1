"""Parked cars that change between visits, and moving objects."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from render_cameras import GRAY

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import Renderer, Scene, box, cylinder, ellipsoid, rectangle, scene_named
from omnisight.simulation.preset_motion import preset_trajectory
from omnisight.simulation.texture import Texture
from omnisight.simulation.traffic import STRIDE_S, Actor, Limb, Parking, ParkingSpot
from omnisight.simulation.trajectory import Trajectory

RED = Texture.plain((200, 30, 30))


def yard(count=40):
    """Return a yard with boxes, a ball that moves to the right in 4 s, and a swinging pendulum."""
    rng = np.random.default_rng(0)
    solids = [rectangle((-20, 1.6, 20), (40, 0, 0), (0, 0, -40), GRAY, "ground")]
    for i in range(count):
        x, z = rng.uniform(-8, 8), rng.uniform(6, 16)
        solids.append(box((x, rng.uniform(-1, 1), z), (x + 0.5, 1.6, z + 0.5), GRAY, f"box {i}"))
    way = Trajectory(np.array((0.0, 4.0)), tuple(om.Pose(translation=np.array((x, 1.0, 4.0))) for x in (-2.0, 2.0)))
    ball = Actor("ball", (ellipsoid((0, 0, 0), 0.4, RED, "x"),), way, 0.0)
    rod = Limb(cylinder((0, 0, 0), (0, 1.5, 0), 0.1, RED, "x"), (1.0, -1.5, 0.0), 0.5)
    still = Trajectory(np.array((0.0, 1.0)), (om.Pose(translation=np.array((0.0, 0.0, 5.0))),) * 2)
    actors = (ball, Actor("pendulum", (), still, 0.0, (rod,)))
    return Scene(
        tuple(solids), sun=((0.3, -0.8, -0.3), 0.8), ambient=0.5, spacing=0.5, traffic=lambda: actors
    ).with_traffic()


@pytest.mark.parametrize("time", [0.0, 1.3, 3.9, 5.0])
def test_moving_objects_are_where_a_newly_built_scene_has_them(time):
    scene = yard()
    moved = [solid for actor in scene.actors for solid in actor.at(time)]
    expected = replace(scene, solids=(*scene.solids, *moved), actors=(), _lights={})
    rng = np.random.default_rng(1)
    bearings = rng.normal(size=(5000, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    found, known = (s.cast(np.zeros(3), bearings) for s in (scene.at(time), expected))
    assert len(set(known.instances.tolist())) > 20
    for a, b in zip(found, known, strict=True):
        np.testing.assert_array_equal(a, b)


def test_moving_objects_have_light_textures_and_shadows():
    scene, camera = yard(0), om.perspective((96, 64), 90)
    moments = [Renderer(camera, om.Pose(), scene.at(time), vignette=0, samples=1) for time in (0.5, 3.5)]
    lights, moving = [], []
    for renderer in moments:
        lights.append(renderer.light())
        moving.append(renderer.truth().instances == scene.instance("ball"))
    for light, mask in zip(lights, moving, strict=True):
        assert mask.sum() > 20
        red, green, _ = light[mask].mean(0)
        assert red > 4 * green > 0
    # A shadow on the ground where the ball is not.
    changed = np.abs(lights[0] - lights[1]).max(-1) > 0.05
    assert changed[~moving[0] & ~moving[1]].sum() > 10
    np.testing.assert_array_equal(scene.at(0.5).names, scene.names)


def test_a_scene_without_moving_objects_is_the_same_at_all_times():
    scene = Scene(())
    assert scene.at(3.0) is scene
    with pytest.raises(ValueError, match="--traffic applies only to scenes with moving objects"):
        scene.with_traffic()
    with pytest.raises(ValueError, match="--visit 2 applies only to scenes with parked cars"):
        scene.with_visit(2)


def test_motions_repeat_and_limbs_swing():
    ball, pendulum = yard(0).actors
    np.testing.assert_allclose(ball.pose(1.0).translation, ball.pose(9.0).translation)
    assert ball.pose(1.0).translation[0] == pytest.approx(-1)
    ends = [pendulum.at(share * STRIDE_S)[0].world_from_local @ (0, 1, 0, 1) for share in (0, 0.25, 0.75, 1)]
    np.testing.assert_allclose(ends[0], ends[3], atol=1e-12)
    assert ends[1][2] - ends[2][2] == pytest.approx(2 * 1.5 * np.sin(0.5))


def test_visits_change_cars_and_nothing_else():
    spots = tuple(
        ParkingSpot(*(om.Pose(exp((0, 1.0, 0)), np.array((10.0 * i + s, 0, 0))) for s in (0, 3)), f"car {i}")
        for i in range(100)
    )
    designs = tuple((box((-1, -1, -2), (1, 0, 2), Texture.plain((60 * k, 0, 0)), "car"),) for k in range(4))
    parking = Parking(designs, spots)
    house = box((0, 0, 50), (1, 1, 51), GRAY, "house")
    scene = Scene((house, *parking.solids(0, 0)), parking=parking)
    again = scene.with_visit(1)
    assert scene.with_visit(0) is scene
    assert house in again.solids
    cars = [{solid.name: solid for solid in s.solids if solid is not house} for s in (scene, again)]
    for visit in cars:
        assert len(visit) / len(spots) == pytest.approx(0.6, abs=0.15)
    both = set(cars[0]) & set(cars[1])
    assert 20 < len(both) < 60
    same = sum(cars[0][name].textures == cars[1][name].textures for name in both)
    assert same < 0.6 * len(both)
    for name, solid in cars[0].items():
        assert 0 <= solid.world_from_local[0, 3] - 10 * int(name[4:]) + np.cos(1) + 2 * np.sin(1) <= 3
    names = [[solid.name for solid in parking.solids(0, 1)] for _ in range(2)]
    assert names[0] == names[1]


def test_town_traffic_stays_on_the_ground_and_leaves_the_route_free():
    town = scene_named("town")
    actors, route = town.traffic(), preset_trajectory("loop", town.free, route=town.route)
    kinds = Counter(actor.name.rsplit(" ", 1)[0] for actor in actors)
    assert kinds["driving car"] >= 4
    assert kinds["person"] >= 10
    times = np.arange(0, route.times[-1], 1.0)
    camera = np.array([route.at(time).translation for time in times])
    for actor in actors:
        places = np.array([actor.pose(time).translation for time in times])
        assert np.linalg.norm((places - camera)[:, ::2], axis=1).min() > 2.5
        below = town.cast(places - (0, 1, 0), np.array((0.0, 1.0, 0.0)))
        np.testing.assert_allclose(below.distances, 1, atol=0.1)
        assert not any(town.solids_at(places - (0, 0.8, 0)))


def test_town_visits_keep_the_houses():
    town = scene_named("town")
    again = town.with_visit(3)
    for prefix, kept in (("house", True), ("tree", True), ("car", False)):
        first, second = ([s for s in t.solids if s.name.startswith(prefix)] for t in (town, again))
        assert len(first) > 50
        assert (first == second) == kept
