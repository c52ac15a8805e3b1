"""`omnisight stitch` and `om.stitch`, against the sphere that the renderer sees from the origin of the rig."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

import omnisight as om
from jpegs import jpeg
from omnisight.cli import main
from omnisight.geometry.rotation import look
from omnisight.images import Clip
from omnisight.images.gpano import read_gpano
from omnisight.images.video_writer import VideoWriter
from omnisight.simulation import Renderer
from omnisight.simulation.example_rigs import back_to_back

WIDTH = 512


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    """Return a folder with a rig, both images and the truth."""
    folder = tmp_path_factory.mktemp("head")
    rig = back_to_back(480, 0.03)
    pose = om.Pose(look(yaw=35).T, np.array([0.2, -0.1, 0.1]))
    for k, camera in enumerate(rig.cameras):
        at = pose @ rig.sensor_from_rig[k].inverse()
        renderer = Renderer(camera, at, theta=(0.0, camera.theta_max), samples=1)
        om.write_image(folder / f"{rig.names[k]}.png", renderer(exposure=0.4 * k).image)
    om.save(rig, folder / "rig.json")
    truth = Renderer(om.sphere(WIDTH), pose)(noise=0.0, blur=0.0).image
    om.write_image(folder / "truth.png", truth)
    return folder


def run(capsys, *arguments):
    status = 0
    try:
        status = main([str(a) for a in arguments]) or 0
    except SystemExit as error:
        status = error.code or 0
    out = capsys.readouterr()
    return status, out.out, out.err


def difference(image, truth):
    """Return the rms difference of grey levels after a common gain."""
    a, b = image.astype(float).mean(-1), truth.astype(float).mean(-1)
    return float(np.sqrt(np.mean((a * (a * b).sum() / (a * a).sum() - b) ** 2)))


def test_a_saved_head_gives_the_same_sphere_and_its_order_is_checked(head, capsys, tmp_path):
    images, size, saved = (head / "front.png", head / "back.png"), ("--width", WIDTH), tmp_path / "saved.json"
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    status, _, err = run(capsys, "stitch", *images, "-o", first, *size, "--save-rig", saved)
    assert status == 0, err
    status, _, err = run(capsys, "stitch", *images, "--rig", saved, "-o", again, *size)
    assert status == 0, err
    assert difference(om.read_image(again), om.read_image(first)) < 6
    status, _, err = run(capsys, "stitch", *images[::-1], "--rig", saved, "-o", again, *size)
    assert status == 2
    assert "the images are in the order back, front, and the cameras of the rig in the order front, back" in err


def test_images_are_rotated_by_their_orientation(head, capsys, tmp_path):
    # One folder, whose images are named after the cameras of the rig file.
    rig = om.load_rig(head / "rig.json")
    om.save(dataclasses.replace(rig, names=("near", "far")), tmp_path / "rig.json")
    (tmp_path / "images").mkdir()
    for name, of_rig in zip(("near", "far"), rig.names, strict=True):
        for k in range(2):
            # EXIF orientation 6: rotated clockwise by 90 degrees for display.
            stored = jpeg(np.rot90(om.read_image(head / f"{of_rig}.png"))[..., ::-1], 6)
            (tmp_path / "images" / f"{name}_{k}.jpg").write_bytes(stored)
    given = ("stitch", tmp_path / "images", "--rig", tmp_path / "rig.json", "--width", WIDTH, "--apply-exif")
    status, _, err = run(capsys, *given, "-o", tmp_path / "spheres")
    assert status == 0, err
    spheres = sorted((tmp_path / "spheres").iterdir())
    assert len(spheres) == 2
    assert difference(om.read_image(spheres[0]), om.read_image(head / "truth.png")) < 12
    status, _, err = run(capsys, *given, "-o", tmp_path / "batch", "--workers", 1)
    assert status == 0, err
    written = sorted((tmp_path / "batch").glob("*.jpg"))
    assert len(written) == 2
    assert difference(om.read_image(written[0]), om.read_image(spheres[0])) < 2


def frames(head, folder):
    """Write two frames of the head with their images side by side, and return the arguments."""
    folder.mkdir()
    for name in ("front", "back"):
        for k in range(2):
            om.write_image(folder / f"{name}_{k}.jpg", om.read_image(head / f"{name}.png"))
    return ("stitch", folder, "--rig", head / "rig.json", "--width", 256)


def test_spheres_do_not_replace_the_images(head, capsys, tmp_path):
    command = frames(head, tmp_path / "images")
    before = {path: path.read_bytes() for path in (tmp_path / "images").iterdir()}
    status, _, err = run(capsys, *command, "-o", tmp_path / "images")
    assert status == 2
    assert "front_0.jpg: is one of the inputs" in err
    assert before == {path: path.read_bytes() for path in (tmp_path / "images").iterdir()}


@pytest.mark.parametrize("workers", [(), ("--workers", 1)])
def test_spheres_are_not_mixed_with_the_images(head, capsys, tmp_path, workers):
    """Spheres are JPEG files, and the images here PNG files: none would be overwritten."""
    folder = tmp_path / "images"
    command = frames(head, folder)
    for path in list(folder.iterdir()):
        om.write_image(path.with_suffix(".png"), om.read_image(path))
        path.unlink()
    images = (*command[:1], f"{folder}/*.png", *command[2:]) if workers else command
    status, _, err = run(capsys, *images, "-o", folder, *workers)
    assert status == 2
    assert ("is in the folder of the images" if workers else "contains the images") in err
    assert not list(folder.glob("*.jpg"))


def test_an_image_of_another_size_in_a_folder_is_named(head, capsys, tmp_path):
    command = frames(head, tmp_path / "images")
    om.write_image(tmp_path / "images" / "back_1.jpg", om.read_image(head / "back.png")[::2, ::2])
    status, _, err = run(capsys, *command, "-o", tmp_path / "spheres")
    assert status == 2
    assert "back_1.jpg: the image is 240x240, the camera 480x480" in err
    _, said, err = run(capsys, *command, "-o", tmp_path / "batch", "--workers", 1)
    assert "the image is 240x240, the camera 480x480" in said + err


def test_images_of_16_bits_keep_their_colours(head):
    rig = om.load_rig(head / "rig.json")
    images = [om.read_image(head / f"{name}.png") for name in rig.names]
    options = om.StitchOptions(width=256, at="inf", warp=False)
    wide = [image.astype(np.uint16) << 8 for image in images]
    assert np.array_equal(om.stitch(wide, rig, options).image, om.stitch(images, rig, options).image)


def test_the_horizon_is_level_only_with_a_vertical(head, tmp_path):
    rig = om.load_rig(head / "rig.json")
    noise = np.random.default_rng(0)
    blurred = [cv2.GaussianBlur(noise.integers(0, 255, (480, 480, 3), np.uint8), (0, 0), 9) for _ in rig.names]
    options = om.StitchOptions(width=256, at="inf", level=True)
    result = om.stitch(blurred, rig, options, output=tmp_path / "sphere.jpg")
    assert result.vertical.reason
    assert "PosePitchDegrees" not in read_gpano((tmp_path / "sphere.jpg").read_bytes())


def test_a_head_with_its_rig_gives_the_true_sphere(head, capsys, tmp_path):
    output = tmp_path / "sphere.jpg"
    images = head / "front.png", head / "back.png"
    arguments = (*images, "--rig", head / "rig.json", "-o", output, "--width", WIDTH, "--json")
    status, out, err = run(capsys, "stitch", *arguments)
    assert status == 0, err
    data = json.loads(out)
    truth = om.read_image(head / "truth.png")
    image = om.read_image(output)
    assert image.shape == truth.shape
    raw = om.remap(om.read_image(images[0]), om.load_rig(head / "rig.json").cameras[0], om.sphere(WIDTH))
    assert difference(image, truth) < 0.5 * difference(raw, truth)
    assert difference(image, truth) < 14
    assert data["covered"] == 1.0
    assert data["seam_disparity_deg"] < data["seam_disparity_before_warp_deg"]
    assert data["seam_disparity_deg"] < 0.3
    assert data["photometric_step"] < 6
    assert len(data["rotation_xyzw"]) == 2
    assert read_gpano(output.read_bytes())["FullPanoWidthPixels"] == str(WIDTH)


def test_the_library_estimates_a_distance_and_takes_arrays(head):
    rig = om.load_rig(head / "rig.json")
    images = [om.read_image(head / f"{name}.png") for name in rig.names]
    copies = [image.copy() for image in images]
    found = om.stitch(images, rig, om.StitchOptions(width=256, warp=False))
    assert all(np.array_equal(a, b) for a, b in zip(images, copies, strict=True))
    far = om.stitch(images, rig, om.StitchOptions(width=256, warp=False, at="inf"))
    assert 0.5 < found.distance < 5  # the walls of the room are 1 to 4 m away
    assert found.seams[0].disparity_deg < far.seams[0].disparity_deg


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("front.png",), "240x480"),
        (("front.png", "front.png"), "identical"),
        (("front.png", "missing.png"), "no such file"),
        (("front.png", "truth.png"), "512x256"),
        (("front.png", "back.png", "--width", "100"), "multiple of 16"),
        (("front.png", "back.png", "--mask", "truth.png"), "1 masks and 2 cameras"),
        (("front.png", "back.png", "--mask", "truth.png", "--mask", "truth.png"), "is 512 x 256 px"),
        (("front.png", "back.png", "--at", "3"), "no unit"),
        (("front.png", "back.png", "--save-rig", "rig.xyz"), ".xyz"),
    ],
)
def test_invalid_input_is_explained(head, capsys, tmp_path, change, message):
    arguments = [str(head / item) if item.endswith(".png") else item for item in change]
    last = "sphere.jpg"
    status, _, err = run(capsys, "stitch", *arguments, "--rig", head / "rig.json", "-o", tmp_path / last)
    assert status != 0
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / last).exists()


def test_metres_need_a_rig_in_metres(head):
    rig = dataclasses.replace(om.load_rig(head / "rig.json"), unit="squares")
    images = [om.read_image(head / f"{name}.png") for name in rig.names]
    with pytest.raises(ValueError, match="--at 3m: the lengths of the rig are in squares"):
        om.stitch(images, rig, om.StitchOptions(width=256, at="3m"))
    with pytest.raises(ValueError, match="--at 3m: without a rig"):
        om.stitch(images, None, om.StitchOptions(width=256, at="3m"))


def test_the_rig_is_not_replaced_by_the_estimated_one(head, capsys, tmp_path):
    images, rig = [head / f"{name}.png" for name in ("front", "back")], tmp_path / "rig.json"
    rig.write_bytes((head / "rig.json").read_bytes())
    status, _, err = run(capsys, "stitch", *images, "--rig", rig, "--save-rig", rig, "-o", tmp_path / "sphere.jpg")
    assert status == 2
    assert "rig.json: is one of the inputs" in err
    assert rig.read_bytes() == (head / "rig.json").read_bytes()


def test_lenses_that_were_given_have_no_sigma(head, capsys, tmp_path):
    images, cameras = [head / f"{name}.png" for name in ("front", "back")], list[object]()
    for k, camera in enumerate(om.load_rig(head / "rig.json").cameras):
        om.save(camera, tmp_path / f"{k}.json")
        cameras += ["--camera", tmp_path / f"{k}.json"]
    command = "stitch", *images, *cameras, "--width", 256, "-o", tmp_path / "sphere.jpg"
    status, out, _ = run(capsys, *command, "--json")
    assert status == 0
    assert json.loads(out)["lens_sigmas"] == []
    assert "focal length" not in run(capsys, *command)[1]


def test_cameras_without_overlap_state_the_missing_angle(head):
    rig = back_to_back(480, 0.03)
    narrow = tuple(om.Camera(camera.model, camera.size, theta_max=float(np.radians(80.0))) for camera in rig.cameras)
    images = [om.read_image(head / f"{name}.png") for name in rig.names]
    with pytest.raises(ValueError, match=r"no overlap with 1: their fields of view are (19|20|21)\.\d° apart"):
        om.stitch(images, om.Rig(narrow, rig.sensor_from_rig, rig.names), om.StitchOptions(width=256, at="inf"))


def test_an_image_without_two_circles_needs_a_rig(head, capsys, tmp_path):
    status, _, err = run(capsys, "stitch", head / "truth.png", "-o", tmp_path / "sphere.jpg")
    assert status != 0
    assert "truth.png: no two image circles" in err


def test_a_head_is_calibrated_by_its_overlap(head):
    images = [om.read_image(head / f"{name}.png") for name in ("front", "back")]
    found = om.stitch(np.hstack(images), None, om.StitchOptions(width=256))
    assert found.head is not None
    # Half a turn about the vertical; the parallax of the room is not modelled.
    turn = found.rig.sensor_from_rig[1].rotation @ np.diag([-1.0, 1.0, -1.0])
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 1.5
    rim = [np.degrees(camera.angle_of([camera.model.cx + 235.0, camera.model.cy])) for camera in found.rig.cameras]
    assert np.mean(rim) == pytest.approx(100.0, abs=3.0)


def test_a_stitched_clip_equals_the_stitched_images_and_has_the_tags_of_a_sphere(head, capsys, tmp_path):
    images = [om.read_image(head / f"{name}.png") for name in ("front", "back")]
    with VideoWriter(tmp_path / "dual.mp4", (960, 480), 25.0, om.VideoOptions(crf=5)) as writer:
        for k in range(3):
            writer.write(np.hstack(images), k / 25)
    rig, output = om.load_rig(head / "rig.json"), tmp_path / "sphere.mp4"
    options = om.StitchOptions(width=WIDTH)
    result = om.stitch(tmp_path / "dual.mp4", rig, options, output=output, video=om.VideoOptions(crf=5))
    expected = om.stitch(images, rig, options).image.astype(float)
    frames = list(Clip.open(output).frames())
    assert (len(frames), result.frames, Clip.open(output).size) == (3, 3, (WIDTH, WIDTH // 2))
    assert [frame.seconds for frame in frames] == pytest.approx([0, 0.04, 0.08], abs=1e-3)
    assert 10 * np.log10(255**2 / np.mean((frames[2].image - expected) ** 2)) > 32
    assert all(tag in output.read_bytes() for tag in (b"sv3d", b"GSpherical"))
    status, _, err = run(capsys, "stitch", tmp_path / "dual.mp4", "--rig", head / "rig.json", "-o", tmp_path / "a.xyz")
    assert status == 2
    assert "a.xyz: cannot write .xyz files" in err
    with VideoWriter(tmp_path / "other.mp4", (480, 480), 30.0, om.VideoOptions(crf=5)) as writer:
        writer.write(images[0], 0.0)
        writer.write(images[0], 1 / 30)
    clips = [tmp_path / name for name in ("dual.mp4", "other.mp4")]
    status, _, err = run(capsys, "stitch", *clips, "--rig", head / "rig.json", "-o", tmp_path / "b.mp4")
    assert status == 2
    assert "30 frames per second and" in err
