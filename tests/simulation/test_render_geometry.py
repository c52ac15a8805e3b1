"""Depth, normals and instances of the renderer, compared with closed forms for all camera types."""

import numpy as np
import pytest
from render_cameras import CAMERAS, GRAY, POSE, AxialShift, SideBySidePinholes, pixels_of, still_life

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import (
    Renderer,
    Scene,
    box,
    cylinder,
    dense_correspondences,
    ellipsoid,
    rectangle,
    roof,
    scene_named,
)


def world_rays(any_camera, pose):
    rays = any_camera.rays(pixels_of(any_camera))
    return pose @ rays.origins, rays.bearings @ pose.rotation.T, rays.valid


def nearest_root(a, b, c):
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        near, far = (-b - root) / a, (-b + root) / a
    return np.where(near > 1e-9, near, np.where(far > 1e-9, far, np.inf))


# -- geometry ----------------------------------------------------------------------------------------------------


def test_depth_is_exact(any_camera):
    """Against the closed forms of plane, ellipsoid and box: 1e-9 m over the image, including occlusions."""
    pose, scene = POSE, still_life()
    o, d, valid = world_rays(any_camera, pose)
    wall = (5 - o[..., 2]) / d[..., 2]
    hit = o + wall[..., None] * d
    wall = np.where((wall > 0) & (np.abs(hit[..., 0]) <= 6) & (np.abs(hit[..., 1]) <= 6), wall, np.inf)
    radii, centre = np.array((0.6, 0.5, 0.7)), np.array((0.2, 0.1, 3.0))
    p, q = (o - centre) / radii, d / radii
    sphere = nearest_root((q * q).sum(-1), (p * q).sum(-1), (p * p).sum(-1) - 1)
    low, high = np.array((-2.2, -0.8, 2.5)), np.array((-1.2, 0.9, 3.4))
    with np.errstate(divide="ignore"):
        a, b = (low - o) / d, (high - o) / d
    enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    cube = np.where((enter <= leave) & (enter > 0), enter, np.inf)
    found = Renderer(any_camera, pose, scene).truth()
    others = found.instances != scene.instance("cylinder")
    expected = np.min([wall, sphere, cube], axis=0)
    expected[~np.isfinite(expected) | ~valid] = np.nan
    np.testing.assert_allclose(found.depth[others], expected[others], rtol=0, atol=1e-9)
    which = np.argmin([wall, sphere, cube], axis=0)
    names = np.array([scene.instance(name) for name in ("wall", "ellipsoid", "box")])
    seen = others & np.isfinite(expected)
    assert (found.instances[seen] == names[which][seen]).all()
    assert (found.instances[others & ~np.isfinite(expected)] == 0).all()
    assert len(np.unique(found.instances[seen])) == 3


def test_cylinder_is_exact(any_camera):
    """Hits are at the radius from the axis or on a cap; other rays pass."""
    scene = still_life()
    found = Renderer(any_camera, POSE, scene).truth()
    start, end = np.array((1.3, -1.0, 3.1)), np.array((1.8, 1.0, 2.7))
    axis = (end - start) / np.linalg.norm(end - start)
    points = found.points[found.instances == scene.instance("cylinder")]
    along = (points - start) @ axis
    away = np.linalg.norm(points - start - along[:, None] * axis, axis=1)
    off = np.where((np.abs(along) < 1e-9) | (np.abs(along - np.linalg.norm(end - start)) < 1e-9), 0, away - 0.3)
    assert len(points) > 20
    assert np.abs(off).max() < 1e-9
    assert (away < 0.3 + 1e-9).all()


def test_roof_has_its_ridge_in_the_middle():
    scene = Scene((roof((0, 0, 0), (4, 1, 2), GRAY, "roof"),))
    z = np.array((0.0, 0.25, 0.5, 1.0, 1.5, 2.0))
    origins = np.column_stack([np.full(6, 2.0), np.full(6, -1.0), z])
    met = scene.cast(origins, np.tile((0.0, 1.0, 0.0), (6, 1)))
    np.testing.assert_allclose(met.distances, 1 + np.abs(1 - z), atol=1e-12)
    inside = scene.cast((2.0, 0.8, 1.0), (1.0, 0.0, 0.0))
    assert inside.distances == pytest.approx(2.0)


def test_normals_are_unit_vectors_towards_the_camera(any_camera):
    found = Renderer(any_camera, POSE, still_life()).truth()
    seen = found.instances > 0
    assert np.isnan(found.normals[~seen]).all()
    assert np.abs(np.linalg.norm(found.normals[seen], axis=-1) - 1).max() < 1e-12
    facing = (found.normals * any_camera.rays(pixels_of(any_camera)).bearings).sum(-1)[seen]
    assert facing.max() <= 0
    wall = found.instances == 1
    np.testing.assert_allclose(found.normals[wall], np.tile(-POSE.rotation.T[:, 2], (wall.sum(), 1)), atol=1e-12)


def test_normals_match_the_surface():
    """Compared with differences of neighbouring points on the ellipsoid."""
    camera = om.perspective((200, 200), 30)
    scene = Scene((ellipsoid((0, 0, 3), (0.5, 0.4, 0.6), GRAY, "ellipsoid"),))
    found = Renderer(camera, om.Pose(), scene).truth()
    middle = (slice(80, 120), slice(80, 120))
    across = np.gradient(found.points, axis=1)[middle]
    down = np.gradient(found.points, axis=0)[middle]
    normals = np.cross(down, across)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    assert np.abs(normals - found.normals[middle]).max() < 2e-4


def test_nearest_of_many_solids_is_hit():
    """The bounding-box tree agrees with a test of every solid."""
    rng = np.random.default_rng(1)
    solids = []
    for i in range(60):
        at, name = rng.uniform(-3, 3, 3), f"{i}"
        kind = i % 3
        solids.append(
            ellipsoid(at, rng.uniform(0.1, 0.4, 3), GRAY, name)
            if kind == 0
            else box((-0.2, -0.3, -0.1), (0.2, 0.3, 0.1), GRAY, name).moved(om.Pose(exp(rng.normal(size=3)), at))
            if kind == 1
            else cylinder(at, at + rng.normal(0, 0.4, 3), 0.1, GRAY, name)
        )
    solids.append(box((-4, -4, -4), (4, 4, 4), GRAY, "shell", inside=True))
    bearings = rng.normal(size=(800, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    origins = rng.uniform(-1, 1, (800, 3))
    together = Scene(tuple(solids)).cast(origins, bearings)
    alone = np.array([Scene((solid,)).cast(origins, bearings).distances for solid in solids])
    np.testing.assert_array_equal(together.distances, np.nanmin(alone, axis=0))
    np.testing.assert_array_equal(together.instances, np.nanargmin(alone, axis=0) + 1)


# -- non-central cameras, dense correspondences ----------------------------------------------------------------


def test_depth_matches_the_parallax_of_two_viewpoints():
    any_camera = SideBySidePinholes()
    scene = Scene((ellipsoid((0, 0, 2), 0.05, GRAY, "near"), ellipsoid((0, 0.5, 8), 0.2, GRAY, "far")))
    instances = Renderer(any_camera, om.Pose(), scene).truth().instances
    focal, half = any_camera.half.model.fx, any_camera.size[0] // 2
    for name, distance in (("near", 2), ("far", 8)):
        here = instances == scene.instance(name)
        columns = np.arange(half)
        left, right = (np.average(columns, weights=part.sum(0)) for part in (here[:, :half], here[:, half:]))
        assert left - right == pytest.approx(focal * any_camera.base / distance, abs=0.4)


def test_pupil_shift_changes_the_depth():
    lens = om.fisheye(121, 170)
    wall = Scene((rectangle((-90, -90, 2), (180, 0, 0), (0, 180, 0), GRAY, "wall"),))
    depth = Renderer(AxialShift(lens, 0.2), om.Pose(), wall).truth().depth
    bearings, valid = lens.unproject(pixels_of(lens))
    z = bearings[..., 2]
    valid &= z > 0.2
    np.testing.assert_allclose(depth[valid], ((2 - 0.2 * (1 - z)) / z)[valid], atol=1e-9, rtol=1e-12)


@pytest.mark.parametrize("name", ["pinhole", "fisheye", "axial"])
def test_dense_correspondences_are_the_same_scene_points(name):
    """They agree with projection, and exactly the occluded points are missing."""
    any_camera, scene = CAMERAS[name], still_life()
    first, second = (Renderer(any_camera, pose, scene) for pose in (om.Pose(), POSE))
    found = dense_correspondences(first, second)
    truth = first.truth()
    expected, valid = any_camera.project(POSE.inverse() @ truth.points)
    seen = ~np.isnan(found[..., 0])
    np.testing.assert_allclose(found[seen], expected[seen], atol=1e-9)
    # Traced back along the rays of the second image: the same points, or something nearer if occluded.
    with np.errstate(invalid="ignore"):
        inside = valid & (expected > -0.5).all(-1) & (expected < np.array(any_camera.size) - 0.5).all(-1)
    assert not (seen & ~inside).any()
    rays = any_camera.rays(expected[inside])
    origins = POSE @ rays.origins
    met = scene.cast(origins, rays.bearings @ POSE.rotation.T).distances
    distance = np.linalg.norm(truth.points[inside] - origins, axis=-1)
    shown = seen[inside]
    assert shown.mean() > 0.5
    assert (~shown).any()
    # Along a face that is looked at from its edge, rounding decides.
    assert np.mean(np.abs(met - distance)[shown] < 1e-6) > 0.999
    assert np.mean((met < distance - 1e-6)[~shown]) > 0.999


def test_dense_correspondences_have_the_same_colour():
    scene = scene_named("room")
    camera = om.fisheye(240, 180)
    moved = om.Pose(exp((0.02, 0.2, 0.03)), np.array((0.25, 0.05, 0.1)))
    first, second = (Renderer(camera, pose, scene, vignette=0, samples=2) for pose in (om.Pose(), moved))
    found = dense_correspondences(first, second)
    there = ~np.isnan(found[..., 0])
    import cv2

    seen = cv2.remap(second.light(), found.astype(np.float32), None, cv2.INTER_LINEAR)
    apart = np.abs(seen - first.light())[there].max(-1)
    assert there.mean() > 0.4
    assert np.median(apart) < 0.01
    assert np.mean(apart < 0.08) > 0.9


# -- shutters, and rays that are none ------------------------------------------------------------------------------


def test_rolling_shutter_of_a_still_camera_equals_a_global_shutter():
    from omnisight.simulation.preset_motion import preset_trajectory

    camera, scene = om.fisheye(96, 180), still_life()
    rows = preset_trajectory("still", ((-0.1, -0.1, -0.1), (0.3, 0.3, 0.3))).row_poses(0.4, 96, 0.03)
    rolling, still = Renderer(camera, rows, scene), Renderer(camera, rows[0], scene)
    assert (rolling().image == still().image).all()
    np.testing.assert_array_equal(rolling.truth().depth, still.truth().depth)


def test_each_row_of_a_rolling_shutter_has_its_own_pose():
    from omnisight.simulation.preset_motion import preset_trajectory

    camera, scene = om.perspective((80, 60), 70), still_life()
    motion = preset_trajectory("line", ((-0.1, -0.1, -0.8), (0.1, 0.1, 0.8)))
    rows = motion.row_poses(1.0, 60, 0.4)
    rolling = Renderer(camera, rows, scene)
    truth = rolling.truth()
    for row in (0, 17, 30, 59):
        still = Renderer(camera, rows[row], scene)
        np.testing.assert_array_equal(truth.depth[row], still.truth().depth[row])
        np.testing.assert_array_equal(rolling.light()[row], still.light()[row])
    pixels, seen = rolling.locate(truth.points)
    assert np.abs(pixels - pixels_of(camera))[seen].max() < 1e-3
    assert seen[truth.instances > 0].mean() > 0.98


def test_wrong_number_of_row_poses_is_rejected():
    with pytest.raises(ValueError, match="12 rows needs as many poses, got 3"):
        Renderer(om.perspective((16, 12), 60), [om.Pose()] * 3, still_life())


def test_nan_rays_hit_nothing():
    met = still_life().cast(np.zeros((2, 3)), [[np.nan] * 3, [0, 0, 1]])
    assert np.isnan(met.distances[0])
    assert np.isnan(met.normals[0]).all()
    assert met.instances.tolist()[0] == 0
    assert np.isfinite(met.distances[1])
    with pytest.raises(ValueError, match=r"must be \(\.\.\., 3\)"):
        still_life().cast([0, 0], [1, 0])
