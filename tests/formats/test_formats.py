"""Laws that every calibration format keeps: a new file in formats/ is tested by existing."""

import contextlib
import dataclasses
import re

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, format_names, get_format, load, load_all, save
from omnisight.formats._files import encode
from omnisight.models import model_class, model_names
from pace import assert_quick

PAIRS = [(f, m) for f in format_names() for m in get_format(f).MODELS]
REFUSED = [(f, m) for f in format_names() for m in model_names() if m not in get_format(f).MODELS]
KEEPS_SKEW = {"native", "opencv", "numpy_arrays"}
NO_K3 = {"kalibr", "camodocal"}
ONE_FOCAL = {"hugin", "aria", "py_omnicalib"}
WHOLE_SPHERE = {"colmap", "colmap_rig", "opensfm", "nerfstudio", "stella_vslam", "hugin", "metashape"}
BINARY = {"numpy_arrays"}
TEXTS = sorted(set(format_names()) - BINARY)
SIZE_UNKNOWN = {"opencv", "native", "numpy_arrays"}


def example(name, model):
    """Return a camera that the format holds exactly."""
    made = model_class(model).example()
    values = made.to_dict()
    if "skew" in values and name not in KEEPS_SKEW:
        made = dataclasses.replace(made, skew=0.0)
    if model == "radial_tangential" and name in NO_K3:
        made = dataclasses.replace(made, k3=0.0)
    if name == "metashape" and model == "thin_prism_fisheye":
        made = dataclasses.replace(made, s1=0.0, s2=0.0)
    if name in ONE_FOCAL and hasattr(made, "fx"):
        made = dataclasses.replace(made, fy=made.fx)
    if name in ONE_FOCAL and model == "radial_tangential":
        made = dataclasses.replace(made, k2=0.0, k3=0.0, p1=0.0, p2=0.0)
    size = (960, 720)
    if name in ONE_FOCAL and model == "orthographic":
        size = (480, 360)
    if model == "equirectangular" and name in WHOLE_SPHERE:
        size = (1024, 512)
        made = made.with_params([1024 / (2 * np.pi), 512 / np.pi, 511.5, 255.5])
    return Camera(made, size)


def text_of(name, model):
    return get_format(name).serialize(example(name, model))[0]


@pytest.fixture
def read(tmp_path):
    def through_a_file(text, **options):
        path = tmp_path / "read.txt"
        path.write_bytes(text if isinstance(text, bytes) else encode(text))
        return load(path, **options)

    return through_a_file


@pytest.mark.parametrize(("name", "model"), PAIRS)
def test_saved_camera_reads_back_identically(name, model, tmp_path):
    camera = example(name, model)
    written = save(camera, tmp_path / "camera", format=name)
    again = load(tmp_path / "camera")
    bearings, pixels = camera.samples()
    seen, valid = again.model.project_numpy(bearings)
    assert valid.all()
    assert np.abs(seen - pixels).max() < 1e-9
    assert written.error_px < 1e-9
    assert again.size == camera.size
    assert again.provenance == {"file": "camera", "format": name}
    assert not any("refitted" in note or note.startswith("not written:") for note in written.notes)


@pytest.mark.parametrize(("name", "model"), PAIRS)
def test_exactly_one_format_matches_a_file(name, model):
    text = text_of(name, model)
    assert [other for other in format_names() if get_format(other).matches(text)] == [name]


@pytest.mark.parametrize(("name", "model"), REFUSED)
def test_unsupported_model_error_lists_supported_models(name, model, tmp_path):
    with pytest.raises(FormatError, match=f"has no model {model}; it has .*--model"):
        save(Camera(model_class(model).example(), (960, 720)), tmp_path / "camera", format=name)
    assert not list(tmp_path.iterdir())


DIRT = {
    "windows line ends": lambda text: text.replace("\n", "\r\n").encode(),
    "byte order mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "utf-16 of PowerShell": lambda text: text.encode("utf-16"),
    "trailing spaces": lambda text: text.replace("\n", "  \t\n").encode(),
    "no final newline": lambda text: text.rstrip("\n").encode(),
    "blank lines": lambda text: text.replace("\n", "\n\n").encode() + b"\n\n",
}


@pytest.mark.parametrize("dirt", DIRT)
@pytest.mark.parametrize("name", TEXTS)
def test_encoding_and_white_space_do_not_matter(name, dirt, read):
    for model in get_format(name).MODELS[:2]:
        text = text_of(name, model)
        clean, dirty = read(text), read(DIRT[dirt](text))
        assert dirty.model == clean.model
        assert dirty.size == clean.size


def survives(read, text):
    """Read a text that may be damaged: a finite camera or a FormatError, and nothing else."""
    try:
        camera = read(text)
    except FormatError:
        return False
    assert np.isfinite(camera.model.params).all()
    return True


@pytest.mark.parametrize(("name", "model"), PAIRS)
def test_truncated_file_is_refused(name, model, read):
    text = text_of(name, model)
    for end in np.linspace(0, len(text) - 8, 60).astype(int):
        survives(read, text[:end])
    assert not survives(read, text[: len(text) // 2])


@pytest.mark.parametrize(("name", "model"), PAIRS)
def test_scrambled_file_is_read_or_refused(name, model, read):
    text, chance = text_of(name, model), np.random.default_rng(3)
    for _ in range(60):
        at, length = chance.integers(len(text)), chance.integers(12)
        inserted = "".join(chance.choice(list("[]{}:,-#!'\"\\\n\t 0.eN<>/&*|%")) for _ in range(chance.integers(6)))
        survives(read, text[:at] + inserted + text[at + length :])


@pytest.mark.parametrize("bad", ["nan", ".nan", "NaN", "inf", "-Infinity", "1e999", "1e300", "abc", "[]", '""'])
@pytest.mark.parametrize("name", TEXTS)
def test_invalid_number_is_refused(name, bad, read):
    text = text_of(name, get_format(name).MODELS[0])
    original = read(text)
    # After a letter in Hugin's scripts, a quotation mark in AliceVision's files, a tag in Metashape's.
    numbers = list(re.finditer(r"(?<=[\s\[,:>\"a-zA-Z])-?\d+\.\d+(?:e[-+]?\d+)?", text))
    assert len(numbers) > 2
    for found in numbers:
        spoiled = text[: found.start()] + bad + text[found.end() :]
        if survives(read, spoiled):  # then it was no number of the camera
            assert read(spoiled).model.params == pytest.approx(original.model.params, abs=0)


def asked(camera):
    """Ask a camera whatever its file says: what it gives is a number, without a warning."""
    directions = np.random.default_rng(0).normal(size=(40, 3))
    for values, valid in (
        camera.model.project_numpy(directions),
        camera.model.unproject_numpy(camera.border(8)),
        camera.model.project_numpy(camera.samples(count=5)[0]),
    ):
        assert np.isfinite(values[valid]).all()


@pytest.mark.parametrize(("name", "model"), [(f, m) for f, m in PAIRS if f not in BINARY])
def test_extreme_numbers_are_refused_or_project_without_warnings(name, model, read):
    """As warnings are errors here: the file that overflows when it projects is refused when it is read."""
    text = text_of(name, model)
    found = list(re.finditer(r"(?<=[\s\[,:(>])-?\d+\.\d+(?:e[-+]?\d+)?", text))[:14]
    ways = [{i: value} for value in ("1e11", "-1e11", "1e-300") for i in range(len(found))]
    ways += [dict.fromkeys(range(len(found)), value) for value in ("1e11", "-1e11", "1e7", "1e-300")]
    asked(read(text))
    for way in ways:
        spoiled = text
        for i in sorted(way, reverse=True):
            spoiled = spoiled[: found[i].start()] + way[i] + spoiled[found[i].end() :]
        with contextlib.suppress(FormatError):
            asked(read(spoiled))


NO_FOCAL_LENGTH = {
    *("native", "ocamcalib", "opensfm", "hugin", "alicevision", "woodscape", "metashape"),
    *("matlab", "multicol_slam", "py_ocamcalib", "py_omnicalib", "aria", "omnimvs"),
}


@pytest.mark.parametrize("name", sorted(set(TEXTS) - NO_FOCAL_LENGTH))
@pytest.mark.parametrize("value", ["0.0", "-300.0"])
def test_nonpositive_focal_length_is_refused(name, value, read):
    model = "pinhole" if "pinhole" in get_format(name).MODELS else "kannala_brandt"
    camera = example(name, model)
    text = get_format(name).serialize(camera)[0].replace(repr(float(camera.model.params[0])), value, 1)
    with pytest.raises(FormatError, match=r"positive.*got -?[03]"):
        read(text)


@pytest.mark.parametrize("name", sorted(set(TEXTS) - {"native", "opensfm", "woodscape"}))
@pytest.mark.parametrize("width", ["0", "-960", "9600000", "960.5"])
def test_invalid_image_size_is_refused(name, width, read):
    text = text_of(name, get_format(name).MODELS[0])
    spoiled = re.sub(r"(?<![\d.])960\b(?!\.)", width, text)
    assert spoiled != text
    with pytest.raises(FormatError, match=rf"width|known.*{width}|{width}"):
        read(spoiled)


@pytest.mark.parametrize("name", sorted(set(format_names()) - SIZE_UNKNOWN))
def test_unknown_image_size_is_refused_when_required(name, tmp_path):
    camera = dataclasses.replace(example(name, get_format(name).MODELS[0]), size=(0, 0))
    with pytest.raises(FormatError, match="size is not known"):
        save(camera, tmp_path / "camera", format=name)


DEEP = 100_000
HOSTILE = {
    "brackets": "cam0:\n  camera_model: pinhole\n  intrinsics: " + "[" * DEEP,
    "braces": '{"camera_type": ' + '{"a": ' * DEEP,
    "native": '{"format": "omnisight-camera", "a": ' + "[" * DEEP,
    "dashes": "model_type: MEI\na:\n  " + "- " * DEEP + "1",
    "steps": "model_type: MEI\n" + "".join(" " * i + f"a{i}:\n" for i in range(1000)),
    "digits": "model_type: " + "1" * 1_000_000 + "x",
    "spaces": "model_type: MEI\na" + " " * 1_000_000 + "\n",
    "quotes": "model_type: MEI\n" + 'a: "\\' * 100_000,
    "anchors": "model_type: &a [x]\nb: *a\n",
    "comments": "model_type: MEI\nb: [" + "#/" * 500_000,
    "tags": "model_type: MEI\nb: " + "!a " * 100_000,
    "colons": "model_type" + ":" * 1_000_000,
    "long": "model_type: MEI\nb: [" + "1.5, " * 3_000_000 + "1]\n",
    "names": "model_type: MEI\n" + "".join(f"n{i}: 1\n" for i in range(100_000)),
    "laughs": '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><opencv_storage>&b;</opencv_storage>',
    "elements": "<opencv_storage>" + "<a>" * DEEP,
    "mrcal": "{'lensmodel': " + "-" * DEEP + "1}",
    "colmap": "1 PINHOLE 10 10" + " 1" * 1_000_000,
    "ocamcalib": "5 " + "1 " * 1_000_000,
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_file_is_refused_quickly(kind, read):
    told = []

    def refused():
        with pytest.raises(FormatError) as error:
            read(HOSTILE[kind])
        told.append(str(error.value))

    assert_quick(refused, 150)  # the longest takes 32
    assert len(told[-1]) < 1500


def test_unknown_file_error_lists_known_formats(read, tmp_path):
    for text in ("hello", "<html></html>", "a: 1", "{}", "[]", "1,2,3\n4,5,6\n", "\0\1\2"):
        with pytest.raises(FormatError, match="known"):
            read(text)
    with pytest.raises(FormatError, match="empty"):
        read(" \n")
    with pytest.raises(FormatError, match="no such file"):
        load(tmp_path / "missing")


def test_name_selects_one_of_several_cameras(tmp_path):
    path = tmp_path / "cameras.txt"
    path.write_text("1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 600 600 320 240\n")
    assert set(load_all(path)) == {"1", "2"}
    with pytest.raises(FormatError, match="2 cameras: 1, 2"):
        load(path)
    assert load(path, name="2").model.params[0] == 600
    with pytest.raises(FormatError, match="no camera 'left'; it holds 1, 2"):
        load(path, name="left")


def test_small_unsupported_skew_is_refitted_with_note(tmp_path):
    model = dataclasses.replace(model_class("mei").example(), skew=0.05)
    written = save(Camera(model, (960, 720)), tmp_path / "camera", format="kalibr")
    assert 0 < written.error_px < 0.06
    assert "no skew" in written.notes[0]


def test_large_unsupported_skew_is_refused(tmp_path):
    model = dataclasses.replace(model_class("mei").example(), skew=30.0)
    with pytest.raises(FormatError, match=r"no skew of mei.*px off.*--model"):
        save(Camera(model, (960, 720)), tmp_path / "camera", format="kalibr")


def test_dropped_fields_are_noted(tmp_path):
    camera = dataclasses.replace(
        example("ros", "kannala_brandt"),
        theta_max=1.2,
        covariance=np.eye(8),
        calibration={"rms": 0.2},
        extra={"serial": 7},
    )
    notes = save(camera, tmp_path / "camera", format="ros").notes
    assert notes[0] == "not written: the calibrated field of view, the calibration figures, the covariance, serial"


@pytest.mark.parametrize(("variance", "kept"), [(4.5e12, True), (1e25, False), (np.inf, False), (np.nan, False)])
def test_a_camera_is_saved_whatever_its_covariance(variance, kept, tmp_path):
    model = model_class("mei").example()
    covariance = np.full((len(model.params),) * 2, variance)
    save(Camera(model, (1024, 768), covariance=covariance), tmp_path / "camera.json")
    read = load(tmp_path / "camera.json").covariance
    assert np.array_equal(read, covariance) if kept else read is None


def test_unknown_fields_are_kept_in_native_file(read, tmp_path):
    for name in ("kalibr", "opencv", "ros", "camodocal", "fisheye_calib_adapter"):
        camera = read(text_of(name, "kannala_brandt") + "serial: 7\nsize_mm: [6.4, 4.8]\nversion: old\n")
        save(camera, tmp_path / "native.json")
        again = load(tmp_path / "native.json")
        assert again.extra["serial"] == 7, name
        assert again.extra["size_mm"] == [6.4, 4.8], name
        assert again.extra["extra_version"] == "old", name


def test_the_suffix_determines_the_format_where_only_one_has_it(tmp_path):
    camera = Camera(model_class("pinhole").example(), (960, 720))
    for name, expected in (
        ("c.json", "native"),
        ("c", "native"),
        ("c.NPZ", "numpy_arrays"),
        ("c.cameramodel", "mrcal"),
    ):
        save(camera, tmp_path / name)
        assert load(tmp_path / name).provenance["format"] == expected


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("c.yaml", r"c\.yaml: \.yaml is the suffix of camodocal, .*kalibr.* opencv, .*; write c\.json and convert it"),
        ("c.yml", r"c\.yml: \.yml is the suffix of camodocal, "),
        ("c.jpg", r"c\.jpg: \.jpg is the suffix of no format; write c\.json"),
    ],
)
def test_a_suffix_of_several_formats_or_of_none_is_refused(name, message, tmp_path):
    with pytest.raises(FormatError, match=message):
        save(Camera(model_class("pinhole").example(), (960, 720)), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_camera_file_is_created(tmp_path):
    camera = Camera(model_class("pinhole").example(), (960, 720))
    assert load(save(camera, tmp_path / "new" / "folder" / "c.json").path).model == camera.model
