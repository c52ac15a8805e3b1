"""Write down what independent implementations make of a few cameras, so that the tests need none of them.

Run it with `pip install opencv-contrib-python-headless pycolmap`; it writes one JSON file per source beside itself.
Points are drawn with numpy's default_rng(SEED), uniform in the angle from the axis and at distances of 0.3 to 6; pixels
are in our convention (the centre of the top-left pixel is (0, 0)).
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import scipy
from scipy.interpolate import BSpline

SEED, COUNT = 20, 40
HERE = Path(__file__).parent
LENS = {"fx": 431.5, "fy": 429.25, "cx": 512.3, "cy": 383.1}

# What OpenCV projects with: our parameters, and the largest angle from the axis in degrees.
MEI = [
    ({"xi": 0.72, "k1": -0.05, "k2": 0.004, "p1": 3e-4, "p2": -2e-4, "skew": 0.0}, 110),
    ({"xi": 1.0, "k1": 0.01, "k2": 0.002, "p1": -4e-4, "p2": 1e-4, "skew": 1.5}, 125),
    ({"xi": 1.0, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "skew": 0.0}, 170),
    ({"xi": 1.85, "k1": -0.12, "k2": 0.03, "p1": 5e-4, "p2": 7e-4, "skew": -2.0}, 105),
]
KANNALA_BRANDT = [
    ({"k1": 0.03, "k2": -0.011, "k3": 0.0021, "k4": -0.00019}, 89.9),
    ({"k1": -0.013, "k2": 0.02, "k3": -0.012, "k4": 0.0023}, 89.9),
]
RADIAL_TANGENTIAL = [
    ({"k1": -0.28, "k2": 0.09, "p1": 4e-4, "p2": -3e-4, "k3": -0.012}, 45),
    ({"k1": 0.11, "k2": -0.04, "p1": -1e-3, "p2": 8e-4, "k3": 0.02}, 40),
]
RATIONAL = [
    (
        {"k1": 0.31, "k2": 0.05, "p1": 4e-4, "p2": -3e-4, "k3": 0.002, "k4": 0.62, "k5": 0.12, "k6": 0.011},
        75,
    ),
]

# COLMAP's model, ours, our parameters in COLMAP's order, the values of the last of them, and the largest angle.
# COLMAP's fisheyes take a point past 90 degrees for its mirror image in front of the camera: they are compared below.
COLMAP = [
    ("SIMPLE_PINHOLE", "pinhole", "f cx cy", (), 80),
    ("PINHOLE", "pinhole", "fx fy cx cy", (), 80),
    ("SIMPLE_RADIAL", "radial_tangential", "f cx cy k1", (-0.11,), 45),
    ("RADIAL", "radial_tangential", "f cx cy k1 k2", (-0.21, 0.05), 45),
    ("OPENCV", "radial_tangential", "fx fy cx cy k1 k2 p1 p2", (-0.21, 0.05, 4e-4, -3e-4), 45),
    (
        "FULL_OPENCV",
        "rational",
        "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
        (0.31, 0.05, 4e-4, -3e-4, 0.002, 0.62, 0.12, 0.011),
        75,
    ),
    ("SIMPLE_FISHEYE", "equidistant", "f cx cy", (), 89),
    ("FISHEYE", "equidistant", "fx fy cx cy", (), 89),
    ("SIMPLE_RADIAL_FISHEYE", "kannala_brandt", "f cx cy k1", (0.021,), 89),
    ("RADIAL_FISHEYE", "kannala_brandt", "f cx cy k1 k2", (0.021, -0.004), 89),
    ("OPENCV_FISHEYE", "kannala_brandt", "fx fy cx cy k1 k2 k3 k4", (0.03, -0.011, 0.0021, -0.00019), 89),
    ("FOV", "fov", "fx fy cx cy omega", (0.92,), 85),
    (
        "THIN_PRISM_FISHEYE",
        "thin_prism_fisheye",
        "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s2",
        (0.03, -0.011, 3e-4, -5e-4, 0.0021, -0.00019, 4e-4, -2e-4),
        89,
    ),
    (
        "RAD_TAN_THIN_PRISM_FISHEYE",
        "fisheye624",
        "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4",
        (0.03, -0.011, 0.0021, -0.00019, 2e-5, -3e-6, 3e-4, -5e-4, 4e-4, -3e-5, -2e-4, 2e-5),
        89,
    ),
    ("SIMPLE_DIVISION", "division", "f cx cy k", (-0.21,), 89),
    ("DIVISION", "division", "fx fy cx cy k", (-0.21,), 89),
    ("EUCM", "eucm", "fx fy cx cy alpha beta", (0.62, 1.08), 120),
]
ZEROS = {"radial_tangential": ("k1", "k2", "p1", "p2", "k3"), "kannala_brandt": ("k1", "k2", "k3", "k4")}

# Two calib_results.txt as OCamCalib wrote them: ss, invpol, (row, column), (c, d, e); and the largest angle.
OCAM = [
    (
        (-551.7655, 0.0, 8.372454e-4, -6.474789e-7, 1.235631e-9),
        (730.949123, 315.876984, -177.960849, -352.468231, -678.144608, -615.917273, -262.086205, -42.961956),
        (381.777786, 505.480427),
        (1.0, 0.0, 0.0),
        70,
    ),
    (
        (-471.4441, 0.0, 7.356108e-4, -3.773045e-7, 5.800006e-10),
        (
            *(772.405470, 504.754051, 7.034666, 45.327180, 54.651570),
            *(0.458049, -7.873745, 15.588713, 13.743404, 2.968883),
        ),
        (794.308657, 798.175741),
        (1.000305, -0.000277, -0.000925),
        100,
    ),
]


def points(limit_deg):
    rng = np.random.default_rng(SEED)
    theta = np.radians(limit_deg) * rng.uniform(0, 1, COUNT)
    phi = rng.uniform(-np.pi, np.pi, COUNT)
    directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    return directions * rng.uniform(0.3, 6, (COUNT, 1))


def case(function, model, params, given, pixels, tolerance_px=1e-9):
    values = {"of": function, "model": model, "params": params, "tolerance_px": tolerance_px}
    return values | {"points": given.tolist(), "pixels": np.asarray(pixels).reshape(-1, 2).tolist()}


def opencv():
    still = np.zeros(3)
    for table, function, model, order in (
        (MEI, "cv2.omnidir.projectPoints", "mei", "k1 k2 p1 p2"),
        (KANNALA_BRANDT, "cv2.fisheye.projectPoints", "kannala_brandt", "k1 k2 k3 k4"),
        (RADIAL_TANGENTIAL, "cv2.projectPoints", "radial_tangential", "k1 k2 p1 p2 k3"),
        (RATIONAL, "cv2.projectPoints", "rational", "k1 k2 p1 p2 k3 k4 k5 k6"),
    ):
        for shape, limit in table:
            params = LENS | shape
            k = np.array(
                [[params["fx"], params.get("skew", 0), params["cx"]], [0, params["fy"], params["cy"]], [0, 0, 1]]
            )
            d = np.array([params[name] for name in order.split()])
            given = points(limit)
            if model == "mei":
                pixels, _ = cv2.omnidir.projectPoints(given[:, None], still, still, k, params["xi"], d)
            elif model == "kannala_brandt":
                pixels, _ = cv2.fisheye.projectPoints(given[:, None], still, still, k, d)
            else:
                pixels, _ = cv2.projectPoints(given, still, still, k, d)
            yield case(function, model, params, given, pixels)


def colmap():
    for name, model, order, shape, limit in COLMAP:
        names = order.split()
        params = (
            LENS
            | dict.fromkeys(ZEROS.get(model, ()), 0.0)
            | dict(zip(names[len(names) - len(shape) :], shape, strict=True))
        )
        if names[0] == "f":
            params["fy"] = params["fx"]
        theirs = {**params, "f": params["fx"], "cx": params["cx"] + 0.5, "cy": params["cy"] + 0.5}
        camera = pycolmap.Camera(model=name, width=1024, height=768, params=[theirs[n] for n in names])
        given = points(limit)
        tolerance = 1e-8 if name == "FOV" else 1e-9  # near the axis COLMAP's FOV is a series
        yield case(name, model, params, given, camera.img_from_cam(given, check_cheirality=False) - 0.5, tolerance)
    width, height = 1024, 512
    camera = pycolmap.Camera(model="EQUIRECTANGULAR", width=width, height=height, params=[width, height])
    params = {"fx": width / (2 * np.pi), "fy": height / np.pi, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    given = points(179)
    yield case("EQUIRECTANGULAR", "equirectangular", params, given, camera.img_from_cam(given) - 0.5)


def ocamcalib():
    """Project as OCamCalib's world2cam does: its frame is x down, y right, z back; the inverse is an approximation."""
    for ss, invpol, (row, column), (c, d, e), limit in OCAM:
        params = {"cx": column, "cy": row, "c": c, "d": d, "e": e}
        params |= {f"a{i}": -value for i, value in enumerate(ss) if i != 1}
        given = points(limit)
        right, down, ahead = given.T
        radius = np.polynomial.polynomial.polyval(np.arctan2(-ahead, np.hypot(right, down)), invpol)
        x, y = radius * down / np.hypot(right, down), radius * right / np.hypot(right, down)
        pixels = np.stack([x * e + y + column, x * c + y * d + row], -1)
        yield case("world2cam with the file's inverse polynomial", "ocam", params, given, pixels, 0.01)


def bspline():
    """Project through scipy's B-splines, with control values drawn at random."""
    rng = np.random.default_rng(SEED)
    for spans, cells, limit in ((3, 1, 80), (9, 5, 110), (14, 8, 170)):
        reach, extent, side = np.radians(limit) * 1.05, 300.0 * np.radians(limit) * 1.1, cells + 3
        r = rng.uniform(270, 290, spans + 2)
        du, dv = rng.uniform(-2, 2, (2, side, side))
        params = {"cx": LENS["cx"], "cy": LENS["cy"], "reach": reach, "extent": extent}
        for name, values in (("r", r), ("du", du.ravel()), ("dv", dv.ravel())):
            params |= {f"{name}{i}": float(value) for i, value in enumerate(values)}
        given = points(limit)
        theta = np.arctan2(np.hypot(*given.T[:2]), given[:, 2])
        profile = BSpline(reach / spans * np.arange(-3, spans + 4), np.insert(r, 0, r[1]), 3)
        x, y = theta * profile(theta) * given.T[:2] / np.hypot(*given.T[:2])
        knots = 2 * extent / cells * np.arange(-3, cells + 4) - extent
        bend = np.stack([du, dv], -1)
        moved = [BSpline(knots, BSpline(knots, bend, 3)(b), 3)(a) for a, b in zip(x, y, strict=True)]
        pixels = np.stack([x, y], -1) + moved + (LENS["cx"], LENS["cy"])
        yield case("scipy.interpolate.BSpline", "spline", params, given, pixels)


if __name__ == "__main__":
    for file, source, cases in (
        ("opencv", f"OpenCV {cv2.__version__}", opencv()),
        ("colmap", f"pycolmap {pycolmap.__version__}", colmap()),
        ("ocamcalib", "OCamCalib's calib_results.txt of two cameras, and the formula of its world2cam", ocamcalib()),
        ("scipy", f"scipy {scipy.__version__}", bspline()),
    ):
        made = f"make_frozen.py, numpy {np.__version__}, default_rng({SEED}), {COUNT} points each"
        frozen = {"source": source, "made": made, "cases": list(cases)}
        (HERE / f"{file}.json").write_text(json.dumps(frozen, indent=1) + "\n")
