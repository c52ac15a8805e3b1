"""The traps of OCamCalib's calib_results.txt."""

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, save
from omnisight.models import model_class

OCAM = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB).

5 -4.714441e+02 0.000000e+00 7.356108e-04 -3.773045e-07 5.800006e-10

#whatever a port says here
3 772.4 504.7 7.0

#camera center in pixel coordinates
300.25 400.75

#affine
1.000305 -0.000277 -0.000925

#image size
600 800
"""


def params(camera):
    return camera.model.to_dict()


def test_ocamcalib_centre_is_row_column_and_size_height_width(load_text):
    camera = load_text(OCAM)
    assert (camera.model.cx, camera.model.cy) == (400.75, 300.25)
    assert camera.size == (800, 600)


def test_ocamcalib_polynomial_changes_sign_because_z_points_back(load_text):
    camera = load_text(OCAM)
    assert camera.model.a == (471.4441, -7.356108e-04, 3.773045e-07, -5.800006e-10)
    with pytest.raises(FormatError, match=r"a0 must be negative.*471"):
        load_text(OCAM.replace("-4.714441e+02", "4.714441e+02"))


def test_ocamcalib_x_is_down_and_y_right(load_text):
    """A ray of OCamCalib's own cam2world, computed by its formula here."""
    camera = load_text(OCAM)
    row, column = 350.0, 500.0
    stretch = np.array([[1.000305, -0.000277], [-0.000925, 1.0]])
    x, y = np.linalg.solve(stretch, [row - 300.25, column - 400.75])
    z = np.polynomial.polynomial.polyval(np.hypot(x, y), [-4.714441e02, 0, 7.356108e-04, -3.773045e-07, 5.800006e-10])
    bearing, _ = camera.unproject([column, row])
    assert bearing == pytest.approx(np.array([y, x, -z]) / np.linalg.norm([x, y, z]), abs=1e-12)


def test_ocamcalib_a1_must_be_zero(load_text):
    assert len(load_text(OCAM.replace(" 0.000000e+00", " 1e-12", 1)).model.a) == 4
    with pytest.raises(FormatError, match=r"a1 must be 0.*0\.01"):
        load_text(OCAM.replace(" 0.000000e+00", " -0.01", 1))


def test_ocamcalib_wrong_inverse_polynomial_is_ignored_and_kept(load_text):
    wrong = load_text(OCAM.replace("3 772.4 504.7 7.0", "2 1 1"))
    assert wrong.model == load_text(OCAM).model
    assert wrong.extra == {"inverse_polynomial": [1.0, 1.0]}  # a good one is fitted anew, and need not be kept


DIRECT = "5 -4.714441e+02 0.000000e+00 7.356108e-04 -3.773045e-07 5.800006e-10"


@pytest.mark.parametrize(
    "direct",
    ["21 -400 0" + " 1e11" * 19, "21 -1e7 0" + " 1e12" * 19, "5 -400 0 1e-300 1e11 1e-300", "4 -400 0 -1e11 1e11"],
)
def test_ocamcalib_extreme_polynomials_project_finite_values(load_text, direct):
    camera = load_text(OCAM.replace(DIRECT, direct))
    bearings, valid = camera.model.unproject_numpy(camera.border())
    assert np.isfinite(bearings[valid]).all()
    pixels, valid = camera.model.project_numpy(bearings[valid])
    assert np.isfinite(pixels[valid]).all()


def test_ocamcalib_refuses_long_polynomials(load_text):
    with pytest.raises(FormatError, match=r"OCamCalib text: f\(r\) has 98 coefficients, at most 20 are read"):
        load_text(OCAM.replace(DIRECT, "99 -400 0" + " 1e11" * 97))
    with pytest.raises(FormatError, match=r"inverse polynomial: 100000 coefficients, at most 99 are read"):
        load_text(OCAM.replace("3 772.4 504.7 7.0", "100000" + " 1" * 100_000))


def test_ocamcalib_three_digit_exponents_of_windows(load_text):
    assert load_text(OCAM.replace("e-04", "e-004").replace("e+02", "e+002")).model == load_text(OCAM).model


def test_ocamcalib_counts_that_do_not_match_are_refused(load_text):
    with pytest.raises(FormatError, match="direct polynomial: claims 5 coefficients and has 4"):
        load_text(OCAM.replace(" 5.800006e-10", ""))
    with pytest.raises(FormatError, match="ends before the size"):
        load_text(OCAM.replace("600 800", ""))


def test_ocamcalib_writes_an_inverse_polynomial_that_its_own_programs_can_use(tmp_path):
    camera = Camera(model_class("ocam").example(), (1024, 768))
    save(camera, tmp_path / "calib_results.txt", format="ocamcalib")
    rows = [line.split() for line in (tmp_path / "calib_results.txt").read_text().splitlines() if line[:1] not in "#"]
    assert len(rows) == 5
    inverse = [float(word) for word in rows[1][1:]]
    seen = world2cam(camera, inverse)
    bearings, pixels = camera.samples()
    assert np.linalg.norm(seen(bearings) - pixels, axis=1).max() < 0.011


def world2cam(camera, inverse):
    """OCamCalib's world2cam with its inverse polynomial, in its frame."""
    m = camera.model

    def project(bearings):
        x, y, z = bearings[:, 1], bearings[:, 0], -bearings[:, 2]
        norm = np.maximum(np.hypot(x, y), 1e-300)
        rho = np.polynomial.polynomial.polyval(np.arctan2(z, norm), inverse)
        x, y = x / norm * rho, y / norm * rho
        return np.stack([x * m.e + y + m.cx, x * m.c + y * m.d + m.cy], -1)

    return project
