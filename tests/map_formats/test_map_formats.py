"""Remap tables, applied by the programs they are for, and compared with omnisight's own remap."""

import base64
import gzip
import json
import re
import shutil
import subprocess
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.map_formats import RemapTable, get_map_format, map_format_names
from omnisight.map_formats._exr import encode_exr
from omnisight.models import model_class

needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg on the path")

FISHEYE = om.Camera(model_class("kannala_brandt")(98.0, 97.0, 160.3, 119.1, 0.01, -0.02, 0.004, -0.001), (320, 240))
SPHERE = om.sphere(400)
PANORAMA = om.Camera(model_class("cylindrical")(400 / (2 * np.pi), 400 / (2 * np.pi), 199.5, 49.5), (400, 100))
# A view of which the fisheye covers a part.
VIEW = om.ViewOptions(fov=100, yaw=70, pitch=-20, roll=10, size=(160, 120))


def smooth_image(camera, channels=3):
    """Return an image without fine detail, in which interpolations hardly differ; periodic along the columns."""
    u, v = np.meshgrid(np.arange(camera.width) / camera.width, np.arange(camera.height) / camera.height)
    phases = [(3, 1, 0.0), (2, 2, 1.0), (5, 3, 2.0)][:channels]
    waves = [np.sin(2 * np.pi * (a * u + phase)) * np.cos(np.pi * b * v) for a, b, phase in phases]
    return np.rint(127 + 100 * np.stack(waves, -1)).astype(np.uint8)


def exported(camera, output, name, options=VIEW):
    return om.export_map(camera, output, name, options)


def expected(result, image, interpolation="bilinear"):
    """Return omnisight's own view."""
    table = result.table
    return om.remap(image, table.source, table.target, table.rotations[0], interpolation=interpolation, antialias=False)


def assert_alike(view, own, table, tolerance):
    """Check a view that is covered from 3 px inside the image, and that it is black where it is not covered."""
    width, height = table.source.size
    inner = table.covered & (table.v > 3) & (table.v < height - 4)
    inner &= table.is_periodic | ((table.u > 3) & (table.u < width - 4))
    outer = cv2.erode((~table.covered).astype(np.uint8), np.ones((5, 5))) > 0
    assert inner.mean() > 0.3
    difference = np.abs(view.astype(float) - own)
    assert difference[inner].max() <= tolerance
    assert view[outer].max(initial=0) == 0


@pytest.mark.parametrize("camera", [FISHEYE, SPHERE, PANORAMA], ids=["fisheye", "sphere", "panorama"])
@pytest.mark.parametrize("name", ["map", "map.npy", "map.yml", "map.xml", "map.yml.gz"])
def test_opencv_renders_the_view(camera, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = exported(camera, Path(name), "opencv-map")
    image = smooth_image(camera)
    names = {"cv2": cv2, "np": np, "image": image}
    exec(result.usage, names)
    assert_alike(names["view"], expected(result, image, "bicubic"), result.table, 1)


def test_compressed_text_is_the_same_text(tmp_path):
    plain, packed = (exported(FISHEYE, tmp_path / name, "opencv-map").files[0] for name in ("m.yml", "m.yml.gz"))
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()


@needs_ffmpeg
@pytest.mark.parametrize("camera", [FISHEYE, SPHERE], ids=["fisheye", "sphere"])
@pytest.mark.parametrize(("interpolation", "tolerance"), [("nearest", 1), ("bilinear", 4), ("bicubic", 4)])
def test_the_printed_command_of_ffmpeg_renders_the_view(camera, interpolation, tolerance, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = om.ViewOptions(fov=100, yaw=70, pitch=-20, roll=10, size=(160, 120), interpolation=interpolation)
    result = exported(camera, Path("my map"), "ffmpeg", options)
    image = smooth_image(camera)
    om.write_image("in.png", image)
    command = result.usage.replace("INPUT", "in.png").replace("OUTPUT", "out.png")
    subprocess.run(command.replace("ffmpeg", "ffmpeg -v error", 1), shell=True, check=True)
    assert_alike(om.read_image("out.png"), expected(result, image, interpolation), result.table, tolerance)


@needs_ffmpeg
def test_ffmpeg_applies_the_map_to_every_frame_of_a_clip(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = exported(FISHEYE, Path("map"), "ffmpeg")
    source = f"testsrc=size={FISHEYE.width}x{FISHEYE.height}:rate=10:duration=1"
    subprocess.run(["ffmpeg", "-v", "error", "-f", "lavfi", "-i", source, "-qp", "0", "clip.mp4"], check=True)
    command = result.usage.replace("INPUT", "clip.mp4").replace("OUTPUT", "frame%d.png")
    subprocess.run(command.replace("ffmpeg", "ffmpeg -v error", 1), shell=True, check=True)
    frames = [om.read_image(f"frame{i}.png") for i in range(1, 11)]
    assert len(list(Path().glob("frame*.png"))) == 10
    assert all(frame.shape == (120, 160, 3) for frame in frames)
    assert min(frame[result.table.covered].std() for frame in frames) > 20


@needs_ffmpeg
@pytest.mark.parametrize(("size", "pixels"), [((160, 120), "yuv420p"), ((161, 120), "yuv444p")])
def test_the_clip_of_ffmpeg_has_the_pixel_format_that_players_decode(tmp_path, monkeypatch, size, pixels):
    monkeypatch.chdir(tmp_path)
    result = exported(FISHEYE, Path("map"), "ffmpeg", om.ViewOptions(fov=100, size=size))
    source = f"testsrc=size={FISHEYE.width}x{FISHEYE.height}:rate=10:duration=0.3"
    make = ["ffmpeg", "-v", "error", "-f", "lavfi", "-i", source, "-pix_fmt", "yuv420p", "clip.mp4"]
    subprocess.run(make, check=True)
    command = result.usage.replace("INPUT", "clip.mp4").replace("OUTPUT", "view.mp4")
    subprocess.run(command.replace("ffmpeg", "ffmpeg -v error", 1), shell=True, check=True)
    with av.open("view.mp4") as clip:
        assert clip.streams.video[0].format.name == pixels


def test_an_independent_reader_reads_the_exr(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (16, 3), (37, 50)):
        channels = {name: rng.normal(size=shape).astype(np.float32) for name in "RGBA"}
        channels["B"] = np.zeros(shape, np.float32)
        (tmp_path / "noise.exr").write_bytes(encode_exr(channels))
        image = oiio.ImageBuf(str(tmp_path / "noise.exr"))
        values = image.get_pixels(oiio.FLOAT)
        oiio.ImageCache().invalidate_all(True)
        assert image.spec().channelnames == ("R", "G", "B", "A")
        assert np.array_equal(values, np.stack([channels[name] for name in "RGBA"], -1))


@pytest.mark.parametrize("camera", [FISHEYE, SPHERE], ids=["fisheye", "sphere"])
def test_an_stmap_renders_the_view_in_openimageio(camera, tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    result = exported(camera, tmp_path / "map", "stmap")
    image = smooth_image(camera)
    om.write_image(tmp_path / "in.png", image)
    # The origin of this program is the upper left corner, which flip_t exchanges for the lower left one.
    warped = oiio.ImageBufAlgo.st_warp(
        oiio.ImageBuf(str(tmp_path / "in.png")),
        stmap := oiio.ImageBuf(str(result.files[0])),
        "triangle",
        flip_t=True,
        roi=stmap.roi,
    )
    view = np.rint(255 * warped.get_pixels(oiio.FLOAT)[..., :3])
    table = result.table
    seam = (table.u < 2) | (table.u > camera.width - 3)  # not joined by this program
    assert_alike(np.where(seam[..., None], 0, view), expected(result, image) * ~seam[..., None], table, 4)
    values = oiio.ImageBuf(str(result.files[0])).get_pixels(oiio.FLOAT)
    assert np.array_equal(values[..., 3] > 0, table.covered)
    assert np.array_equal(values[..., 2], values[..., 3])
    row, column = np.argwhere(table.covered)[0]
    position = values[row, column, :2] * camera.size
    assert position == pytest.approx([table.u[row, column] + 0.5, camera.height - table.v[row, column] - 0.5], abs=1e-3)


PAGE = """<canvas id="c" width="160" height="120"></canvas><script>
const gl = document.getElementById("c").getContext("webgl2", {preserveDrawingBuffer: true});
const shader = (type, text) => {
    const s = gl.createShader(type);
    gl.shaderSource(s, text), gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw gl.getShaderInfoLog(s);
    return s;
};
const program = gl.createProgram();
gl.attachShader(program, shader(gl.VERTEX_SHADER, `#version 300 es
    out vec2 uv;
    void main() {
        vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
        uv = vec2(corner.x, 1.0 - corner.y);
        gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
    }`));
gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float;
    precision highp sampler2D;
    uniform sampler2D image, lookup;
    in vec2 uv;
    out vec4 color;
    SNIPPET
    void main() { color = omnisight_view(image, lookup, uv); }`));
gl.linkProgram(program), gl.useProgram(program);
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const texture = (unit, name, filter, wrap, ...data) => {
    gl.activeTexture(gl.TEXTURE0 + unit), gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, ...data);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, wrap);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.uniform1i(gl.getUniformLocation(program, name), unit);
};
texture(0, "image", gl.LINEAR, gl.WRAP, gl.RGBA, WIDTH, HEIGHT, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes("IMAGE"));
texture(1, "lookup", gl.NEAREST, gl.CLAMP_TO_EDGE, gl.RG32F, 160, 120, 0, gl.RG, gl.FLOAT,
    new Float32Array(bytes("LOOKUP").buffer));
gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
const pixels = new Uint8Array(160 * 120 * 4);
gl.readPixels(0, 0, 160, 120, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
window.view = Array.from(pixels);
</script>"""


@pytest.mark.parametrize("camera", [FISHEYE, SPHERE], ids=["fisheye", "sphere"])
def test_the_shader_renders_the_view_in_a_browser(camera, tmp_path, browser):
    result = exported(camera, tmp_path / "map", "glsl")
    code, lookup = result.files
    image = smooth_image(camera)
    rgba = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
    values = {
        "SNIPPET": code.read_text(),
        "WRAP": "REPEAT" if "GL_REPEAT" in code.read_text() else "CLAMP_TO_EDGE",
        "WIDTH": str(camera.width),
        "HEIGHT": str(camera.height),
        "IMAGE": base64.b64encode(rgba.tobytes()).decode(),
        "LOOKUP": base64.b64encode(lookup.read_bytes()).decode(),
    }
    page = browser.new_page()
    failures = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.set_content(re.sub("|".join(values), lambda match: values[match[0]], PAGE))
    view = page.evaluate("window.view")
    page.close()
    assert failures == []
    view = np.reshape(view, (120, 160, 4))[::-1]  # readPixels starts at the lowest row
    assert_alike(view[..., :3], expected(result, image), result.table, 3)


def test_a_cube_is_a_cross_in_every_program(tmp_path):
    result = exported(SPHERE, tmp_path / "map.npy", "opencv-map", om.ViewOptions(to="cube", size=(40, 40)))
    assert result.table.u.shape == (120, 160)
    assert result.table.covered.mean() == pytest.approx(0.5)
    values = np.load(result.files[0])
    assert (values[~result.table.covered] == -9999).all()
    assert (values[result.table.covered] >= -0.5).all()


def test_a_table_is_for_the_size_of_the_images(tmp_path):
    small, large = (
        om.export_map(FISHEYE, tmp_path / "map", "opencv-map", VIEW, image_size=size).table
        for size in ((320, 240), (640, 480))
    )
    both = small.covered & large.covered
    assert np.allclose((small.u[both] + 0.5) * 2 - 0.5, large.u[both], atol=1e-3)
    with pytest.raises(ValueError, match="specify it, such as --image-size"):
        om.export_map(om.Camera(FISHEYE.model, (0, 0)), tmp_path / "map", "opencv-map", VIEW)


def test_every_format_has_a_title_and_a_convention():
    assert map_format_names() == ("ffmpeg", "glsl", "opencv-map", "stmap", "v360")
    for name in map_format_names():
        assert get_map_format(name).TITLE
        assert get_map_format(name).CONVENTION


def test_a_view_that_the_camera_does_not_show_is_refused():
    with pytest.raises(ValueError, match="do not show any pixel of the view"):
        RemapTable.of(om.perspective((40, 30), 60), om.perspective((40, 30), 40), [om.look(yaw=180)])


@pytest.mark.parametrize(
    ("name", "output", "message"),
    [
        ("opencv-map", "map.png", "is written as .npy or .yml"),
        ("stmap", "map.png", "is written as .exr"),
        ("ffmpeg", "map.pgm", "leave out .pgm"),
        ("glsl", "map.txt", "is written as .glsl"),
        ("obj", "map", "unknown format of remap tables 'obj'; there are: ffmpeg, glsl"),
    ],
)
def test_unsuitable_names_are_refused(name, output, message, tmp_path):
    with pytest.raises(ValueError, match=re.escape(message)):
        exported(FISHEYE, tmp_path / output, name)
    assert list(tmp_path.iterdir()) == []


def command(capsys, *arguments):
    from omnisight import cli

    with pytest.raises(SystemExit) as caught:
        cli.main(["export", *map(str, arguments)])
    return caught.value.code, *capsys.readouterr()


def test_the_command_writes_the_map_of_a_view(tmp_path, capsys):
    om.save(FISHEYE, tmp_path / "camera.json")
    view = ("--fov", "100", "--yaw", "70", "--pitch", "-20", "--roll", "10", "--size", "160x120")
    status, out, _ = command(capsys, tmp_path / "camera.json", *view, "--to", "opencv-map", "-o", tmp_path / "map")
    assert status == 0
    assert out.startswith("view        perspective, 160x120, ")
    assert np.array_equal(
        np.load(tmp_path / "map.npy"), np.load(exported(FISHEYE, tmp_path / "own", "opencv-map").files[0])
    )
    status, out, _ = command(capsys, tmp_path / "camera.json", *view, "--to", "glsl", "-o", tmp_path / "m", "--json")
    data = json.loads(out)
    assert data["files"] == [str(tmp_path / "m.glsl"), str(tmp_path / "m.rg32f")]
    assert data["size"] == [160, 120]
    assert 0 < data["covered"] < 1


def test_the_command_refuses_a_format_of_another_input(tmp_path, capsys):
    path = om.save(FISHEYE, tmp_path / "camera.json").path
    status, _, err = command(capsys, path, "--to", "ply", "-o", tmp_path / "x")
    assert status == 2
    assert "is a file, and ply is a format of reconstructions" in err
    status, _, err = command(capsys, tmp_path, "--to", "stmap", "-o", tmp_path / "x")
    assert status == 2
    assert "is a folder, and stmap is a format of views" in err
    assert [file.name for file in tmp_path.iterdir()] == ["camera.json"]


def test_a_program_is_answered_with_the_format_that_it_reads(tmp_path, capsys):
    path = om.save(FISHEYE, tmp_path / "camera.json").path
    status, _, err = command(capsys, path, "--to", "Blender", "-o", tmp_path / "x")
    assert status == 2
    assert "use --to stmap" in err
