"""omnisight simulate --export: the files agree with the data set, read by the rules of each format."""

import json
from dataclasses import replace

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load, load_rig, save
from omnisight.images import read_image
from omnisight.models import model_class
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.exports import export_names
from omnisight.simulation.trajectory import read_trajectory

LENS = om.Camera(KannalaBrandt(17.0, 17.0, 23.5, 23.5, 0.01, 0.0, 0.0, 0.0), (48, 48), theta_max=np.radians(80))
UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
# The square of side 2 m, and its first side again: the end is at the place of the beginning.
WAY = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (0.1, 0))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return a data set of the lines with all exports."""
    from omnisight import cli

    place = tmp_path_factory.mktemp("set")
    save(LENS, place / "lens.json")
    lines = [f"{2 * i} {x} 0 {z} 0 0 0 1" for i, (x, z) in enumerate(WAY)]
    (place / "way.txt").write_text("\n".join(lines) + "\n")
    options = ["--trajectory", place / "way.txt", "--imu", 50, "--export", ",".join(export_names())]
    arguments = ["simulate", "lines", "--camera", place / "lens.json", "--rays", 1, *options, "-o", place / "out"]
    with pytest.raises(SystemExit) as left:
        cli.main([str(argument) for argument in arguments])
    assert not left.value.code
    return place / "out"


def test_formats_are_described_and_listed(exported):
    assert export_names() == ("colmap", "covisibility", "euroc", "kitti", "nerfstudio")
    readme, listed = (exported / "README.txt").read_text(), (exported / "exports.txt").read_text().splitlines()
    for name in export_names():
        assert f"\n{name}/" in readme
        files = {path.relative_to(exported).as_posix() for path in (exported / name).rglob("*") if path.is_file()}
        assert files
        assert files == {line for line in listed if line.startswith(f"{name}/")}


def test_euroc_ground_truth_and_imu_agree_with_the_poses(exported):
    folder, poses = exported / "euroc" / "mav0", read_trajectory(exported / "poses.txt")
    lines = (folder / "cam0" / "data.csv").read_text().splitlines()
    rows = np.array([line.split(",") for line in lines[1:]])
    np.testing.assert_array_equal(rows[:, 0].astype(int), np.rint(poses.times * 1e9).astype(int))
    for i, name in enumerate(rows[:, 1]):
        expected = read_image(exported / "images" / f"{i:06d}.png")
        np.testing.assert_array_equal(read_image(folder / "cam0" / "data" / name), expected)
    truth = np.loadtxt(folder / "state_groundtruth_estimate0" / "data.csv", delimiter=",")
    imu = np.loadtxt(folder / "imu0" / "data.csv", delimiter=",")
    np.testing.assert_array_equal(truth[:, 0], imu[:, 0])
    assert truth.shape[1] == 17
    for time, pose in zip(poses.times, poses.poses, strict=True):
        row = truth[np.argmin(np.abs(truth[:, 0] - time * 1e9))]
        np.testing.assert_allclose(row[1:4], UP @ pose.translation, atol=1e-6)
        w, x, y, z = row[4:8]
        # The camera looks forward and its z axis is y of a world with z up.
        forward = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        np.testing.assert_allclose(forward, UP @ pose.rotation[:, 2], atol=1e-6)
    velocity = np.gradient(truth[:, 1:4], truth[:, 0] / 1e9, axis=0)
    np.testing.assert_allclose(velocity[1:-1], truth[1:-1, 8:11], atol=1e-2)
    # At rest the accelerometer measures the reaction to gravity: up is -y of the body.
    mean = (imu[:, 4:] - truth[:, 14:]).mean(0)
    assert mean[1] == pytest.approx(-9.81, abs=0.1)


def test_euroc_camera_is_read_back(exported):
    camera = load(exported / "euroc" / "mav0" / "cam0" / "sensor.yaml")
    points = np.random.default_rng(0).normal((0, 0, 2), size=(50, 3))
    np.testing.assert_allclose(camera.project(points)[0], LENS.project(points)[0], atol=1e-3)


def test_kitti_poses_are_relative_to_the_first_image(exported):
    rows = np.loadtxt(exported / "kitti" / "poses" / "00.txt").reshape(-1, 3, 4)
    poses = read_trajectory(exported / "poses.txt").poses
    assert len(rows) == len(poses)
    for row, pose in zip(rows, poses, strict=True):
        np.testing.assert_allclose(row, (poses[0].inverse() @ pose).matrix, atol=1e-7)
    sequence = exported / "kitti" / "sequences" / "00"
    assert len(np.loadtxt(sequence / "times.txt")) == len(list((sequence / "image_2").iterdir())) == len(poses)
    assert not (sequence / "calib.txt").exists()


def test_kitti_projection_matrices_of_a_stereo_rig(run, tmp_path):
    lens, right = om.perspective((48, 48), 90), om.Pose(translation=np.array((-0.5, 0.0, 0.0)))
    file = save(Rig.from_sensors({"left": (lens, om.Pose()), "right": (lens, right)}), tmp_path / "rig.json").path
    arguments = ("simulate", "lines", "--camera", file, "--rays", 1, "--frames", 1, "-o", tmp_path / "out")
    assert run(*arguments, "--export", "kitti")[0] == 0
    lines = (tmp_path / "out" / "kitti" / "sequences" / "00" / "calib.txt").read_text().splitlines()
    matrices = [np.array(line.split()[1:], float).reshape(3, 4) for line in lines]
    assert [line[:3] for line in lines] == ["P2:", "P3:"]
    point = np.array((0.3, -0.2, 2.0))
    for matrix, pose in zip(matrices, (om.Pose(), right), strict=True):
        u, v, w = matrix @ np.append(point, 1)
        np.testing.assert_allclose((u / w, v / w), lens.project(pose @ point)[0], atol=1e-9)


def test_colmap_points_project_to_their_pixels_and_are_visible(exported):
    folder = exported / "colmap" / "sparse" / "0"
    points = {
        int(words[0]): np.array(words[1:4], float)
        for line in (folder / "points3D.txt").read_text().splitlines()
        if (words := line.split()) and not line.startswith("#")
    }
    assert len(points) > 100
    lines = [line for line in (folder / "images.txt").read_text().splitlines() if not line.startswith("#")]
    poses, scene = read_trajectory(exported / "poses.txt").poses, scene_named("lines")
    assert len(lines) == 2 * len(poses)
    for pose, header, seen in zip(poses, lines[::2], lines[1::2], strict=True):
        assert (exported / "colmap" / "images" / header.split()[-1]).is_file()
        table = np.array(seen.split(), float).reshape(-1, 3)
        assert len(table) > 50
        positions = np.array([points[int(number)] for number in table[:, 2]])
        pixels = LENS.project(pose.inverse() @ positions)[0]
        np.testing.assert_allclose(table[:, :2] - 0.5, pixels, atol=1e-4)
        assert Renderer(LENS, pose, scene).locate(positions)[1].mean() > 0.9


def test_nerfstudio_poses_have_the_axes_of_opengl(exported):
    frames = json.loads((exported / "nerfstudio" / "transforms.json").read_text())["frames"]
    poses = read_trajectory(exported / "poses.txt").poses
    assert len(frames) == len(poses)
    for frame, pose in zip(frames, poses, strict=True):
        assert (exported / "nerfstudio" / frame["file_path"]).is_file()
        matrix = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(matrix[:3, 3], pose.translation, atol=1e-6)
        np.testing.assert_allclose(matrix[:3, :3] * (1, -1, -1), pose.rotation, atol=1e-6)


def read_pairs(path):
    header, *rows = [line.split(",") for line in path.read_text().splitlines()]
    return header, {(int(row[0][:6]), int(row[1][:6])): [float(value) for value in row[2:]] for row in rows}


def test_covisibility_agrees_with_exact_visibility(exported):
    _, pairs = read_pairs(exported / "covisibility" / "covisibility.csv")
    poses, scene = read_trajectory(exported / "poses.txt").poses, scene_named("lines")
    assert len(pairs) > 5
    for (a, b), shares in pairs.items():
        for (i, j), share in zip(((a, b), (b, a)), shares, strict=True):
            first, second = (Renderer(LENS, poses[k], scene, theta=(0, LENS.theta_max)) for k in (i, j))
            truth = first.truth()
            exact = second.locate(truth.points)[1][~np.isnan(truth.depth)].mean()
            assert share == pytest.approx(exact, abs=0.12)


def test_loops_are_at_the_same_place_at_different_times(exported):
    _, pairs = read_pairs(exported / "covisibility" / "loops.csv")
    assert (0, 4) in pairs
    assert (0, 1) not in pairs
    assert (0, 2) not in pairs
    distance, travelled, share = pairs[0, 4]
    assert distance == pytest.approx(0, abs=1e-6)
    assert travelled == pytest.approx(4, abs=1e-6)
    assert share > 0.9


def test_exports_of_an_older_data_set_are_removed_and_other_files_are_kept(run, tmp_path):
    file, out = save(LENS, tmp_path / "lens.json").path, tmp_path / "out"
    common = ("simulate", "lines", "--camera", file, "--rays", 1, "--frames", 1, "-o", out)
    assert run(*common, "--export", "kitti")[0] == 0
    (out / "kitti" / "mine.txt").write_text("a note")
    with (out / "exports.txt").open("a") as manifest:
        manifest.write("../lens.json\n")
    assert run(*common)[0] == 0
    assert [path.name for path in (out / "kitti").iterdir()] == ["mine.txt"]
    assert file.is_file()


def test_exports_that_cannot_hold_the_camera_are_refused_before_rendering(refuses, tmp_path):
    file, out = save(LENS, tmp_path / "lens.json").path, tmp_path / "out"
    common = ("simulate", "lines", "--rays", 1, "-o", out)
    assert "--export euroc needs an IMU: add --imu RATE" in refuses(*common, "--camera", file, "--export", "euroc")
    assert "unknown export of data sets 'tartan'; there are: colmap" in refuses(
        *common, "--camera", file, "--export", "tartan"
    )
    from omnisight.optics.models.axial import Axial

    axial = save(RayCamera(Axial(LENS.model, (0.1, 0.0)), (48, 48), unit="m"), tmp_path / "axial.json").path
    for name in ("euroc", "colmap", "nerfstudio"):
        output = refuses(*common, "--camera", axial, "--imu", 9, "--export", name)
        assert f"--export {name}: " in output
        assert "non-central" in output
        assert "splat" not in output
    assert not out.exists()


def test_rigs_are_exported_with_a_folder_for_each_camera(run, tmp_path):
    side = om.Pose(om.look(yaw=90), np.array((0.1, 0.0, 0.0)))
    rig = Rig.from_sensors({"front": (LENS, om.Pose()), "side": (LENS, side)})
    file, out = save(rig, tmp_path / "rig.json").path, tmp_path / "out"
    arguments = ("simulate", "lines", "--camera", file, "--rays", 1, "--frames", 2, "--imu", 20, "-o", out)
    assert run(*arguments, "--export", "euroc,colmap,covisibility")[0] == 0
    text = (out / "euroc" / "mav0" / "cam1" / "sensor.yaml").read_text()
    matrix = np.array(text.split("data: [")[1].split("]")[0].split(","), float).reshape(4, 4)
    np.testing.assert_allclose(matrix[:3], side.inverse().matrix, atol=1e-9)
    assert (out / "colmap" / "images" / "side" / "000001.png").is_file()
    assert "front/000000.png,side/000000.png" in (out / "covisibility" / "covisibility.csv").read_text()
    assert len(load_rig(out / "rig.json")) == 2


def test_euroc_names_of_the_lens(run, tmp_path):
    lens = om.perspective((48, 48), 90)
    values = {"fx": 24.0, "fy": 24.0, "cx": 23.5, "cy": 23.5, "k1": -0.01, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0}
    model = model_class("radial_tangential").from_dict(values)
    # A pose of another file must not contradict T_BS.
    save(replace(lens, model=model, extra={"T_cam_imu": np.eye(4).tolist()}), tmp_path / "lens.json")
    options = "--frames", 1, "--rays", 1, "--imu", 50, "--export", "euroc", "-o", tmp_path / "out"
    assert run("simulate", "lines", "--camera", tmp_path / "lens.json", *options)[0] == 0
    file = tmp_path / "out" / "euroc" / "mav0" / "cam0" / "sensor.yaml"
    assert (
        "\ndistortion_model: radial-tangential\ndistortion_coefficients: [-0.01, 0.0, 0.0, 0.0]\n" in file.read_text()
    )
    assert "T_cam_imu" not in file.read_text()
    assert load(file).model == model
