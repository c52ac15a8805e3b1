"""omnisight simulate."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load, save
from omnisight.images import read_image
from omnisight.models import model_class
from omnisight.optics.models.axial import Axial
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.trajectory import read_trajectory

SMALL = om.fisheye(64, 180)


@pytest.fixture
def small(tmp_path):
    return save(SMALL, tmp_path / "small.json").path


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A data set of three images of the lines."""
    from omnisight import cli

    place = tmp_path_factory.mktemp("set")
    save(SMALL, place / "small.json")
    with pytest.raises(SystemExit) as left:
        cli.main(
            ["simulate", "lines", "--camera", str(place / "small.json"), "--frames", "3", "-o", str(place / "out")]
        )
    assert not left.value.code
    return place / "out"


def test_all_files_are_written_and_described_in_the_readme(written):
    text = (written / "README.txt").read_text()
    names = {str(path.relative_to(written)) for path in written.rglob("*") if path.is_file()}
    kinds = ("images", "depth", "normals", "instances")
    assert names == {
        *(f"{kind}/{i:06d}.png" for kind in kinds for i in range(3)),
        *("README.txt", "settings.json", "poses.txt", "images.txt", "depth.txt", "camera.json", "instances.json"),
        *("vignette.png", "pcalib.txt"),
    }
    described = ("poses.txt", "images.txt", "camera.json", "instances.json", "vignette", "pcalib.txt")
    for name in (*(f"{kind}/" for kind in kinds), *described):
        assert name in text
    assert json.loads((written / "settings.json").read_text())["scene"] == "lines"
    # As the TUM data sets' rgb.txt, whose readers skip three lines of comment.
    lines = (written / "images.txt").read_text().splitlines()
    assert [line[:1] for line in lines[:4]] == ["#", "#", "#", "0"]
    # Spread over the motion of a walking person.
    seconds = float(lines[4].removesuffix(" images/000001.png"))
    assert 1 < seconds < 10
    assert float(lines[5].removesuffix(" images/000002.png")) == pytest.approx(2 * seconds, abs=2e-6)


def test_photometric_files_invert_the_image(run, small, tmp_path):
    """Without noise and blur, response^-1(image) = 2^exposure vignette light."""
    out = tmp_path / "out"
    options = ("--noise", 0, "--blur", 0, "--frames", 1, "--exposure", -1, "--vignette", 0.5, "-o", out)
    assert run("simulate", "lines", "--camera", small, *options)[0] == 0
    image, settings = read_image(out / "images" / "000000.png"), json.loads((out / "settings.json").read_text())
    inverse = np.array((out / "pcalib.txt").read_text().split(), float) / 255
    vignette = cv2.imread(str(out / "vignette.png"), cv2.IMREAD_UNCHANGED) / 65535
    pose = read_trajectory(out / "poses.txt").poses[0]
    light = Renderer(load(out / "camera.json"), pose, scene_named("lines"), vignette=0).light()
    inside = vignette > 0.4
    assert inside.mean() > 0.6
    assert vignette[32, 32] == pytest.approx(1, abs=1e-3)
    expected = 2.0 ** settings["exposure"] * vignette[..., None] * light
    off = np.abs(inverse[image] - expected)[inside & (light < 1).all(-1)]
    assert np.quantile(off, 0.99) < 0.01


def test_street_depth_beyond_65_metres_is_kept(run, small, tmp_path):
    out = tmp_path / "out"
    options = ("--frames", 1, "--rays", 1, "--trajectory", "still", "-o", out)
    assert run("simulate", "street", "--camera", small, *options)[0] == 0
    steps = json.loads((out / "settings.json").read_text())["depth_steps_per_metre"]
    depth = cv2.imread(str(out / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED) / steps
    truth = Renderer(SMALL, read_trajectory(out / "poses.txt").poses[0], scene_named("street")).truth().depth
    far = truth > 66
    assert far.any()
    np.testing.assert_allclose(depth[far], truth[far], atol=0.5 / steps + 1e-3)


def test_files_agree_with_the_ground_truth_at_their_poses(written):
    """A reader that knows the README alone gets the points of the scene."""
    camera, motion = load(written / "camera.json"), read_trajectory(written / "poses.txt")
    names = json.loads((written / "instances.json").read_text())
    scene = scene_named("lines")
    bearings, valid = camera.unproject(np.stack(np.meshgrid(np.arange(64), np.arange(64)), -1))
    for i, pose in enumerate(motion.poses):
        read = {
            kind: cv2.imread(str(written / kind / f"{i:06d}.png"), cv2.IMREAD_UNCHANGED)
            for kind in ("depth", "instances")
        }
        normals = cv2.imread(str(written / "normals" / f"{i:06d}.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535 * 2 - 1
        truth = Renderer(SMALL, pose, scene).truth()
        seen = valid & (read["depth"] > 0)
        assert seen.mean() > 0.6
        points = pose @ (read["depth"][..., None] / 1000 * bearings)
        close = np.abs(points - truth.points).max(-1)[seen] < 1e-3
        assert close.mean() > 0.995  # but at edges, where the pose's last digit decides
        assert np.mean(read["instances"][seen] == truth.instances[seen]) > 0.995
        assert np.median(np.abs(normals - truth.normals)[seen]) < 2e-5
    assert names[str(read["instances"][32, 32])] in scene.names
    image = read_image(written / "images" / "000000.png")
    assert image.shape == (64, 64, 3)
    assert image.std() > 10


def test_exact_ground_truth_is_float32(run, small, tmp_path):
    out, options = tmp_path / "out", ("--exact", "--jpeg", 90, "--circle", "5:80")
    status, _, err = run("simulate", "lines", "--camera", small, "--frames", 1, *options, "-o", out)
    assert (status, err) == (0, "")
    depth = np.load(out / "depth" / "000000.npy")
    pose = read_trajectory(out / "poses.txt").poses[0]
    truth = Renderer(SMALL, pose, scene_named("lines")).truth()
    assert depth.dtype == np.float32
    assert np.isnan(depth).any()
    assert np.mean(np.abs(depth - truth.depth)[~np.isnan(depth)] < 1e-5) > 0.995
    assert (out / "images" / "000000.jpg").is_file()
    assert "images/000000.jpg" in (out / "images.txt").read_text()


def test_same_seed_writes_the_same_bytes_and_replaces_an_older_set(run, small, tmp_path):
    def simulated_images(folder, *options):
        status, _, err = run("simulate", "lines", "--camera", small, "--rays", 1, *options, "-o", folder)
        assert (status, err) == (0, "")
        return [path.read_bytes() for path in sorted((folder / "images").iterdir())]

    first = simulated_images(tmp_path / "a", "--frames", 2)
    assert simulated_images(tmp_path / "b", "--frames", 2) == first
    assert simulated_images(tmp_path / "b", "--frames", 1, "--seed", 4) != first[:1]
    assert len(list((tmp_path / "b" / "depth").iterdir())) == 1


def test_interrupted_data_set_is_cleared(run, small, tmp_path, monkeypatch):
    from omnisight.simulation.dataset import Dataset

    lens = om.fisheye(32, 170)
    file = save(Rig.from_sensors({name: (lens, om.Pose()) for name in ("left", "right")}), tmp_path / "rig.json").path
    common, out = ("simulate", "lines", "--rays", 1, "-o", tmp_path / "out"), tmp_path / "out"

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(Dataset, "finish", interrupted)
        status, _, err = run(*common, "--camera", file, "--frames", 2)
    assert status != 0
    assert "interrupted" in err
    assert (out / "left" / "images" / "000001.png").is_file()
    assert "Not finished" in (out / "README.txt").read_text()
    (out / "mine.txt").write_text("a note")
    assert run(*common, "--camera", small, "--frames", 1)[0] == 0
    assert {path.name for path in out.iterdir() if path.is_dir()} == {"images", "depth", "normals", "instances"}
    assert (out / "mine.txt").read_text() == "a note"


def test_invalid_options_keep_an_older_set(run, refuses, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, "--rays", 1, "--frames", 1, "-o", tmp_path / "out")
    run(*common)
    for options in (("--blur", "nan"), ("--jpeg", 0), ("--circle", "170:180"), ("--trajectory", "nowhere")):
        refuses(*common, *options)
    assert (tmp_path / "out" / "images" / "000000.png").is_file()
    assert (tmp_path / "out" / "settings.json").is_file()


def test_camera_outside_the_room_causes_a_note(run, small, tmp_path):
    (tmp_path / "out.txt").write_text("0 0 0 0 0 0 0 1\n1 0 0 3.5 0 0 0 1\n")
    common = ("simulate", "lines", "--camera", small, "--rays", 1, "--trajectory", tmp_path / "out.txt")
    status, out, err = run(*common, "-o", tmp_path / "out", "--json")
    assert status == 0
    (note,) = json.loads(out)["notes"]
    assert "1 of 2 images" in note
    assert "000001 at (0.00, 0.00, 3.50) m, in 'hall'" in note
    assert note in err


def test_folder_with_other_content_is_refused(refuses, small, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "README.txt").write_text("my thesis")
    output = refuses("simulate", "lines", "--camera", small, "-o", tmp_path / "mine")
    assert "contains files that are not of a simulated data set; choose another folder" in output
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["README.txt"]
    assert "is a file; choose a folder" in refuses("simulate", "lines", "--camera", small, "-o", small)


def test_trajectory_file_defines_times_and_poses(run, small, tmp_path):
    (tmp_path / "way.csv").write_text("timestamp,tx,ty,tz,qx,qy,qz,qw\n10,0,0,0,0,0,0,1\n10.5,0.2,0,0,0,0,0,1\n")
    common = ("simulate", "lines", "--camera", small, "--rays", 1, "--trajectory", tmp_path / "way.csv")
    run(*common, "-o", tmp_path / "own")
    own = read_trajectory(tmp_path / "own" / "poses.txt")
    np.testing.assert_array_equal(own.times, [10, 10.5])
    status, out, _ = run(*common, "--fps", 8, "-o", tmp_path / "even", "--json")
    told = json.loads(out)
    assert (status, told["frames"], told["scene"]) == (0, 5, "lines")
    even = read_trajectory(tmp_path / "even" / "poses.txt")
    np.testing.assert_allclose([pose.translation[0] for pose in even.poses], np.linspace(0, 0.2, 5), atol=1e-9)


def test_up_back_points_the_camera_down(run, refuses, small, tmp_path):
    order = ["simulate", "lines", "--camera", small, "--trajectory", "still", "--frames", 1]
    run(*order, "--up", "back", "-o", tmp_path / "out")
    (pose,) = read_trajectory(tmp_path / "out" / "poses.txt").poses
    np.testing.assert_allclose(pose.rotation[:, 2], (0, 1, 0), atol=1e-6)  # its axis points to the floor
    (tmp_path / "own.txt").write_text("0 0 0 0 0 0 0 1\n")
    order[5] = tmp_path / "own.txt"
    assert "the poses of a file define the orientation" in refuses(*order, "--up", "back", "-o", tmp_path / "other")


def test_rolling_shutter_changes_images_and_readme(run, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, "--rays", 1, "--frames", 1, "--trajectory", "turn", "--noise", 0)
    run(*common, "-o", tmp_path / "global")
    run(*common, "--rolling-shutter", 20, "-o", tmp_path / "rolling")
    assert "Rolling shutter of 20 ms" in (tmp_path / "rolling" / "README.txt").read_text()
    a, b = (read_image(tmp_path / kind / "images" / "000000.png") for kind in ("global", "rolling"))
    assert (a != b).any()


def test_rigs_and_non_central_cameras_are_rendered(run, tmp_path):
    lens = om.fisheye(48, 170).model
    cameras = {
        "left": (om.fisheye(48, 170), om.Pose(translation=np.array((0.1, 0, 0)))),
        "right": (RayCamera(Axial(lens, (0.01, 0.0)), (48, 48)), om.Pose(om.look(180), np.array((-0.1, 0, 0)))),
    }
    file = save(Rig.from_sensors(cameras), tmp_path / "rig.json").path
    out = tmp_path / "out"
    status, output, err = run("simulate", "lines", "--camera", file, "--frames", 2, "--rays", 1, "-o", out)
    assert (status, err) == (0, "")
    assert ", 2 cameras" in output
    rig = read_trajectory(out / "poses.txt")
    for name, (_, sensor_from_rig) in cameras.items():
        own = read_trajectory(out / name / "poses.txt")
        expected = rig.poses[1] @ sensor_from_rig.inverse()
        np.testing.assert_allclose(own.poses[1].translation, expected.translation, atol=1e-8)
        assert (out / name / "images" / "000001.png").is_file()
        assert load(out / name / "camera.json").size == (48, 48)
    assert (out / "rig.json").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--rays", 5), "--rays must be 1, 4, 9 or 16, got 5"),
        (("--frames", 0), "--frames must be from 1"),
        (("--fps", 0), "--fps must be from 0.001"),
        (("--vignette", 2), "--vignette must be from 0 to 1"),
        (("--rolling-shutter", "nan"), "--rolling-shutter must be"),
        (("--seed", -1), "--seed must not be negative"),
        (("--jpeg", 0), "jpeg must be from 1 to 100, got 0"),
        (("--circle", "90:20"), "--circle must be two angles"),
        (("--circle", "170:180"), "--circle 170:180 excludes the whole field of view of"),
        (("--noise", -1), "noise must be from 0 to 255"),
        (("--trajectory", "circle"), "is neither a file nor one of line, loop"),
    ],
)
def test_invalid_options_are_rejected(refuses, small, tmp_path, options, message):
    assert message in refuses("simulate", "lines", "--camera", small, *options, "-o", tmp_path / "out")


def test_unknown_scenes_and_invalid_files_are_rejected(refuses, small, tmp_path):
    assert "unknown scene 'moon'" in refuses("simulate", "moon", "--camera", small, "-o", tmp_path / "out")
    (tmp_path / "bad.csv").write_text("1 0 0 0 0 0 0 1\n2 0 0 zero 0 0 0 1\n")
    output = refuses(
        "simulate", "lines", "--camera", small, "--trajectory", tmp_path / "bad.csv", "-o", tmp_path / "out"
    )
    assert "bad.csv, line 2: 'zero' is not a number" in output
    squares = RayCamera(Axial(SMALL.model, (0.1, 0.0)), (64, 64), unit="squares")
    file = save(squares, tmp_path / "squares.json").path
    assert "in squares, not metres" in refuses("simulate", "lines", "--camera", file, "-o", tmp_path / "out")
    rig = Rig.from_sensors({"../../up": (SMALL, om.Pose())})
    file = save(rig, tmp_path / "rig.json").path
    assert "cannot be used as a folder name" in refuses("simulate", "lines", "--camera", file, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def side_by_side(camera):
    return Rig.from_sensors(
        {"left": (camera, om.Pose()), "right": (camera, om.Pose(np.eye(3), np.array([-0.1, 0, 0])))}
    )


def test_a_rig_in_squares_is_refused(refuses, tmp_path):
    file = save(replace(side_by_side(SMALL), unit="squares"), tmp_path / "squares.json").path
    assert "this rig are in squares, not metres" in refuses("simulate", "lines", "--camera", file, "-o", tmp_path / "o")


def test_a_damaged_rig_is_refused_with_its_damage(refuses, tmp_path):
    camera = om.Camera(model_class("kannala_brandt").example(), (960, 720))
    file = save(side_by_side(camera), tmp_path / "rig.yaml", format="kalibr").path
    file.write_text(file.read_text().replace("[1.0, 0.0, 0.0, -0.1]", "[1.0, 0.0, 0.5, -0.1]"))
    output = refuses("simulate", "lines", "--camera", file, "-o", tmp_path / "o")
    assert "T_cn_cnm1 is not a rotation matrix" in output
