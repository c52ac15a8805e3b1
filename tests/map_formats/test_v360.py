"""The options of FFmpeg's filter v360, checked by running it."""

import re
import shutil
import subprocess

import numpy as np
import pytest

import omnisight as om
from omnisight.models import model_class

needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg on the path")
FISHEYE = om.Camera(model_class("kannala_brandt")(98.0, 97.0, 160.3, 119.1, 0.01, -0.02, 0.004, -0.001), (320, 240))
VIEW = om.ViewOptions(fov=100, yaw=70, pitch=-20, roll=10, size=(160, 120))

IDEAL = {
    "sphere": (om.sphere(512), {}),
    "fisheye": (om.fisheye(400, 200), {}),
    "perspective": (om.perspective((320, 240), 110), {}),
    "equisolid": (om.fisheye(400, 200, "equisolid"), {}),
    "stereographic": (om.fisheye(400, 200, "stereographic"), {}),
    "orthographic": (om.fisheye(400, 170, "orthographic"), {}),
    "cylinder": (om.cylinder(600), {}),
    "flipped": (om.sphere(512), {"flip": True}),
    "upward": (om.sphere(512), {"up": "back", "pitch": 30.0}),
}


def pixels_of_v360(filter_text, source, target):
    """Return the source pixel (u, v) of each pixel of the view, each (H, W), from images whose values are pixels."""
    found = []
    for axis in range(2):
        ramp = np.indices(source.size[::-1])[1 - axis]
        ramp = (1000 + 16 * ramp).astype("<u2")
        raw = ["-f", "rawvideo", "-pix_fmt", "gray16le"]
        size = f"{source.width}x{source.height}"
        command = ["ffmpeg", "-v", "error", *raw, "-s", size, "-i", "-", "-vf", filter_text, *raw, "-"]
        done = subprocess.run(command, input=ramp.tobytes(), capture_output=True, check=True)
        values = np.frombuffer(done.stdout, "<u2").reshape(target.size[::-1])
        found.append((values.astype(float) - 1000) / 16)
    return found


@needs_ffmpeg
@pytest.mark.parametrize("name", IDEAL)
def test_v360_renders_the_view_within_a_pixel(name, tmp_path):
    source, changes = IDEAL[name]
    options = om.ViewOptions(
        **{"fov": 70, "yaw": 15, "pitch": -10, "roll": 12, "size": (160, 120), "interpolation": "bilinear"} | changes
    )
    result = om.export_map(source, tmp_path / "map", "v360", options)
    u, v = pixels_of_v360(result.files[0].read_text().strip(), source, result.table.target)
    table = result.table
    inner = table.covered & (table.u > 2) & (table.u < source.width - 3)
    inner &= (table.v > 2) & (table.v < source.height - 3)
    assert inner.mean() > 0.5
    distance = np.hypot(u - table.u, v - table.v)[inner]
    assert np.median(distance) < 0.6
    assert distance.max() < 1.0


@pytest.mark.parametrize(
    ("camera", "options", "message"),
    [
        (FISHEYE, VIEW, "v360 has no projection for the camera, a kannala_brandt; it has pinhole, equidistant"),
        (
            om.Camera(model_class("pinhole")(300.0, 300.0, 170.0, 120.0), (320, 240)),
            om.ViewOptions(fov=30),
            "v360 needs the camera to have its axis in the image centre, and it is 10.51 px beside",
        ),
        (om.sphere(400), om.ViewOptions(to="cube"), "v360 has no cross of six faces"),
        (om.sphere(400), om.ViewOptions(to="panini"), "v360 has no projection for the view, a panini"),
        (om.fisheye(400, 200), om.ViewOptions(to="fisheye", fov=180, yaw=20), "lacks"),
        (om.sphere(400, elevation=(-40, 40)), VIEW, "v360 needs the camera to be a whole sphere"),
    ],
)
def test_v360_refuses_what_it_cannot_show(camera, options, message, tmp_path):
    with pytest.raises(ValueError, match=re.escape(message)):
        om.export_map(camera, tmp_path / "map", "v360", options)
    assert list(tmp_path.iterdir()) == []
