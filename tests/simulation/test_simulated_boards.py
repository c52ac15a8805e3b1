"""Boards in rendered images: corner positions, mirrored cameras and occlusion."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry.rotation import log
from omnisight.images import to_gray8
from omnisight.simulation import (
    DEMO_BOARD,
    BoardInScene,
    Renderer,
    Scene,
    Texture,
    board_poses,
    box,
    fisheye_setup,
    mirror_setup,
    render,
    scene_named,
)
from omnisight.targets import Checkerboard, board_class, detect, detect_checkerboard

SETUPS = {"fisheye": fisheye_setup, "mirror": mirror_setup}
PLAIN = Scene((box((-3, -3, -3), (3, 3, 3), Texture.plain((128, 128, 128)), "shell", inside=True, glow=1.0),))


@pytest.fixture(scope="module", params=SETUPS)
def setup(request):
    return SETUPS[request.param]()


def test_corners_match_the_detector(setup):
    """Over all images the RMS error is 0.02 px, without bias or outliers."""
    renderer = setup.renderer()
    errors = []
    for i, board in enumerate(setup.boards(6)):
        rendered = renderer([board], np.random.default_rng(i), noise=0.5)
        found = detect_checkerboard(to_gray8(rendered.image), DEMO_BOARD)
        assert found is not None
        assert len(found) == DEMO_BOARD.size
        true = rendered.corners[0].reshape(DEMO_BOARD.rows, DEMO_BOARD.columns, 2)
        # A mirrored board may be read from either end, because its corners are not numbered.
        readings = (true.reshape(-1, 2), true[:, ::-1].reshape(-1, 2))
        errors.append(min((found.pixels - reading[found.ids] for reading in readings), key=np.linalg.norm))
    errors = np.concatenate(errors)
    length = np.linalg.norm(errors, axis=1)
    assert np.sqrt((length**2).mean()) < 0.02
    assert np.percentile(length, 99) < 0.06
    assert length.max() < 0.12
    assert np.abs(errors.mean(0)).max() < 0.005


def test_pinhole_corners_are_sharp():
    """A board that fills the image: what is left is the detector's own, with the place of an edge in its pixel."""
    camera = om.perspective((480, 360), 60)
    board = BoardInScene(DEMO_BOARD, om.Pose(translation=np.array((-0.14, -0.08, 0.45))))
    rendered = render(camera, [board], scene=PLAIN, samples=3, noise=0, vignette=0)
    found = detect_checkerboard(to_gray8(rendered.image), DEMO_BOARD)
    assert found is not None
    errors = found.pixels - rendered.corners[0][found.ids]
    assert np.sqrt((errors**2).sum(1).mean()) < 0.015
    assert np.linalg.norm(errors, axis=1).max() < 0.03


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("aprilgrid", {"columns": 4, "rows": 3, "tag": "80mm", "spacing": 0.3}),
        ("charuco", {"columns": 7, "rows": 5, "square": "60mm", "marker": "45mm"}),
        ("circles", {"columns": 4, "rows": 9, "spacing": "40mm", "diameter": "38mm"}),
    ],
)
def test_every_board_type_can_be_rendered(kind, fields):
    board = board_class(kind).from_dict(fields)
    left, top, right, bottom = board.extent
    middle = np.array(((left + right) / 2, (top + bottom) / 2, 0))
    pose = om.Pose(om.look(12, 8).T, np.array((0, 0, 0.6)) - om.look(12, 8).T @ middle)
    rendered = render(om.perspective((640, 480), 70), [BoardInScene(board, pose)], scene=PLAIN, noise=0.5)
    found = detect(to_gray8(rendered.image), board)[0]
    assert len(found) == board.size
    true = rendered.corners[0]
    if kind == "circles":
        true = true + board.measurement_offset(lambda x: om.perspective((640, 480), 70).project(pose @ x)[0])
    errors = np.linalg.norm(found.pixels - true[found.ids], axis=1)
    assert np.sqrt((errors**2).mean()) < 0.05


def test_board_without_square_size_has_unit_squares():
    board = BoardInScene(Checkerboard(6, 5), om.Pose(translation=np.array((-2.5, -2.0, 8.0))))
    rendered = render(om.perspective((320, 240), 60), [board], scene=Scene(()), noise=0)
    found = detect_checkerboard(to_gray8(rendered.image), board.board)
    assert found is not None
    assert np.abs(found.pixels - rendered.corners[0][found.ids]).max() < 0.05


def test_back_of_a_board_is_white():
    turned = om.Pose(om.look(180).T, np.array((0.14, -0.08, 0.5)))
    image = render(om.perspective((160, 120), 40), [BoardInScene(DEMO_BOARD, turned)], scene=PLAIN, noise=0).image
    assert image[40:80, 60:100].std() < 4
    assert image[40:80, 60:100].min() > 150


def test_same_seed_renders_the_same_image():
    setup = fisheye_setup(320)
    images = [
        setup.renderer()(setup.boards(1, seed=seed), np.random.default_rng(noise)).image
        for seed, noise in ((3, 1), (3, 1), (3, 2), (4, 1))
    ]
    assert (images[0] == images[1]).all()
    assert (images[0] != images[2]).any()
    assert (images[0] != images[3]).any()


def test_negative_focal_length_mirrors_the_image():
    setup = mirror_setup(320)
    model = dataclasses.replace(setup.camera.model, cx=159.5)
    mirrored = dataclasses.replace(setup.camera, model=model)
    plain = dataclasses.replace(setup.camera, model=dataclasses.replace(model, fx=-model.fx))
    first, second = (render(camera, world_from_cam=setup.world_from_cam, noise=0).image for camera in (mirrored, plain))
    # The footprint of a ray is estimated from neighbours on the other side, which rounds filtered texels differently.
    apart = np.abs(first.astype(int) - second[:, ::-1])
    assert apart.mean() < 0.5
    assert np.percentile(apart, 99) <= 4
    assert np.abs(first.astype(int) - second).mean() > 20


def test_calibrated_mirror_camera_unrolls_the_room_correctly():
    """The calibrated camera has fx > 0; with flip its panorama is the true one's, not its mirror image."""
    setup = mirror_setup()
    rendered = setup.renderer()(noise=0).image
    model = setup.camera.model
    calibrated = dataclasses.replace(setup.camera, model=dataclasses.replace(model, fx=-model.fx))
    target = om.cylinder(400, (-30, 15))
    around = om.remap(rendered, calibrated, target, om.look(up="back", flip=True))
    room = render(target, samples=2, noise=0, vignette=0, blur=0).image
    # The window's wall, to the right, against the same wall and against the left one.
    right, left = around[:, 250:330].astype(int), around[:, 70:150].astype(int)
    assert np.abs(right - room[:, 250:330]).mean() < 25
    assert np.abs(left - room[:, 250:330]).mean() > 30


def test_nearer_board_occludes_a_farther_one():
    camera = om.perspective((240, 180), 60)
    boards = [BoardInScene(DEMO_BOARD, om.Pose(translation=np.array((-0.14, -0.08, z)))) for z in (0.5, 1.0)]
    alone = render(camera, boards[:1], noise=0, scene=PLAIN).image
    for order in (boards, boards[::-1]):
        renderer = Renderer(camera, scene=PLAIN)
        both = renderer(order, noise=0).image
        # The light on it is worked out with the other board behind it.
        assert np.abs(both[60:120, 80:160].astype(int) - alone[60:120, 80:160]).max() <= 6
        truth = renderer.truth(order)
        assert truth.points[90, 120, 2] == pytest.approx(0.5, abs=1e-12)
        near = [board is boards[0] for board in order].index(True)
        assert truth.instances[90, 120] == len(PLAIN.names) + 1 + near


def test_solid_in_front_of_a_board_occludes_it():
    pillar = box((-0.03, -1, 0.3), (0.03, 1, 0.35), Texture.plain((20, 90, 20)), "pillar", glow=1.0)
    scene = Scene((*PLAIN.solids, pillar))
    board = BoardInScene(DEMO_BOARD, om.Pose(translation=np.array((-0.14, -0.08, 0.5))))
    image = render(om.perspective((240, 180), 60), [board], scene=scene, noise=0, vignette=0).image
    assert (image[90, 120] == (20, 90, 20)).all()
    assert image[90, 80:100].std() > 20


@pytest.mark.parametrize("seed", range(3))
def test_board_poses_cover_the_field_and_are_tilted(setup, seed):
    poses = board_poses(setup.camera, DEMO_BOARD, 12, seed=seed, theta=setup.theta)
    middles = np.array([pose @ DEMO_BOARD.points.mean(0) for pose in poses])
    azimuth = np.sort(np.arctan2(middles[:, 1], middles[:, 0]))
    assert np.degrees(np.diff(np.append(azimuth, azimuth[0] + 2 * np.pi)).max()) < 90
    theta = np.degrees(np.arctan2(np.hypot(middles[:, 0], middles[:, 1]), middles[:, 2]))
    assert np.ptp(theta) > 30
    for pose, middle in zip(poses, middles, strict=True):
        tilt = np.degrees(np.arccos(pose.rotation[:, 2] @ middle / np.linalg.norm(middle)))
        assert 19.9 < tilt < 45.1
        assert np.isfinite(log(pose.rotation)).all()
        pixels, valid = setup.camera.project(pose @ DEMO_BOARD.points)
        assert valid.all()
        assert setup.camera.in_image(pixels).all()


def test_too_large_board_is_rejected():
    with pytest.raises(ValueError, match="increase its distance"):
        board_poses(om.perspective((160, 120), 30), DEMO_BOARD, 1, distance=(0.3, 0.4))


def test_boards_of_the_scene_are_detected_at_their_positions():
    """A pinhole sees one board of each kind of the middle ring."""
    scene = scene_named("boards")
    kinds = {name.split()[0] for name in scene.names}
    assert kinds == {"hall", "checkerboard", "aprilgrid", "charuco", "circles"}
    image = render(om.perspective((640, 480), 60), scene=scene, noise=0.5).image
    assert detect_checkerboard(to_gray8(image), Checkerboard(9, 6, 0.06)) is not None


def test_corners_under_a_rolling_shutter_match_the_ground_truth():
    """The scene point at the pixel of a corner is that corner, with one camera pose per row."""
    from omnisight.simulation.preset_motion import preset_trajectory

    camera = om.perspective((320, 240), 70)
    rows = preset_trajectory("line", ((-1.5, -0.1, -0.1), (1.5, 0.1, 0.1))).row_poses(1.5, 240, 0.2)
    rows = [om.Pose(translation=pose.translation) for pose in rows]  # sideways
    board = BoardInScene(DEMO_BOARD, om.Pose(translation=np.array((-0.14, -0.08, 0.8))))
    rolling = Renderer(camera, rows, Scene(()))
    corners = rolling([board]).corners[0]
    still = Renderer(camera, rows[120], Scene(()))([board]).corners[0]
    assert np.abs(corners - still).max() > 3
    truth = rolling.truth([board])
    at = np.rint(corners).astype(int)
    points = truth.points[at[:, 1], at[:, 0]]
    true = rows[120] @ (board.cam_from_board @ DEMO_BOARD.points)
    assert np.linalg.norm(points - true, axis=1).max() < 0.8 * 0.8 / camera.model.fx  # within the pixel
    light = rolling.light([board])
    assert (light[at[:, 1], at[:, 0]] > 0).all()
