"""Formats that hold Scaramuzza's model on other axes, signs and origins than OCamCalib's text."""

import contextlib
import json
import struct
import zlib

import numpy as np
import pytest
import scipy.io

from omnisight.camera import Camera
from omnisight.corners import read_corners
from omnisight.formats import FormatError, get_format, load, load_all, save
from omnisight.models import model_class

A = [-471.4441, 0.0, 7.356108e-04, -3.773045e-07, 5.800006e-10]  # OCamCalib's sign
C, D, E = 1.000305, -0.000277, -0.000925


def lifted(pixel, centre, direct, stretch):
    """Return the bearing of a pixel: [x, y] = inverse([c d; e 1]) (pixel - centre), z = f(r) with z forward."""
    x, y = np.linalg.solve(stretch, np.subtract(pixel, centre))
    bearing = np.array([x, y, np.polynomial.polynomial.polyval(np.hypot(x, y), direct)])
    return bearing / np.linalg.norm(bearing)


FORWARD = [-a for a in A]
XY = np.array([[C, D], [E, 1.0]])
PIXEL = np.array([500.0, 350.0])
BEARING = lifted(PIXEL, (400.75, 300.25), FORWARD, XY)

MATLAB = "intrinsics = fisheyeIntrinsics([471.4441 -7.356108e-04 3.773045e-07 -5.800006e-10], [600 800], ...\n"
MATLAB = MATLAB.replace(" ...\n", "") + " [401.75, 301.25], [1.000305 -0.000277; -0.000925 1]);\n"
CAMODOCAL = (
    "%YAML:1.0\n---\nmodel_type: scaramuzza\ncamera_name: left\nimage_width: 800\nimage_height: 600\npoly_parameters:\n"
    + "".join(f"   p{i}: {a}\n" for i, a in enumerate(A))
    + "inv_poly_parameters:\n   p0: 700.\n   p1: 400.\n"
    + f"affine_parameters:\n   ac: {C}\n   ad: {D}\n   ae: {E}\n   cx: 400.75\n   cy: 300.25\n"
)
MULTICOL = (
    "%YAML:1.0\nCamera.Iw: 800\nCamera.Ih: 600\nCamera.nrpol: 5\nCamera.nrinvpol: 1\n"
    + "".join(f"Camera.a{i}: {a}\n" for i, a in enumerate(A))
    + f"Camera.pol0: 700\nCamera.c: {C}\nCamera.d: {D}\nCamera.e: {E}\nCamera.u0: 400.75\nCamera.v0: 300.25\n"
)
PYTHON = json.dumps(
    {
        "camera_name": "fisheye",
        "valid": [True],
        "taylor_coefficient": FORWARD,
        "distortion_center": [400.75, 300.25],
        "stretch_matrix": [[C, D], [E, 1.0]],
        "inverse_poly": [1.0, 2.0],
    }
)
JSONENCODED = json.dumps(
    {
        "MappingCoefficients": [FORWARD[0], *FORWARD[2:]],
        "ImageSize": [600, 800],
        "DistortionCenter": [401.75, 301.25],
        "StretchMatrix": [[C, D], [E, 1]],
    }
)
TEXTS = {
    "matlab": MATLAB, "camodocal": CAMODOCAL, "multicol_slam": MULTICOL, "py_ocamcalib": PYTHON, "json": JSONENCODED,
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_bearing_of_a_pixel_matches_the_formula_of_the_tool(name, load_text):
    camera = load_text(TEXTS[name])
    assert camera.unproject(PIXEL)[0] == pytest.approx(BEARING, abs=1e-12)
    assert camera.size == ((0, 0) if name == "py_ocamcalib" else (800, 600))


@pytest.mark.parametrize("name", ["camodocal", "multicol_slam", "py_ocamcalib"])
def test_the_inverse_polynomial_that_is_written_projects(name, tmp_path):
    camera = Camera(model_class("ocam").example(), (1024, 768))
    save(camera, tmp_path / "c", format=name)
    text = (tmp_path / "c").read_text()
    bearings, pixels = camera.samples()
    flat = np.maximum(np.hypot(bearings[:, 0], bearings[:, 1]), 1e-300)
    if name == "py_ocamcalib":
        data = json.loads(text)
        rho = np.polyval(data["inverse_poly"], np.arctan2(flat, bearings[:, 2]))
        (c, d), (e, _) = data["stretch_matrix"]
        centre = data["distortion_center"]
    else:
        head = "Camera.pol" if name == "multicol_slam" else "   p"
        part = text[text.index("inv_poly") :] if name == "camodocal" else text
        part = part[: part.index("affine")] if name == "camodocal" else part
        inverse = [float(line.split(":")[1]) for line in part.splitlines() if line.startswith(head)]
        rho = np.polynomial.polynomial.polyval(np.arctan2(-bearings[:, 2], flat), inverse)
        words = dict(line.strip().removeprefix("Camera.").split(": ") for line in text.splitlines() if ": " in line)
        names = ("ac", "ad", "ae", "cx", "cy") if name == "camodocal" else ("c", "d", "e", "u0", "v0")
        c, d, e, *centre = (float(words[key]) for key in names)
    x, y = rho * bearings[:, 0] / flat, rho * bearings[:, 1] / flat
    projected = np.stack([c * x + d * y + centre[0], e * x + y + centre[1]], -1)
    assert np.linalg.norm(projected - pixels, axis=1).max() < 0.02


def test_py_ocamcalib_real_file_agrees_with_its_own_inverse(data):
    folder = data("fisheye1_urban")
    path = next(folder.glob("calibration_*.json"))
    camera, given = load(path), json.loads(path.read_text())
    pixels = np.stack(np.meshgrid(np.linspace(20, 1010, 20), np.linspace(20, 760, 20)), -1).reshape(-1, 2)
    bearings, valid = camera.unproject(pixels)
    assert valid.all()
    flat = np.hypot(bearings[:, 0], bearings[:, 1])
    rho = np.polyval(given["inverse_poly"], np.arctan2(flat, bearings[:, 2]))
    plane = np.stack([rho * bearings[:, 0] / flat, rho * bearings[:, 1] / flat])
    projected = (np.array(given["stretch_matrix"]) @ plane).T + given["distortion_center"]
    assert np.linalg.norm(projected - pixels, axis=1).max() < 0.2
    assert len(camera.extra["extrinsics_t"]) == len(given["extrinsics_t"])


# The numbers of MultiCol-SLAM's Examples/Lafida/InteriorOrientationFisheye0.yaml.
LAFIDA = [
    293.667187375663, 149.982043337335, -10.448650568161, 28.2295300683376, 7.13365723186292, 0.056303218962532,
    10.4144677485333, 0.166354960773665, -5.86858687381081, 1.18165998645705, 3.1108311354746, 0.810799620714366,
]  # fmt: skip
LAFIDA_TEXT = """%YAML:1.0
Camera.Iw: 754
Camera.Ih: 480
Camera.nrpol: 5
Camera.nrinvpol: 12
Camera.a0: -209.200757992065
Camera.a1: 0.0
Camera.a2: 0.00213741670953883
Camera.a3: -4.2203617319086e-06
Camera.a4: 1.77146086919594e-08
Camera.c: 0.999626131079017
Camera.d: -0.0034775192597376
Camera.e: 0.00385134991673147
Camera.u0: 392.219508388648
Camera.v0: 243.494438476351
Camera.mirrorMask: 1
"""


def test_lafida_agrees_with_its_own_inverse_by_worldtoimg(load_text):
    camera = load_text(LAFIDA_TEXT)
    bearings, pixels = camera.samples()
    flat = np.maximum(np.hypot(bearings[:, 0], bearings[:, 1]), 1e-14)
    rho = np.polynomial.polynomial.polyval(np.arctan(-bearings[:, 2] / flat), LAFIDA)
    uu, vv = bearings[:, 0] / flat * rho, bearings[:, 1] / flat * rho
    u = uu * 0.999626131079017 + vv * -0.0034775192597376 + 392.219508388648
    v = uu * 0.00385134991673147 + vv + 243.494438476351
    assert np.linalg.norm(np.stack([u, v], -1) - pixels, axis=1).max() < 0.5
    assert camera.extra == {"Camera.mirrorMask": 1}


def test_wrong_sign_convention_is_refused(load_text):
    with pytest.raises(FormatError, match=r"p0 must be negative.*got 471"):
        load_text(CAMODOCAL.replace("p0: -471", "p0: 471"))
    with pytest.raises(FormatError, match=r"a0 must be negative.*got 471"):
        load_text(MULTICOL.replace("a0: -471", "a0: 471"))
    with pytest.raises(FormatError, match=r"a0 .* must be positive.*-471"):
        load_text(MATLAB.replace("[471", "[-471"))


def test_camodocal_a_centre_as_row_column_is_refused(load_text):
    swapped = CAMODOCAL.replace("cx: 400.75", "cx: 300.25").replace("cy: 300.25", "cy: 400.75", 1)
    with pytest.raises(FormatError, match=r"centre \(300.25, 400.75\) of a 800 x 600 image seems to be row, column"):
        load_text(swapped)


def test_more_than_four_coefficients_are_refitted_with_note(tmp_path):
    ocam = model_class("ocam").example()
    longer = model_class("ocam")(ocam.cx, ocam.cy, ocam.c, ocam.d, ocam.e, a=(*ocam.a, 0.0, 1e-16))
    for name in ("matlab", "camodocal", "multicol_slam"):
        written = save(Camera(longer, (1024, 768)), tmp_path / "c", format=name)
        assert "6 coefficients: refitted with four" in written.notes[0], name
        assert 0 < written.error_px < 0.5, name


# -- .mat -------------------------------------------------------------------------------------------------------

FIELDS = {
    "MappingCoefficients": np.array([FORWARD[0], *FORWARD[2:]]),
    "ImageSize": np.array([600, 800]),
    "DistortionCenter": np.array([401.75, 301.25]),
    "StretchMatrix": XY,
}


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("place", ["top", "struct", "params"])
def test_matlab_mat_files(place, compressed, tmp_path):
    content = {"top": FIELDS, "struct": {"s": FIELDS}, "params": {"p": {"Intrinsics": FIELDS, "n": "x"}}}[place]
    scipy.io.savemat(tmp_path / "c.mat", content, do_compression=compressed)
    camera = load(tmp_path / "c.mat")
    assert camera.size == (800, 600)
    assert camera.unproject(PIXEL)[0] == pytest.approx(BEARING, abs=1e-12)


def test_matlab_mat_of_ocamcalib_equals_its_text(load_text, tmp_path):
    text = load_text(f"5 {' '.join(map(repr, A))}\n1 1\n300.25 400.75\n{C} {D} {E}\n600 800\n")
    ocam = {"ss": np.array(A)[:, None], "xc": 301.25, "yc": 401.75, "c": C, "d": D, "e": E, "width": 800, "height": 600}
    scipy.io.savemat(tmp_path / "c.mat", {"calib_data": {"ocam_model": ocam, "n_imgs": 5}})
    assert load(tmp_path / "c.mat").model == text.model


def test_matlab_refuses_hostile_and_empty_mat_files(tmp_path):
    path = tmp_path / "c.mat"
    scipy.io.savemat(path, {"x": 1.0, "cells": np.array([1, "a"], dtype=object)})
    whole = path.read_bytes()
    with pytest.raises(FormatError, match=r"cells is not a struct of numbers; in MATLAB.*: i = cells\.Intrinsics"):
        load(path)
    bomb = zlib.compress(b"\0" * 50_000_000)
    path.write_bytes(whole[:128] + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(FormatError, match="when unpacked"):
        load(path)
    scipy.io.savemat(path, {"s": FIELDS})
    whole = path.read_bytes()
    for end in range(130, len(whole), 41):
        path.write_bytes(whole[:end])
        with pytest.raises(FormatError):
            load(path)
    rng = np.random.default_rng(2)
    for _ in range(200):
        corrupted = bytearray(whole)
        corrupted[rng.integers(128, len(whole))] = rng.integers(256)
        path.write_bytes(corrupted)
        with contextlib.suppress(FormatError):
            assert np.isfinite(load(path).model.params).all()


def element(kind, body):
    return struct.pack("<II", kind, len(body)) + body + b"\0" * (-len(body) % 8)


def with_object(path, variable, of_class):
    """Save what MATLAB saves of an object of a classdef, as files of its own have it: a name, and a place elsewhere."""
    scipy.io.savemat(path, {"x": 1.0})
    place = np.array([0xDD000000, 2, 1, 1, 1, 1], "<u4").tobytes()
    matrix = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<II", 6, 1)) + element(1, b"")
    inner = element(14, matrix + element(6, place))
    body = element(6, struct.pack("<II", 17, 0)) + element(1, variable) + element(1, b"MCOS") + element(1, of_class)
    path.write_bytes(path.read_bytes() + element(14, body + inner))


def test_matlab_object_error_has_extraction_command(tmp_path):
    with_object(tmp_path / "m.mat", b"fisheyeParams", b"fisheyeParameters")
    with pytest.raises(FormatError, match=r"fisheyeParams is not a struct.*i = fisheyeParams\.Intrinsics; s = struct"):
        load(tmp_path / "m.mat")
    with_object(tmp_path / "o.mat", b"calib_data", b"C_calib_data")
    with pytest.raises(FormatError, match=r"calib_data is an object of OCamCalib.*ocam_model = calib_data\.ocam_model"):
        load(tmp_path / "o.mat")
    with pytest.raises(FormatError, match=r"calib_data is an object of OCamCalib.*Xt = c\.Xt; Yt = c\.Yt; Xp_abs"):
        read_corners([tmp_path / "o.mat"])


def test_matlab_extraction_commands_produce_readable_files(load_text, tmp_path):
    """The .mat that MATLAB has written after each of them."""
    path = tmp_path / "c.mat"
    ocam = {"ss": np.array(A)[:, None], "xc": 301.25, "yc": 401.75, "c": C, "d": D, "e": E, "width": 800, "height": 600}
    scipy.io.savemat(path, {"ocam_model": ocam | {"invpol": np.ones((1, 9))}})
    text = load_text(f"5 {' '.join(map(repr, A))}\n1 1\n300.25 400.75\n{C} {D} {E}\n600 800\n")
    assert load(path).model == text.model
    assert list(load_all(path)) == ["ocam_model"]
    scipy.io.savemat(path, {"s": FIELDS})
    assert load(path).unproject(PIXEL)[0] == pytest.approx(BEARING, abs=1e-12)


@pytest.mark.parametrize(
    "head", [b"MATLAB 7.3 MAT-file, Platform: GLNXA64", b"MATLAB 7.0 MAT-file", b"\x89HDF\r\n\x1a\n"]
)
def test_matlab_hdf5_error_has_save_command(head, tmp_path):
    (tmp_path / "c.mat").write_bytes(head.ljust(124) + b"\0\2IM" + bytes(400))
    for read in (load, lambda path: read_corners([path])):
        with pytest.raises(FormatError, match=r"c\.mat: .*save it with -v7, in MATLAB: s = load\('old\.mat'\); save\("):
            read(tmp_path / "c.mat")


def files_with_coefficients(count):
    """Return files of every format that has the model, with that many coefficients of f(r)."""
    more = [1e11] * (count - 5)
    native = json.loads(get_format("native").serialize(Camera(model_class("ocam").example(), (800, 600)))[0])
    native["params"] |= {f"a{i}": 1e11 for i in range(5, count + 1)}
    listed = " ".join(map(repr, A + more))
    yield "ocamcalib", f"{count} {listed}\n1 1\n300.25 400.75\n{C} {D} {E}\n600 800\n"
    yield "native", json.dumps(native)
    python = get_format("py_ocamcalib").serialize(Camera(model_class("ocam").example(), (800, 600)))[0]
    yield "py_ocamcalib", json.dumps(json.loads(python) | {"taylor_coefficient": FORWARD + more})
    extra = "".join(f"Camera.a{i}: 1e11\n" for i in range(5, min(count, 40)))
    yield "multicol_slam", MULTICOL.replace("Camera.nrpol: 5", f"Camera.nrpol: {min(count, 40)}") + extra
    yield (
        "fisheye_calib_adapter",
        "image:\n  width: 800\n  height: 600\nparameter:\n  c: 0.2\n  d: 0.0\n  e: 0.0\n  cx: 400.0\n  cy: 300.0\n"
        f"  coefficients:\n    unprojection: {FORWARD + more}\n",
    )


@pytest.mark.parametrize("count", [30, 99, 1500])
def test_long_polynomial_is_refused_before_compilation(count, tmp_path):
    for name, text in files_with_coefficients(count):
        if name == "ocamcalib" and count > 99:  # no count of a file of OCamCalib: another text
            continue
        assert get_format(name).matches(text), name
        (tmp_path / "c").write_text(text)
        with pytest.raises(FormatError, match=r"f\(r\) has \d+ coefficients, at most 20 are read"):
            load(tmp_path / "c")
    ocam = {"ss": np.array(A + [1e11] * count)[:, None], "xc": 1, "yc": 1, "c": 1, "d": 0, "e": 0}
    scipy.io.savemat(tmp_path / "c.mat", {"ocam_model": ocam | {"width": 800, "height": 600}})
    with pytest.raises(FormatError, match=r"f\(r\) has \d+ coefficients, at most 20 are read"):
        load(tmp_path / "c.mat")
