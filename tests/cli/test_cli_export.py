"""`omnisight export`: images with an EXIF orientation, and options that do not apply to a format."""

import base64
import json

import numpy as np
import pytest

import omnisight as om
from jpegs import jpeg
from omnisight.images import decode_image, read_image
from omnisight.reconstructions import write_reconstruction
from omnisight.report.viewer import render_viewer
from reconstructing import paint, single


def test_images_are_rotated_by_their_orientation(run, tmp_path):
    made = single()
    write_reconstruction(tmp_path / "model", made)
    folder = paint(made, tmp_path / "images")
    command = ("export", tmp_path / "model", "--to", "splat", "--images", folder, "--size", "64x64")
    assert run(*command, "-o", tmp_path / "plain")[0] == 0
    for name in made.names:
        # EXIF orientation 6: rotated clockwise by 90 degrees for display.
        (folder / name).write_bytes(jpeg(np.rot90(read_image(folder / name))[..., ::-1], 6))
    status, _, err = run(*command, "-o", tmp_path / "wrong")
    assert status == 2
    assert "--apply-exif" in err
    for output, more in (("out", ()), ("batch", ("--workers", "1"))):
        status, _, err = run(*command, "-o", tmp_path / output, "--apply-exif", *more)
        assert status == 0, err
        paths = sorted((tmp_path / "plain" / "images").iterdir())
        assert len(paths) == 6 * len(made)
        for path in paths:
            found = read_image(tmp_path / output / "images" / path.name).astype(int)
            assert np.abs(found - read_image(path)).mean() < 3
    page = render_viewer(made, folder, apply_exif=True)
    data = json.loads(page.split('id="reconstruction">')[1].split("</script>")[0])
    image = decode_image(base64.b64decode(data["cameras"][0]["image"].split(",")[1]), "image")
    assert image.shape[1] == 2 * image.shape[0]


@pytest.mark.parametrize(
    ("to", "options", "message"),
    [
        ("ffmpeg", "--workers 2", "--workers, --cluster and URLs apply to --to splat with --images"),
        ("stmap", "--images images", "--images does not apply to --to stmap: leave it out"),
        ("glsl", "--apply-exif", "--apply-exif does not apply to --to glsl: leave it out"),
        ("colmap", "--fov 90 --yaw 30", "--fov, --yaw do not apply to --to colmap: leave them out"),
        ("colmap", "--images images", "--images does not apply to --to colmap: leave it out"),
        ("splat", "--view cylinder", "--view does not apply to --to splat: leave it out"),
        (
            "viewer",
            "--size 64x64 --image-size 64x48",
            "--size, --image-size do not apply to --to viewer: leave them out",
        ),
    ],
)
def test_options_that_do_not_apply_to_the_format_are_refused(run, tmp_path, to, options, message):
    write_reconstruction(tmp_path / "model", single())
    om.save(om.perspective((64, 48), 90), tmp_path / "camera.json")
    source = tmp_path / ("camera.json" if to in ("ffmpeg", "stmap", "glsl") else "model")
    status, _, err = run("export", source, "--to", to, *options.split(), "-o", tmp_path / "out")
    assert status == 2
    assert message in err
    assert not list(tmp_path.glob("out*"))


def test_the_output_is_a_folder_apart_from_the_images(refuses, tmp_path):
    write_reconstruction(tmp_path / "model", single())
    folder = paint(single(), tmp_path / "images")
    before = sorted(folder.rglob("*"))
    message = refuses("export", tmp_path / "model", "--to", "splat", "--images", folder, "-o", folder)
    assert "contains the images, and the output would be read with them next time" in message
    message = refuses("export", tmp_path / "model", "--to", "glb", "-o", tmp_path / "room.glb")
    assert "room.glb: is the name of a file, and the output is a folder" in message
    assert not (tmp_path / "room.glb").exists()
    assert sorted(folder.rglob("*")) == before
