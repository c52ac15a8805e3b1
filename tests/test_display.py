"""Texts of all public types at the prompt, and their HTML in notebooks."""

import dataclasses
import inspect
import itertools
import re
import typing

import numpy as np
import pytest

import omnisight as om
from notebook_html import assert_html
from omnisight.display import MAX_LINES, Displayed, file_size, named_tuple_text, rounded, shortened
from omnisight.models import model_class, model_names
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.conversion.inspect import radial_profile
from omnisight.report.drawings.radial_profile import profile_svg

TYPES = sorted(
    name for name in om.__all__ if inspect.isclass(getattr(om, name)) and dataclasses.is_dataclass(getattr(om, name))
)
LENS = model_class("kannala_brandt")(200.0, 199.0, 321.0, 242.0, 0.02, -0.01, 0.003, -0.001)
CAMERA = om.Camera(LENS, (640, 480), theta_max=1.2, calibration={"rms": 0.25}, covariance=1e-4 * np.eye(8))
BEARINGS = np.random.default_rng(0).normal(size=(500, 3))
CLASSES_WITH_OWN_TEXT = {
    "Camera": lambda: CAMERA,
    "Pose": lambda: om.Pose(om.look(yaw=20), np.array([0.1, 0.2, 0.3])),
    "Rig": lambda: om.Rig((CAMERA,) * 6, (om.Pose(),) * 6, tuple("abcdef")),
}


def filled(cls):
    """Return an instance whose fields all hold large arrays, without the checks of the constructor."""
    value = object.__new__(cls)
    for field in dataclasses.fields(cls):
        object.__setattr__(value, field.name, np.zeros((1000, 3)))
    return value


def result_types():
    """Return the types of the package that public functions return and that the fields of results hold."""
    waiting, found = [], {}
    for name in om.__all__:
        value = getattr(om, name)
        if inspect.isclass(value):
            waiting.append(value)
        else:
            function = inspect.unwrap(value)
            waiting += [typing.get_type_hints(f)["return"] for f in [function, *typing.get_overloads(function)]]
    while waiting:
        hint = waiting.pop()
        waiting += [part for part in typing.get_args(hint) if not isinstance(part, str | int | float)]
        if isinstance(hint, type) and hint.__module__.startswith("omnisight.") and hint.__name__ not in found:
            found[hint.__qualname__] = hint
            if dataclasses.is_dataclass(hint) or hasattr(hint, "_fields"):
                waiting += typing.get_type_hints(hint).values()
    return found


RESULT_TYPES = result_types()


def assert_short(text):
    assert len(text.splitlines()) <= MAX_LINES
    assert max(map(len, text.splitlines())) <= 120
    assert "array(" not in text


@pytest.mark.parametrize("name", TYPES)
def test_every_public_dataclass_has_a_short_text(name):
    cls = getattr(om, name)
    assert issubclass(cls, Displayed)
    if cls.__repr__ is Displayed.__repr__:
        text = repr(filled(cls))
        assert text.startswith(f"{name}(")
        assert_short(text)
    elif name in CLASSES_WITH_OWN_TEXT:
        assert_short(repr(CLASSES_WITH_OWN_TEXT[name]()))
    else:
        # One f-string of figures: arrays are not formatted in it.
        source = inspect.getsource(cls.__repr__)
        assert len(source.splitlines()) < 12


@pytest.mark.parametrize("name", sorted(RESULT_TYPES))
def test_every_type_of_a_result_has_a_short_text(name):
    cls = RESULT_TYPES[name]
    if dataclasses.is_dataclass(cls):
        assert issubclass(cls, Displayed)
        if cls.__repr__ is Displayed.__repr__ and not inspect.isabstract(cls):
            assert_short(repr(filled(cls)))
    elif hasattr(cls, "_fields"):
        assert cls.__repr__ is named_tuple_text
        assert_short(repr(cls(*[np.zeros((1000, 3))] * len(cls._fields))))
    else:
        assert cls.__repr__ is not object.__repr__ or inspect.isabstract(cls)


def test_the_types_of_results_include_those_of_fields():
    assert {"ViewResult", "DesignResult", "Performance", "Proposal", "Verdict", "State"} <= set(RESULT_TYPES)
    assert len(RESULT_TYPES) > 150


def test_the_type_of_a_result_is_public():
    functions = [inspect.unwrap(getattr(om, name)) for name in om.__all__ if not inspect.isclass(getattr(om, name))]
    hints = [typing.get_type_hints(function)["return"] for function in functions]
    assert len(hints) > 50
    parts = {part for hint in hints for part in (hint, *typing.get_args(hint)) if isinstance(part, type)}
    own = {part.__name__ for part in parts if part.__module__.startswith("omnisight.")}
    assert own - set(om.__all__) == set()


def test_texts_of_named_tuples_and_of_objects():
    assert repr(om.sphere(512).fov) == "FieldOfView(horizontal=360, vertical=180, diagonal=180)"
    assert repr(om.PlaceIndex()) == "PlaceIndex(0 images, 0 descriptors)"
    assert repr(om.Odometry(CAMERA)) == "Odometry(0 frames, 0 poses, 0 keyframes)"
    comparison = om.compare(CAMERA, CAMERA)
    assert repr(comparison) == "CameraComparison(a, b: the cameras are equal to within 0.01 px)"
    diagnosis = om.doctor()
    assert repr(diagnosis).startswith(f"Diagnosis({diagnosis.level}, {len(diagnosis.findings)} checks")
    assert_short(repr(diagnosis))


@pytest.mark.parametrize("name", [name for name in TYPES if name.endswith("Options")])
def test_options_show_what_differs_from_the_default(name):
    cls = getattr(om, name)
    required = [f for f in dataclasses.fields(cls) if f.default is f.default_factory is dataclasses.MISSING]
    if not required:
        assert repr(cls()) == f"{name}()"


def test_a_text_has_the_fields_that_differ():
    assert repr(om.ViewOptions(yaw=40.0, size=(1280, 720))) == "ViewOptions(yaw=40, size=(1280, 720))"
    found = om.resect(BEARINGS, BEARINGS, sigma_deg=0.1)
    assert "inliers" not in repr(found)
    assert repr(found).startswith("AbsolutePose(cam_from_world=Pose(rotation=[0, 0, 0]°, translation=[0, 0, 0]), sigma")


def test_texts_of_cameras_poses_and_rigs():
    assert repr(CAMERA) == "Camera(kannala_brandt, 640x480, calibrated to 69° off-axis, rms 0.25 px)"
    pose = om.Pose(om.look(yaw=20), np.array([0.1, 0.2, 0.3]))
    assert repr(pose) == "Pose(rotation=[0, -20, 0]°, translation=[0.1, 0.2, 0.3])"
    assert repr(om.Rig((CAMERA,), (om.Pose(),), ("front",))) == (
        "Rig(1 camera\n    front: kannala_brandt, 640x480, at (0, 0, 0) m)"
    )


@pytest.mark.parametrize("name", model_names())
def test_camera_models_have_a_short_text(name):
    assert_short(repr(model_class(name).example()))


def test_a_long_text_ends_in_an_ellipsis():
    text = shortened("Result(" + ", ".join(f"field{i}={i}" for i in range(200)) + ")")
    assert len(text.splitlines()) == MAX_LINES
    assert text.endswith(" ...)")


def test_a_camera_is_shown_with_its_profile():
    assert_html(CAMERA, "kannala_brandt", "640 x 480", "off-axis")
    assert_html(om.sphere(512), "equirectangular")
    assert_html(om.Camera(LENS, (0, 0)), "unknown")


@pytest.mark.parametrize("camera", [CAMERA, om.perspective((640, 480), 90)])
def test_the_entries_of_the_legend_of_a_profile_do_not_overlap(camera):
    drawing = profile_svg(radial_profile(camera))
    entries = [(float(x), text) for x, text in re.findall(r'<text x="([\d.]+)" y="26"[^>]*>([^<]+)', drawing)]
    assert len(entries) >= 2
    for (x, text), (following, _) in itertools.pairwise(entries):
        assert x + 7 * len(text) < following - 28  # at most 7 px per letter, and the line of the next entry


def test_a_non_central_camera_is_shown_for_a_distant_scene():
    camera = om.RayCamera(Axial.example(), (960, 962), theta_max=1.2)
    assert_html(camera, "axial, non-central", "960 x 962", f"{camera.fov.horizontal:.1f}°", "distant scene")
    assert_html(om.RayCamera(Axial.example(), (0, 0)), "unknown")


def test_file_names_cannot_inject_markup():
    rig = om.Rig((CAMERA,), (om.Pose(),), ("<script>",))
    assert "<script>" not in assert_html(rig)


def test_poses_are_shown_in_space():
    rig = om.Rig(
        (CAMERA,) * 3, tuple(om.Pose(om.look(yaw=a), np.array([0.1 * a, 0, 0])) for a in (0, 30, 60)), tuple("abc")
    )
    assert_html(rig, "3 cameras")
    pose = om.relative_pose(BEARINGS, BEARINGS @ om.look(yaw=5).T + [0.1, 0, 0], sigma_deg=0.1)
    assert_html(pose, "inliers")
    failed = om.relative_pose(BEARINGS[:2], BEARINGS[:2])
    assert failed.reason in failed._repr_html_()


def test_what_has_no_file_has_no_html():
    assert om.ViewOptions()._repr_html_() is None


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (150.4, 2, "150"),
        (99.6, 2, "100"),
        (1.25e6, 3, "1250000"),
        (0.0123, 2, "0.012"),
        (0.0, 2, "0"),
        (1.2e-9, 2, "1.2e-09"),
        (np.nan, 2, "nan"),
        (np.float64(np.inf), 2, "inf"),
    ],
)
def test_large_numbers_are_printed_without_exponent(value, digits, text):
    assert rounded(value, digits) == text


@pytest.mark.parametrize(
    ("size", "text"),
    [(98, "98 bytes"), (12_345, "12.3 kB"), (999_900, "1000 kB"), (1_843_200, "1.84 MB"), (2_345_000_000, "2340 MB")],
)
def test_the_size_of_a_file_has_a_unit_that_fits(size, text):
    assert file_size(size) == text
