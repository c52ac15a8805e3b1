"""omnisight calibrate-rig: files, names, output."""

import json

import numpy as np
import pytest

import omnisight as om
from clips import rendered_clip, write_clip
from omnisight.geometry import rotation as so3
from omnisight.pipeline.detection.detect import source_paths
from omnisight.pipeline.rig_calibration.rig_sources import named_sources, with_common_frames
from omnisight.pipeline.rig_calibration.simultaneous_views import read_times, simultaneous_views
from omnisight.progress import no_progress
from pace import assert_quick

KEYS = ("cameras", "sensor_from_rig", "pairs", "rms", "verdict", "reasons", "seconds")


@pytest.mark.parametrize(
    ("items", "names"),
    [
        (["front/", "back/"], ["front", "back"]),
        (["a/left*.jpg", "a/right*.jpg"], ["left", "right"]),
        (["cam0.mp4", "cam1.mp4"], ["cam0", "cam1"]),
        (["top=x/*.png", "down=y/*.png"], ["top", "down"]),
        (["rig/left_[0-9].png", "rig/right_?.png"], ["left", "right"]),
    ],
)
def test_folders_clips_and_patterns_name_the_cameras(items, names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("front", "back"):
        (tmp_path / folder).mkdir()
    assert list(named_sources(items)) == names


@pytest.mark.parametrize(
    ("items", "names"),
    [
        (["mav0"], ["cam0", "cam1"]),
        (["."], ["cam0", "cam1"]),
        (["mav0/cam0", "mav0/cam1"], ["cam0", "cam1"]),
        (["mav0/cam0/data", "mav0/cam1/data"], ["cam0", "cam1"]),
        (["mav0/cam0/data/*.png", "mav0/cam1/data/*.png"], ["cam0", "cam1"]),
        (["left=mav0/cam0/data", "mav0/cam1/data"], ["left", "data"]),
        (["clips"], ["port_0", "port_1"]),
        (["simulated"], ["front", "back"]),
    ],
)
def test_sub_folders_and_clips_of_a_recording_are_cameras(items, names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    truth = ("images", "depth")
    files = [f"mav0/cam{k}/data/{stamp}.png" for k in (0, 1) for stamp in (1, 2)]
    files += [f"clips/port_{k}.mp4" for k in (0, 1)] if items == ["clips"] else []
    files += (
        [f"simulated/{name}/{kind}/0.png" for name in ("back", "front") for kind in truth] if items != ["."] else []
    )
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert sorted(named_sources(items)) == sorted(names)


@pytest.mark.parametrize(
    ("files", "names"),
    [
        ([f"{side}{k}.jpg" for side in ("left", "right") for k in range(1, 5)], ["left", "right"]),
        ([f"cam{c}_{k:03d}.png" for c in (0, 1, 2) for k in range(4)], ["cam0", "cam1", "cam2"]),
        ([f"frame{k}-{side}.png" for side in ("a", "b") for k in range(3)], ["frame-a", "frame-b"]),
    ],
)
def test_names_of_images_in_one_folder_divide_them_by_camera(files, names, tmp_path):
    folder = tmp_path / "all [1]"
    folder.mkdir()
    for file in files:
        (folder / file).touch()
    sources = named_sources([folder])
    assert list(sources) == names
    assert sum(len(source_paths([source])) for source in sources.values()) == len(files)


@pytest.mark.parametrize("first", [1, 50])
def test_numbered_images_of_one_camera_are_no_rig(first, tmp_path):
    for name in [f"IMG_{k}.jpg" for k in range(8)] + [f"DSC_{k + first}.jpg" for k in range(8) if first > 8]:
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match="1 camera, and a rig has at least two"):
        named_sources([tmp_path])


def test_a_single_source_that_is_missing_or_of_one_camera_is_refused(tmp_path):
    (tmp_path / "run=1").mkdir()
    (tmp_path / "run=1" / "a.png").touch()
    with pytest.raises(FileNotFoundError, match="mav1: no such file or folder"):
        named_sources([str(tmp_path / "mav1")])
    for item in (str(tmp_path / "run=1"), "left=images"):
        with pytest.raises(ValueError, match=r"1 camera, and a rig has at least two: .*, or a folder with a sub-f"):
            named_sources([item])


def test_two_cameras_of_one_name_are_refused(tmp_path):
    (tmp_path / "cam").mkdir()
    with pytest.raises(ValueError, match=r"two cameras are named cam: specify names, such as cam2="):
        named_sources([str(tmp_path / "cam"), str(tmp_path / "cam")])


def test_patterns_that_the_shell_has_expanded_are_refused(tmp_path):
    for name in ("left1.jpg", "left2.jpg"):
        om.write_image(tmp_path / name, np.zeros((8, 8), np.uint8))
    with pytest.raises(ValueError, match=r"left1.jpg: one image; specify a folder, a clip or a pattern in quotes"):
        named_sources([str(tmp_path / "left1.jpg"), str(tmp_path / "left2.jpg")])


@pytest.mark.parametrize(
    ("left", "right", "rule", "shared"),
    [
        (("0001.png", "0002.png"), ("0002.png", "0003.png"), "name", 1),
        (("left1.jpg", "left2.jpg"), ("right1.jpg", "right2.jpg"), "name", 2),
        (("IMG_7.jpg", "IMG_9.jpg"), ("DSC_9.jpg", "DSC_8.jpg"), "number", 1),
        (("a.jpg", "b.jpg"), ("c.jpg", "d.jpg"), "order", 2),
    ],
)
def test_simultaneous_images_share_a_name_a_number_or_a_place(left, right, rule, shared):
    found = simultaneous_views({"left": left, "right": right})
    assert found.rule == rule
    assert len(set(found.frame[0].values()) & set(found.frame[1].values())) == shared


def test_times_of_caliscope_number_the_frames_of_each_clip_by_their_times(tmp_path):
    lines = ["sync_index,port,frame_index,frame_time", "0,0,7,10.5", "0,1,3,10.52", "1,1,5,10.61", "1,0,9,10.6"]
    (tmp_path / "frame_time_history.csv").write_text("\n".join(lines))
    times = read_times(tmp_path / "frame_time_history.csv")
    assert times == {"port_0": {"0": 10.5, "1": 10.6}, "port_1": {"0": 10.52, "1": 10.61}}


def test_times_assign_the_nearest_image_within_half_an_interval(tmp_path):
    lines = ["camera,frame,seconds", "l,a.png,0.0", "l,b.png,0.1", "l,c.png,0.2", "r,x,0.04", "r,y,0.19", "r,z,0.5"]
    (tmp_path / "times.csv").write_text("\n".join(lines))
    times = read_times(tmp_path / "times.csv")
    found = simultaneous_views({"l": ("a.png", "b.png", "c.png"), "r": ("x.png", "y.png", "z.png")}, times)
    assert found.rule == "time"
    frames, delays = found.of_views(1, ("x.png", "y.png", "z.png #2"))
    assert [found.names[f] for f in frames] == ["a.png", "c.png", "z.png"]
    assert delays == pytest.approx([0.04, -0.01, 0.0])
    with pytest.raises(ValueError, match=r"no time for w.png of the camera r: add a line r,w.png,SECONDS"):
        simultaneous_views({"l": ("a.png",), "r": ("w.png",)}, times)


def test_times_of_frames_are_given_by_their_numbers():
    times = {"a": {"0": 0.0, "1": 0.1}, "b": {"7": 0.1, "8": 0.2}}
    found = simultaneous_views({"a": ("a-000000.png", "a-000001.png"), "b": ("b-000007.png", "b-000008.png")}, times)
    assert found.rule == "time"
    assert found.frame[0]["a-000001.png"] == found.frame[1]["b-000007.png"]
    with pytest.raises(ValueError, match=r"no time for a-000002.png .*, or one with the number of the image or frame"):
        simultaneous_views({"a": ("a-000002.png",), "b": ("b-000007.png",)}, times)


def test_times_of_long_clips_are_found_quickly():
    times = {name: {str(k): k / 30 for k in range(20_000)} for name in ("a", "b")}
    images = {name: [f"{name}-{k:06d}.png" for k in range(0, 20_000, 50)] for name in times}
    assert_quick(lambda: simultaneous_views(images, times), 30)


def test_frames_of_clips_that_start_at_different_times_are_those_of_the_same_times(tmp_path):
    images, _ = rendered_clip()
    start, rate = 20, 24
    clips = {"a": write_clip(tmp_path / "a.avi", images), "b": write_clip(tmp_path / "b.avi", images[start:])}
    rows = [f"{name},{k - (start if name == 'b' else 0)},{k / rate}" for name in clips for k in range(len(images))]
    (tmp_path / "times.csv").write_text("\n".join(["camera,frame,seconds", *(row for row in rows if ",-" not in row)]))
    options = om.CalibrateRigOptions(pattern="9x6", times=tmp_path / "times.csv")
    frames = with_common_frames(clips, options, no_progress)
    a, b = ({int(path.stem[-6:]) for path in frames[name]} for name in clips)
    assert len(b) > 4
    assert {k for k in a if k >= start} == {k + start for k in b}


def test_a_file_of_times_is_read_before_the_boards_are_detected(refuses, tmp_path):
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.png").write_bytes(b"not an image")
    message = refuses(
        "calibrate-rig", tmp_path / "left", tmp_path / "right", "--times", tmp_path / "t.csv", "-o", tmp_path / "r.json"
    )
    assert "t.csv: no such file or folder" in message


def test_folders_without_boards_are_named(tmp_path, run):
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
        for k in range(3):
            om.write_image(tmp_path / name / f"{k}.png", np.full((120, 160), 40 * k, np.uint8))
    code, out, error = run("calibrate-rig", tmp_path / "left", tmp_path / "right", "-o", tmp_path / "rig.json")
    assert (code, out) == (2, "")
    assert error.startswith("omnisight: left: ")
    assert not (tmp_path / "rig.json").exists()


@pytest.mark.slow
def test_real_stereo_images_give_the_known_baseline_in_both_halves(data, run, tmp_path):
    folder = data("stereo_fisheye_sourishg")
    numbers = sorted(int(path.stem[4:]) for path in folder.glob("left*.jpg"))
    found = []
    for half in (0, 1):
        for name in ("left", "right"):
            (tmp_path / f"{half}" / name).mkdir(parents=True)
            for k in numbers[half::2]:
                (tmp_path / f"{half}" / name / f"{k}.jpg").symlink_to(folder.resolve() / f"{name}{k}.jpg")
        inputs = tmp_path / f"{half}" / "left", tmp_path / f"{half}" / "right"
        output = tmp_path / f"{half}.json"
        code, out, _ = run("calibrate-rig", *inputs, "--pattern", "9x6", "--square", "24.23mm", "--json", "-o", output)
        assert code == 0
        result = json.loads(out)
        assert set(KEYS) <= set(result)
        assert result["pairs"][0]["shared_images"] == 10
        found.append(om.load_rig(output))
        baseline = np.linalg.norm(result["sensor_from_rig"]["right"]["translation_m"])
        assert baseline == pytest.approx(0.110, abs=3e-3 * max(result["sensor_from_rig"]["right"]["sigma_mm"], 1))
    first, second = (rig.sensor_from_rig[1] for rig in found)
    difference = np.append(so3.log(first.rotation @ second.rotation.T), first.translation - second.translation)
    covariance = sum(rig.covariance[6:, 6:] for rig in found)
    assert difference @ np.linalg.solve(covariance, difference) / 6 < 2.1  # 95 % of a chi-square of 6
