"""omnisight inspect and convert of rigs."""

import dataclasses
import json

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load_rig, save
from omnisight.images import write_image
from omnisight.simulation.example_rigs import back_to_back, surround_car


def test_convert_writes_all_cameras_and_prints_the_errors(run, tmp_path):
    rig = surround_car()
    source = save(rig, tmp_path / "rig.json").path
    status, out, err = run("convert", source, "--to", "basalt", "-o", tmp_path / "basalt.json")
    assert (status, err) == (0, "")
    for name in rig.names:
        assert f"\n{name} " in out
    assert "reads back within" in out
    assert "deg, " in out
    again = load_rig(tmp_path / "basalt.json")
    for ours, theirs in zip(rig.sensor_from_rig, again.sensor_from_rig, strict=True):
        np.testing.assert_allclose(theirs.matrix, ours.matrix, atol=1e-12)


def test_convert_fits_models_that_the_format_lacks(run, tmp_path):
    source = save(surround_car(), tmp_path / "rig.json").path
    status, out, _ = run("convert", source, "--to", "kalibr", "--model", "eucm", "-o", tmp_path / "k.yaml", "--force")
    assert status == 0
    assert "-> eucm" in out
    assert {camera.model.name for camera in load_rig(tmp_path / "k.yaml").cameras} == {"eucm"}


def test_a_rig_whose_error_is_too_large_is_not_written(run, tmp_path):
    source = save(back_to_back(), tmp_path / "rig.json").path
    status, _, err = run("convert", source, "--to", "kalibr", "--model", "pinhole", "-o", tmp_path / "k.yaml")
    assert status == 2
    assert "front: " in err
    assert not (tmp_path / "k.yaml").exists()


def test_the_proposed_angle_of_a_refused_conversion_is_accurate_for_all_cameras(run, tmp_path):
    lenses = {name: om.fisheye(size, 180) for name, size in (("small", 240), ("large", 960), ("middle", 480))}
    rig = om.Rig.from_sensors({name: (camera, om.Pose()) for name, camera in lenses.items()})
    source = save(rig, tmp_path / "rig.json").path
    command = (
        "convert",
        source,
        "--to",
        "native",
        "--model",
        "division",
        "--max-error",
        "0.5",
        "-o",
        tmp_path / "d.json",
    )
    status, _, err = run(*command)
    assert status == 2
    assert "omnisight: large: division cannot represent this equidistant camera to 127 degrees: " in err
    assert "0.5 allowed; likewise small, middle. Nothing was written; try --max-theta " in err
    angle = err.split("--max-theta ")[1].split(",")[0]
    assert run(*command, "--max-theta", angle)[0] == 0
    assert run(*command, "--max-theta", int(angle) + 2)[0] == 2


@pytest.mark.parametrize("format", ["opencv", "ros", "orb_slam3"])
def test_a_format_of_two_cameras_names_what_to_do_with_more(refuses, tmp_path, format):
    camera = om.Camera(om.models.model_class("pinhole").example(), (640, 480))
    rig = om.Rig.from_sensors({name: (camera, om.Pose(np.eye(3), [k, 0, 0])) for k, name in enumerate("abc")})
    source = save(rig, tmp_path / "rig.json").path
    err = refuses("convert", source, "--to", format, "-o", tmp_path / "c.yaml")
    assert "holds two cameras, and the rig has 3 (a, b, c): save two of them (rig.subset(['a', 'b'])" in err
    assert not (tmp_path / "c.yaml").exists()
    assert len(rig.subset(["a", "b"])) == 2


def test_convert_inverts_extrinsics(run, tmp_path):
    rig = surround_car()
    wrong = save(rig.inverted(), tmp_path / "wrong.json").path
    status, out, _ = run("convert", wrong, "--to", "native", "--invert-extrinsics", "-o", tmp_path / "right.json")
    assert status == 0
    assert "poses       inverted" in out
    for ours, theirs in zip(rig.sensor_from_rig, load_rig(tmp_path / "right.json").sensor_from_rig, strict=True):
        np.testing.assert_allclose(theirs.matrix, ours.matrix, atol=1e-12)


def test_invert_extrinsics_is_for_rigs(run, camera_file):
    status, _, err = run("convert", camera_file, "--to", "kalibr", "--invert-extrinsics")
    assert status == 2
    assert "--invert-extrinsics is for rigs" in err


def test_a_format_without_rigs_names_those_that_have_them(run, tmp_path):
    source = save(surround_car(), tmp_path / "rig.json").path
    status, _, err = run("convert", source, "--to", "hugin", "-o", tmp_path / "rig.pto")
    assert status == 2
    assert "holds no rigs" in err
    assert "--name" in err
    assert run("convert", source, "--to", "opencv", "--name", "left", "-o", tmp_path / "left.yml")[0] in (0, 2)


def test_convert_replaces_no_rig(refuses, tmp_path):
    rig = save(back_to_back(), tmp_path / "rig.json").path
    assert "is one of the inputs" in refuses("convert", rig, "--to", "native", "-o", rig)


def test_inspect_prints_poses_and_overlap(run, tmp_path):
    source = save(surround_car(), tmp_path / "rig.json").path
    status, out, err = run("inspect", source)
    assert (status, err) == (0, "")
    assert "== rig of 4 cameras" in out
    assert "overlap" in out
    assert "100 %" in out


def test_inspect_prints_the_standard_deviations_of_the_calibration(run, tmp_path):
    covariance = np.diag([0, 0, 0, 0, 0, 0, 1e-6, 4e-6, 4e-6, 1e-6, 4e-6, 4e-6])  # 3 mrad and 3 mm
    rig = dataclasses.replace(back_to_back(), covariance=covariance)
    assert rig.sigmas("back") == pytest.approx((0.003, 0.003))
    assert back_to_back().sigmas("back") is None
    out = run("inspect", save(rig, tmp_path / "rig.json").path)[1]
    row = next(line for line in out.splitlines() if line.startswith("  back "))
    assert "0.17 deg, 0.003" in row
    assert "-0.0000" not in out


def test_inspect_prints_the_poses_as_json(run, tmp_path):
    rig = surround_car()
    source = save(rig, tmp_path / "basalt.json", format="basalt", max_error=np.inf).path
    out = json.loads(run("inspect", source, "--json")[1])
    (tmp_path / "again.json").write_text(json.dumps(out))
    for ours, theirs in zip(rig.sensor_from_rig, load_rig(tmp_path / "again.json").sensor_from_rig, strict=True):
        np.testing.assert_allclose(theirs.matrix, ours.matrix, atol=1e-12)


def test_convert_advises_a_camera_only_of_a_file_that_has_cameras(refuses, tmp_path):
    (tmp_path / "board.yaml").write_text("target_type: 'aprilgrid'\ntagCols: 7\n")
    kalibr = save(surround_car(), tmp_path / "k.yaml", format="kalibr", max_error=np.inf).path
    for files in ([tmp_path / "board.yaml"], [tmp_path / "board.yaml", kalibr]):
        message = refuses("convert", *files, "--to", "native", "-o", tmp_path / "rig.json")
        assert "board.yaml: describes a board (--target), not a camera" in message
        assert "--name" not in message


def test_inspect_checks_the_extrinsics_by_images(run, data, tmp_path):
    folder = data("omnimvs_rig")
    rig = load_rig(folder / "config.yaml").subset([0, 1])
    images = [folder / "cam1_00001.jpg", folder / "cam2_00001.jpg"]
    status, out, _ = run("inspect", save(rig, tmp_path / "rig.json").path, "--images", *images)
    assert status == 0
    assert "verdict     CONSISTENT" in out
    wrong = save(rig.inverted(), tmp_path / "wrong.json").path
    status, out, _ = run("inspect", wrong, "--images", *images, "--json")
    assert json.loads(out)["verdict"] == "inverted"
    assert run("inspect", wrong, "--images", images[0])[0] == 2


def test_inspect_refuses_options_that_do_not_apply(refuses, tmp_path):
    rig = save(back_to_back(), tmp_path / "rig.json").path
    assert "rig.json holds front, back: specify one" in refuses("inspect", rig, "--svg", tmp_path / "curve.svg")
    for option in (("--name", "front"), ("--svg", tmp_path / "curve.svg")):
        images = "--images", tmp_path / "a.png", "--images", tmp_path / "b.png"
        assert "leave out --name and --svg" in refuses("inspect", rig, *option, *images)


def test_inspect_prints_why_the_poses_were_not_read(run, tmp_path):
    rig = surround_car().subset([0, 1])
    chain = save(rig, tmp_path / "k.yaml", format="kalibr").path
    chain.write_text("\n".join(line for line in chain.read_text().splitlines() if "T_cn" not in line))
    status, out, _ = run("inspect", chain)
    assert status == 0
    assert "poses not read" in out
    assert "neither T_cn_cnm1 nor T_cam_imu" in out
    assert set(json.loads(run("inspect", chain, "--json")[1])) == {"cam0", "cam1"}


def test_the_advice_names_the_option_of_the_file_with_several_cameras(refuses, tmp_path):
    rig, camera = save(back_to_back(480), tmp_path / "rig.json").path, tmp_path / "one.json"
    save(back_to_back(480).cameras[0], camera)
    image = tmp_path / "image.png"
    write_image(image, np.full((480, 480), 90, np.uint8))
    assert "specify one: --name front, in Python" in refuses("compare", rig, camera)
    assert "specify one: --other-name front, in Python" in refuses("compare", camera, rig)
    pair = "epipolar", image, image
    assert "specify one: --name front, in Python" in refuses(*pair, "--camera", rig)
    assert "specify one: --name-b front, in Python" in refuses(*pair, "--camera", camera, "--camera-b", rig)
    assert "specify one: in Python" in refuses("evaluate", camera, image, "--compare", rig)


def test_epipolar_reads_the_second_camera_of_another_file_without_the_name_of_the_first(refuses, tmp_path):
    rig, camera = save(back_to_back(480), tmp_path / "rig.json").path, tmp_path / "one.json"
    save(back_to_back(480).cameras[0], camera)
    image = tmp_path / "image.png"
    write_image(image, np.full((480, 480), 90, np.uint8))
    command = "epipolar", image, image, "--camera", rig, "--name", "front", "--camera-b", camera
    assert "the images are identical" in refuses(*command)
