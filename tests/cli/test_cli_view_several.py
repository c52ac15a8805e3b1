"""Several views of the same images by omnisight view."""

import weakref

import pytest
from cli_scene import damage_image, file_names

from omnisight.images import decode_image


def test_several_views_read_each_image_once(run, folder, camera_file, tmp_path, monkeypatch):
    damage_image(folder / "1.png", "truncated")
    options = [("perspective", 0, "160x120"), ("perspective", 40, "200x100"), ("cylinder", 0, "320x200")]
    for k, (to, yaw, size) in enumerate(options):
        single = "--to", to, "--yaw", yaw, "--size", size, "-o", tmp_path / f"single{k}"
        assert run("view", folder, "--camera", camera_file, *single)[0] == 2
    read, alive = [], []

    def read_once(data, name, **keywords):
        image = decode_image(data, name, **keywords)
        read.append(name)
        alive.append(weakref.ref(image))
        assert sum(ref() is not None for ref in alive) <= 2  # the one before is replaced afterwards
        return image

    monkeypatch.setattr("omnisight.pipeline.views.view.decode_image", read_once)
    several = [word for to, yaw, size in options for word in ("--to", to, "--yaw", yaw, "--size", size)]
    outputs = [word for k in range(3) for word in ("-o", tmp_path / f"several{k}")]
    status, said, err = run("view", folder, "--camera", camera_file, *several, *outputs)
    assert status == 2
    assert err.startswith("omnisight: 1 of 6 images were skipped")
    assert sorted(read) == ["2.png", "3.png", "4.png", "5.png", "6.png"]
    for k in range(3):
        names = file_names(tmp_path / f"single{k}")
        assert len(names) == 5
        assert file_names(tmp_path / f"several{k}") == names
        for name in names:
            assert (tmp_path / f"several{k}" / name).read_bytes() == (tmp_path / f"single{k}" / name).read_bytes()
        assert f"written   {tmp_path / f'several{k}'}" in said


@pytest.mark.parametrize("several", [False, True])
def test_two_views_are_not_written_to_one_file(refuses, shots, camera_file, tmp_path, several):
    images, output = (shots, tmp_path / "out") if several else (shots / "1.png", tmp_path / "view.png")
    message = refuses("view", images, "--camera", camera_file, "--yaw", 0, "--yaw", 40, "-o", output, "-o", output)
    assert "two views have the same file" in message
    assert not output.exists()


def test_options_that_some_types_lack_are_given_for_the_others(run, refuses, shots, camera_file, tmp_path):
    types = "--to", "perspective", "--to", "cylinder", "--to", "perspective", "--elevation", "-30:40"
    outputs = [word for k in range(3) for word in ("-o", tmp_path / f"{k}.png")]
    command = "view", shots / "1.png", "--camera", camera_file, *types, *outputs
    assert run(*command, "--fov", 60, "--fov", 90)[::2] == (0, "")
    for k, options in enumerate((("--fov", 60), ("--to", "cylinder", "--elevation", "-30:40"), ("--fov", 90))):
        alone = tmp_path / "alone.png"
        assert run("view", shots / "1.png", "--camera", camera_file, *options, "-o", alone)[::2] == (0, "")
        assert (tmp_path / f"{k}.png").read_bytes() == alone.read_bytes()
    message = refuses(*command, "--fov", 60, "--fov", 90, "--fov", 90)
    assert "--fov is given 3 times and --output 3 times, and 2 of the outputs have it" in message
