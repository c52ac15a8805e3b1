"""Which images belong to which camera, and which were taken at the same time."""

import pytest

from omnisight.pipeline.inputs.image_set import image_set


def folder_of(tmp_path, names):
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize(
    ("names", "rule"),
    [
        (["front/1.jpg", "front/2.jpg", "back/1.jpg", "back/2.jpg"], "name"),
        (["front_1.jpg", "front_2.jpg", "back_1.jpg", "back_2.jpg"], "name"),
        (["1-front.png", "2-front.png", "1-back.png", "2-back.png"], "name"),
        (["front/f01.jpg", "front/f02.jpg", "back/b1.jpg", "back/b2.jpg"], "number"),
        (["front/a.jpg", "front/b.jpg", "back/c.jpg", "back/d.jpg"], "order"),
    ],
)
def test_simultaneous_images_share_name_number_or_order(tmp_path, names, rule):
    files = image_set(folder_of(tmp_path, names), ["front", "back"], is_rig=True)
    assert files.rule == rule
    taken = {(int(k), int(f)): name for name, k, f in zip(files.names, files.camera, files.frame, strict=True)}
    assert taken == {(i // 2, i % 2): name for i, name in enumerate(names)}


def test_the_last_folder_of_a_path_determines_the_camera(tmp_path):
    files = image_set(folder_of(tmp_path / "front", ["back/1.jpg", "left/1.jpg"]), ["front", "back", "left"])
    assert files.camera.tolist() == [1, 2]
    assert files.names == ["back/1.jpg", "left/1.jpg"]


@pytest.mark.parametrize("cameras", [("left", "front_left", "front"), ("front", "front_left", "left")])
def test_the_longest_name_of_a_camera_is_used(tmp_path, cameras):
    names = ["front/1.jpg", "front_left/1.jpg", "left/1.jpg", "front_left_2.jpg"]
    files = image_set(folder_of(tmp_path, names), cameras)
    found = {name: cameras[k] for name, k in zip(files.names, files.camera, strict=True)}
    assert found == {name: name.removesuffix(".jpg").removesuffix("/1").removesuffix("_2") for name in files.names}
    assert len(found) > 0


def test_images_without_a_camera_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"frontal_1.jpg: belongs to none of the cameras front, back"):
        image_set(folder_of(tmp_path, ["frontal_1.jpg", "back_1.jpg"]), ["front", "back"])


def test_images_that_nothing_makes_simultaneous_are_refused(tmp_path):
    names = ["front/a.jpg", "front/b.jpg", "back/c.jpg"]
    with pytest.raises(ValueError, match="taken at the same time"):
        image_set(folder_of(tmp_path, names), ["front", "back"], is_rig=True)


@pytest.mark.parametrize("cameras", [(), ("front", "back")])
def test_only_the_images_of_a_data_set_are_used(tmp_path, cameras):
    folders = [f"{camera}/" for camera in cameras] or [""]
    kinds = [f"{kind}/{k}.png" for kind in ("images", "depth", "normals", "instances") for k in (0, 1)]
    names = [folder + name for folder in folders for name in [*kinds, "vignette.png"]]
    files = image_set(folder_of(tmp_path, names), cameras, is_rig=bool(cameras))
    assert sorted(files.names) == sorted(f"{folder}images/{k}.png" for folder in folders for k in (0, 1))
    assert sorted(files.frame.tolist()) == sorted([0, 1] * len(folders))


def test_the_images_of_a_folder_with_other_images_below_are_used(tmp_path):
    assert image_set(folder_of(tmp_path, ["1.png", "images/2.png"])).names == ["1.png"]
