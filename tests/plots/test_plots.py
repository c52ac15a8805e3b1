"""Plots for notebooks."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import omnisight as om
from omnisight.models import model_class
from omnisight.optics.models.axial import Axial
from reporting import NAMES, UNUSED_NAMES, calibrate_detections, simulate_detections

matplotlib = pytest.importorskip("matplotlib")
LENS = model_class("kannala_brandt")(200.0, 199.0, 321.0, 242.0, 0.02, -0.01, 0.003, -0.001)
CAMERA = om.Camera(LENS, (640, 480), theta_max=1.2, covariance=1e-4 * np.eye(8))


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    detections = simulate_detections(tmp_path_factory.mktemp("images"))
    return calibrate_detections(detections, [*NAMES, *UNUSED_NAMES], model="kannala_brandt")


def drawn(figure):
    """Return the pixels of a figure; check that it is one and not blank."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    assert isinstance(figure, Figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    assert pixels[..., :3].std() > 10
    return pixels


def test_the_profile_is_that_of_the_camera():
    figure = om.plot_profile(om.perspective((640, 480), 90))
    drawn(figure)
    lines = {line.get_label(): line.get_xydata() for line in figure.axes[0].lines}
    theta, radius = lines["camera"].T
    assert len(theta) > 100
    np.testing.assert_allclose(radius, 320 * np.tan(np.radians(theta)), rtol=1e-6)


def test_the_profile_ends_where_the_calibration_does():
    lines = {line.get_label(): line.get_xydata() for line in om.plot_profile(CAMERA).axes[0].lines}
    assert lines["calibrated"][-1, 0] == pytest.approx(np.degrees(1.2), abs=0.5)
    assert lines["extrapolated"][-1, 0] > 80


def test_the_profile_of_a_panorama_is_continuous():
    for camera in (om.sphere(640), om.cylinder(640)):
        theta, radius = om.plot_profile(camera).axes[0].lines[-1].get_xydata().T
        assert theta[-1] > 175
        np.testing.assert_allclose(radius, camera.model.fx * np.radians(theta), rtol=1e-6)


def test_non_central_cameras_and_files_are_plotted(tmp_path):
    covariance = 1e-6 * np.eye(len(Axial.example().params))
    camera = om.RayCamera(Axial.example(), (960, 962), theta_max=1.5, covariance=covariance)
    om.save(camera, tmp_path / "axial.json")
    lens = om.plot_profile(om.Camera(camera.model.lens, camera.size)).axes[0].lines[-1].get_xydata()
    for source in (camera, tmp_path / "axial.json", str(tmp_path / "axial.json")):
        axes = om.plot_profile(source).axes[0]
        assert axes.get_title() == "axial, distant scene"
        profile = axes.lines[-1].get_xydata()
        np.testing.assert_allclose(profile, lens[: len(profile)], atol=1e-5)
        drawn(om.plot_uncertainty(source))
        drawn(om.plot_cameras(source))


def test_the_uncertainty_needs_a_covariance():
    drawn(om.plot_uncertainty(CAMERA))
    with pytest.raises(ValueError, match="the camera has no covariance"):
        om.plot_uncertainty(om.perspective())


def test_the_uncertainty_needs_an_image_size():
    with pytest.raises(ValueError, match="the camera has no image size"):
        om.plot_uncertainty(dataclasses.replace(CAMERA, size=(0, 0)))


def test_residuals_and_coverage_have_all_corners(calibration):
    count = len(calibration.observations.pixels)
    figure = om.plot_residuals(calibration)
    drawn(figure)
    arrows = [collection for collection in figure.axes[0].collections if hasattr(collection, "U")]
    assert sum(arrow.N for arrow in arrows) == count
    figure = om.plot_coverage(calibration)
    drawn(figure)
    points = [line for line in figure.axes[0].lines if line.get_marker() == "."]
    assert sum(len(line.get_xdata()) for line in points) == count
    assert len(points) == len(calibration.observations)


def test_the_difference_is_drawn_beside_the_uncertainties():
    other = om.Camera(LENS.with_params(LENS.params * 1.001), (640, 480), theta_max=1.1)
    figure = om.plot_difference(om.compare(CAMERA, other))
    drawn(figure)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["difference after the best rotation", "uncertainty of a (1σ)"]


def test_cameras_are_drawn_in_space(calibration):
    rig = om.Rig((CAMERA, CAMERA), (om.Pose(), om.Pose(translation=np.array([-0.2, 0, 0]))), ("left", "right"))
    figure = om.plot_cameras(rig)
    drawn(figure)
    assert [text.get_text() for text in figure.axes[0].texts] == ["left", "right"]
    drawn(om.plot_cameras(CAMERA))
    assert figure.axes[0].get_xlabel() == "x, m"
    boards = om.plot_cameras(calibration)
    drawn(boards)
    assert len(boards.axes[0].lines) == len(calibration.observations) + 3


def test_a_rig_fills_the_box(tmp_path):
    shifts = ([0.0, 0, 2.2], [1.0, 0, 0], [-1.0, 0, 0], [0.0, 0, -1.8])
    poses = tuple(om.Pose(translation=-np.array(shift)) for shift in shifts)
    rig = om.Rig((CAMERA,) * 4, poses, ("front", "right", "left", "rear"))
    om.save(rig, tmp_path / "rig.json")
    for source in (rig, tmp_path / "rig.json"):
        axes = om.plot_cameras(source).axes[0]
        centres = np.array(shifts)
        assert [text.get_text() for text in axes.texts] == list(rig.names)
        for low_high, values in ((axes.get_xlim(), centres[:, 0]), (axes.get_ylim(), centres[:, 2])):
            assert low_high[0] <= values.min()
            assert values.max() <= low_high[1]
            assert np.ptp(values) > 0.75 * np.ptp(low_high)


def test_figures_are_not_shown_twice_in_a_notebook():
    import matplotlib.pyplot as plt

    om.plot_profile(CAMERA)
    assert plt.get_fignums() == []


def test_without_matplotlib_the_message_names_the_extra():
    code = (
        "import sys; sys.modules['matplotlib'] = None; import omnisight as om\n"
        "try:\n    om.plot_profile(om.perspective())\n"
        "except ImportError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "plots need matplotlib: pip install 'omnisight[plot]'"


def test_a_calibration_is_shown_with_its_verdict(calibration):
    page = calibration._repr_html_()
    assert str(calibration.verdict) in page
    assert "<img" in page
    assert f"{calibration.rms:.3f} px" in page
