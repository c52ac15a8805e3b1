"""omnisight birdseye, on rendered images of a car and on those of a real one."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

import omnisight as om
import rendered_car as car
from clips import write_clip
from jpegs import jpeg
from omnisight.images import Clip
from omnisight.simulation import BoardInScene, Renderer, Scene, Texture

SMALL = ("--pixel", "4cm", "--margin", "2m")


@pytest.fixture
def folder(tmp_path):
    car.write(tmp_path)
    return tmp_path


def arguments(folder, *names):
    files = [folder / f"{name}.png" for name in names or car.RIG.names]
    return "birdseye", *files, "--rig", folder / "rig.json", *SMALL


def test_a_view_is_written_and_reported(run, folder):
    status, out, err = run(*arguments(folder), "-o", folder / "top.png", "--json")
    assert status == 0, err
    data = json.loads(out)
    assert om.read_image(folder / "top.png").shape[1::-1] == tuple(data["size"])
    assert data["meters_per_pixel"] == 0.04
    assert [camera["name"] for camera in data["cameras"]] == list(car.RIG.names)
    assert all(0 < camera["ground_share"] < 1 for camera in data["cameras"])
    assert data["cameras"][0]["height_m"] == pytest.approx(0.65)
    assert data["length_errors_cm"] is None


def test_files_may_come_in_any_order(run, folder):
    for k, names in enumerate((car.RIG.names, car.RIG.names[::-1])):
        assert run(*arguments(folder, *names), "-o", folder / f"top{k}.png")[0] == 0
    np.testing.assert_array_equal(om.read_image(folder / "top0.png"), om.read_image(folder / "top1.png"))


def test_images_of_16_bits_have_the_gray_levels_of_8_bits_and_are_not_mixed_with_them(run, folder):
    def seams():
        return json.loads(run(*arguments(folder), "-o", folder / "top.png", "--json")[1])["seam_step"]

    expected = seams()
    for name, image in car.images().items():
        om.write_image(folder / f"{name}.png", image.astype(np.uint16) * 257)
    assert seams() == pytest.approx(expected, abs=0.1)
    om.write_image(folder / "front.png", car.images()["front"])
    status, _, err = run(*arguments(folder), "-o", folder / "mixed.png")
    assert status == 2
    assert "the images are of different types (front uint8, " in err
    assert not (folder / "mixed.png").exists()


def test_folders_name_the_cameras_of_images(run, folder):
    for name, image in car.images().items():
        (folder / name / "images").mkdir(parents=True)
        (folder / name / "depth").mkdir()
        for file in ("0001.png", "images/0001.png"):
            om.write_image(folder / name / file, image)
        om.write_image(folder / name / "vignette.png", np.full((360, 480), 255, np.uint8))
    rig = ("--rig", folder / "rig.json", *SMALL)
    expected = om.read_image(_view(run, arguments(folder), folder / "top.png"))
    images = [folder / name / "0001.png" for name in car.RIG.names]
    np.testing.assert_array_equal(om.read_image(_view(run, ("birdseye", *images, *rig), folder / "a.png")), expected)
    # Folders as omnisight simulate writes them: only those of the images are used.
    data_set = [folder / name for name in car.RIG.names]
    views = sorted(_view(run, ("birdseye", *data_set, *rig), folder / "views").iterdir())
    assert len(views) == 1
    np.testing.assert_array_equal(om.read_image(views[0]), expected)


def _view(run, given, output):
    """Run a command and return its output."""
    status, _, err = run(*given, "-o", output)
    assert status == 0, err
    return output


def test_exchanged_images_are_reported(run, folder):
    status, out, err = run(*arguments(folder), "-o", folder / "top.png", "--json")
    assert (status, json.loads(out)["warning"]) == (0, ""), err
    for name, other in (("front", "left"), ("left", "front")):
        om.write_image(folder / f"{name}.png", car.images()[other])
    status, out, err = run(*arguments(folder), "-o", folder / "top.png")
    assert status == 0
    assert "that of left is likely of front" in err
    assert "that of front is likely of left" in err
    assert "right" not in err


def test_one_camera(run, folder):
    camera, pose = car.RIG.cameras[0], car.RIG.sensor_from_rig[0]
    om.save(om.Rig.from_sensors({"front": (camera, pose)}), folder / "one.json")
    om.save(camera, folder / "camera.json")
    (folder / "front.png").rename(folder / "image.png")
    given = ("birdseye", folder / "image.png", *SMALL)
    views = []
    for extra in (("one.json",), ("camera.json", "--height", "0.65m", "--pitch", "-20")):
        output = _view(run, (*given, "--rig", folder / extra[0], *extra[1:]), folder / "top.png")
        views.append(om.read_image(output).astype(int))
    assert 0.3 < views[0].any(axis=2).mean() < 0.7
    np.testing.assert_allclose(views[1], views[0], atol=1)
    status, _, err = run(*given, "--rig", folder / "camera.json", "-o", folder / "top.png")
    assert status == 2
    assert "the height of the rig is unknown" in err


def test_images_are_rotated_by_their_orientation(run, folder):
    expected = om.read_image(_view(run, arguments(folder), folder / "top.png")).astype(int)
    for name, image in car.images().items():
        # EXIF orientation 6: rotated clockwise by 90 degrees for display.
        (folder / f"{name}.png").write_bytes(jpeg(np.rot90(image)[..., ::-1], 6))
    status, _, err = run(*arguments(folder), "-o", folder / "top.png")
    assert status == 2
    assert "--apply-exif" in err
    found = om.read_image(_view(run, (*arguments(folder), "--apply-exif"), folder / "top.png")).astype(int)
    assert np.abs(found - expected).mean() < 3


def test_a_layout_calibrates_the_rig_which_is_saved(run, tmp_path):
    car.write(tmp_path, "squares")
    layout = {"square": f"{car.SQUARE}m", "squares": car.LAYOUT.squares}
    (tmp_path / "cloth.json").write_text(json.dumps({"layout": layout}))
    given = arguments(tmp_path)
    ground = ("--ground", tmp_path / "cloth.json", "--save-rig", tmp_path / "car.json")
    status, out, err = run(*given, *ground, "-o", tmp_path / "top.png", "--json")
    assert status == 0, err
    data = json.loads(out)
    assert data["length_errors_cm"]["count"] > 100
    assert data["length_errors_cm"]["median"] < 0.5
    assert all(0 < camera["sigma_m"] < 0.01 for camera in data["cameras"])
    rig = om.load_rig(tmp_path / "car.json")
    assert rig.covariance is not None
    for found, true in zip(rig.sensor_from_rig, car.RIG.sensor_from_rig, strict=True):
        np.testing.assert_allclose(found.inverse().translation, true.inverse().translation, atol=0.01)
    again = (*given[:5], "--rig", tmp_path / "car.json", *SMALL)
    status, _, err = run(*again, "--height", "1m", "-o", tmp_path / "top.png")
    assert status == 2
    assert "on the ground already" in err
    status, out, _ = run(*given, *ground, "-o", tmp_path / "top.png")
    assert status == 0
    assert "rms px" in out
    assert "median error" in out


def test_clips_and_folders_give_one_view_per_frame(run, refuses, folder):
    clips = []
    (folder / "slow").mkdir()
    for name, image in car.images().items():
        clips.append(folder / f"{name}.mp4")
        (folder / name).mkdir()
        write_clip(clips[-1], [image] * 3, "mp4v", 10)
        for k in range(3):
            om.write_image(folder / name / f"{k}.png", image)
    rig = ("--rig", folder / "rig.json", *SMALL)
    assert run("birdseye", *clips, *rig, "-o", folder / "top.mp4")[0] == 0
    clip = Clip.open(folder / "top.mp4")
    assert len(list(clip.frames())) == 3
    assert clip.frame_rate == pytest.approx(10)
    write_clip(folder / "slow" / clips[3].name, [image] * 3, "mp4v", 8)
    status, _, err = run("birdseye", *clips[:3], folder / "slow" / clips[3].name, *rig, "-o", folder / "slow.mp4")
    assert status == 2
    assert "10 frames per second" in err
    assert not (folder / "slow.mp4").exists()
    mixed = [*clips[:3], folder / f"{car.RIG.names[3]}.png"]
    status, _, err = run("birdseye", *mixed, *rig, "-o", folder / "mixed.mp4")
    assert status == 2
    assert "is one image, others are clips" in err
    folders = [folder / name for name in car.RIG.names]
    assert run("birdseye", *folders, *rig, "-o", folder / "top")[0] == 0
    views = sorted((folder / "top").iterdir())
    assert len(views) == 3
    assert "front: contains the images" in refuses("birdseye", *folders, *rig, "-o", folder / "front")
    assert len(list((folder / "front").iterdir())) == 3
    (folder / "left" / "2.png").unlink()
    assert "different numbers of images" in refuses("birdseye", *folders, *rig, "-o", folder / "top")


def test_masks_and_vehicles(run, folder):
    (folder / "masks").mkdir()
    black = np.zeros((360, 480), np.uint8)
    black[180:] = 255
    om.write_image(folder / "masks" / "front.png", black)
    given = arguments(folder)
    shares = []
    for extra in ((), ("--masks", folder / "masks"), ("--vehicle", "none"), ("--vehicle", "6mx3m")):
        status, out, err = run(*given, *extra, "-o", folder / "top.png", "--json")
        assert status == 0, err
        shares.append(sum(camera["ground_share"] for camera in json.loads(out)["cameras"]))
    assert shares[2] > shares[0] > shares[3]
    for extra, message in (
        (("--vehicle", "4.5x1.8"), "LENGTHxWIDTH with units"),
        (("--vehicle", "100mx100m"), "the vehicle covers the whole view of front"),
        (("--vehicle", folder / "front.png"), "must have the size of the image or view that it masks, 150 x 211 px"),
        (("--masks", folder / "nowhere"), "is no folder"),
    ):
        status, _, err = run(*given, *extra, "-o", folder / "top.png")
        assert status == 2
        assert message in err


def test_invalid_input(run, folder):
    front, rest = folder / "front.png", [folder / f"{name}.png" for name in ("right", "back", "left")]
    rig, output = ("--rig", folder / "rig.json"), ("-o", folder / "top.png")
    om.write_image(folder / "roof.png", car.images()["left"])
    (folder / "empty.json").write_text("{}")
    (folder / "few.json").write_text(json.dumps({"marks": {"front": [{"pixel": [1, 2], "ground": [1, 2]}]}}))
    (folder / "bad.json").write_text(json.dumps({"marks": {"front": [{"pixel": [1, 2]}]}}))
    cases = (
        ((front, *rest[:2], *rig, *output), "no image of camera left"),
        ((front, folder / "roof.png", *rig, *output), "belongs to none of the cameras"),
        ((front, front, *rest, *rig, *output), "both of camera front"),
        ((front, *rest, *rig, "-o", front), "would be overwritten"),
        ((front, *rest, *rig, "-o", folder / "top.mp4"), "an image"),
        ((front, *rest, *rig, "-o", folder / "top.gif"), "cannot write extension '.gif'"),
        ((front, *rest, *rig, *output, "--save-rig", folder / "rig.txt"), "rig.txt: .txt is the suffix of"),
        ((front, *rest, *rig, *output, "--ground", folder / "empty.json"), 'neither "marks"'),
        (
            (front, *rest, *rig, *output, "--ground", folder / "few.json"),
            "front: marks on the ground: 1 found, 4 needed",
        ),
        ((front, *rest, *rig, *output, "--ground", folder / "bad.json"), "marks must be"),
        ((front, *rest, *rig, *output, "--ground", folder / "none.json"), "no such file or folder"),
        ((front, *rest, *rig, *output, "--pixel", "1um"), "px per side"),
        ((front, *rest, *rig, *output, "--pixel", "20m"), "for 2 to 16384 px per side"),
        ((front, *rest, *rig, *output, "--pixel", "2"), "no unit"),
        ((front, *rest, *rig, *output, "--ground-board", front, "--square", "30mm"), "no board was detected"),
    )
    for given, message in cases:
        status, out, err = run("birdseye", *given)
        assert status == 2, (message, err)
        assert message in err
        assert "Traceback" not in out + err


def test_files_of_options_are_not_replaced(refuses, folder):
    (folder / "masks").mkdir()
    for file in (folder / "car.png", folder / "masks" / "front.png"):
        om.write_image(file, np.zeros((9, 9), np.uint8))
    for option, value, output in (
        ("--vehicle", folder / "car.png", folder / "car.png"),
        ("--ground-board", folder / "car.png", folder / "car.png"),
        ("--masks", folder / "masks", folder / "masks" / "front.png"),
    ):
        assert "is one of the inputs" in refuses(*arguments(folder), option, value, "-o", output), option


def test_a_board_on_the_ground_determines_the_height(run, folder):
    camera, cam_from_ground = car.RIG.cameras[0], car.RIG.sensor_from_rig[0]
    # The board's x is right, its y backward, its z down.
    ground_from_board = om.Pose(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([-0.8, 0.0, 4.6]))
    board = BoardInScene(om.Checkerboard.parse("8x6", square="200mm"), cam_from_ground @ ground_from_board)
    scene = Scene((), sky=Texture.plain((110, 110, 110)))
    for name in ("board", "half"):
        (folder / name).mkdir()
    image = folder / "board" / "front.png"
    om.write_image(image, Renderer(camera, cam_from_ground.inverse(), scene, samples=2)([board]).image)
    tilt = om.Pose(om.look(3.0, 4.0, 2.0)) @ om.Pose(translation=np.array([0.0, 0.3, 0.1]))
    poses = tuple(pose @ tilt.inverse() for pose in car.RIG.sensor_from_rig)
    om.save(dataclasses.replace(car.RIG, sensor_from_rig=poses), folder / "rig.json")
    given = ("--ground-board", image, "--pattern", "8x6", "-o", folder / "top.png", "--json")
    status, out, err = run(*arguments(folder), *given, "--square", "200mm")
    assert status == 0, err
    for found, true in zip(json.loads(out)["cameras"], car.RIG.sensor_from_rig, strict=True):
        assert found["height_m"] == pytest.approx(-true.inverse().translation[1], abs=0.01)
    status, _, err = run(*arguments(folder), *given)
    assert status == 2
    assert "--square" in err
    (folder / "board.json").write_text('{"target": "checkerboard", "columns": 8, "rows": 6}')
    unknown = ("--ground-board", image, "--target", folder / "board.json", "-o", folder / "top.png")
    status, _, err = run(*arguments(folder), *unknown)
    assert status == 2
    assert "the size of the board is unknown" in err
    om.write_image(folder / "half" / "front.png", om.read_image(image)[::2, ::2])
    resized = ("--ground-board", folder / "half" / "front.png", *given[2:])
    status, _, err = run(*arguments(folder), *resized, "--square", "200mm")
    assert status == 2
    assert "half/front.png: the image is" in err.replace("\\", "/")
    image.write_bytes(jpeg(np.rot90(om.read_image(image))[..., ::-1], 6))
    status, out, err = run(*arguments(folder), *given, "--square", "200mm", "--apply-exif")
    assert status == 0, err
    assert json.loads(out)["cameras"][0]["height_m"] == pytest.approx(0.65, abs=0.01)


def car_cloth():
    """Return the squares of the cloth of surround_view_car: 15 x 25, with circles in the middle of each side."""

    def square(i, j):
        is_ring = i < 5 or i >= 20 or j < 5 or j >= 10
        has_circle = ((i < 4 or i >= 21) and 5 <= j < 9) or ((j < 4 or j >= 11) and 8 <= i < 18)
        return "#."[(i + j) % 2] if is_ring and not has_circle else " "

    return ["".join(square(i, j) for j in range(15)) for i in range(25)]


def maker_marks(path, name):
    """Return the camera and rough marks of the maker's top view: 1 px is 1 cm, the cloth starts at (300, 300)."""
    node = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ).getNode
    k, d, h = node("camera_matrix").mat(), node("dist_coeffs").mat().ravel(), node("project_matrix").mat()
    scale, shift = node("scale_xy").mat().ravel(), node("shift_xy").mat().ravel()
    long, wide = (600, 1000) if name in ("front", "back") else (1000, 600)
    top = np.stack(np.meshgrid(np.arange(380.0, 220 + long, 40), np.arange(300.0, 500, 40)), -1).reshape(1, -1, 2)
    undistorted = cv2.perspectiveTransform(top, np.linalg.inv(h))[0]
    focal, centre = np.diag(k)[:2] * scale, k[:2, 2] + shift
    pixels = cv2.fisheye.distortPoints(((undistorted - centre) / focal)[None], k, d)[0]
    x, y = (top[0] / 100 - 3 - np.array([long, wide]) / 200).T
    ground = {"front": (x, -y), "back": (-x, y), "left": (y, x), "right": (-y, -x)}[name]
    use = ((pixels > 5) & (pixels < [955, 635])).all(1)
    places = zip(pixels[use].tolist(), np.stack(ground, -1)[use].tolist(), strict=True)
    marks = [{"pixel": pixel, "ground": place} for pixel, place in places]
    lens = om.model_class("kannala_brandt")(k[0, 0], k[1, 1], k[0, 2], k[1, 2], *d)
    return om.Camera(lens, (960, 640)), marks


def test_a_real_car_is_calibrated_from_its_cloth(run, tmp_path, data):
    folder = data("surround_view_car")
    names = ("front", "back", "left", "right")
    found = {name: maker_marks(folder / f"{name}.yaml", name) for name in names}
    om.save(
        om.Rig.from_sensors({name: (camera, om.Pose()) for name, (camera, _) in found.items()}), tmp_path / "rig.json"
    )
    marks = {name: seen for name, (_, seen) in found.items()}
    cloth = {"marks": marks, "layout": {"square": "40cm", "squares": car_cloth()}}
    (tmp_path / "cloth.json").write_text(json.dumps(cloth))
    files = [folder / f"{name}.png" for name in names]
    given = ("--rig", tmp_path / "rig.json", "--ground", tmp_path / "cloth.json", "-o", tmp_path / "top.png", "--json")
    status, out, err = run("birdseye", *files, *given)
    assert status == 0, err
    result = json.loads(out)
    assert result["length_errors_cm"]["median"] < 1.2
    assert result["length_errors_cm"]["count"] > 5000
    for camera in result["cameras"]:
        assert camera["marks"] > 30
        assert camera["rms_px"] < 0.8
        assert 0.5 < camera["height_m"] < 1.2
        assert camera["sigma_m"] < 0.01
    view = om.read_image(tmp_path / "top.png")
    assert view.shape[1::-1] == tuple(result["size"])
    assert np.mean(view.any(axis=2)) > 0.8
