"""Gyroflow's lens profile json.

`fisheye_params` holds OpenCV's camera matrix (px, integer pixel = pixel centre) and k1 ... k4 of OpenCV's fisheye, of
images of `calib_dimension`; a `distortion_model` that is null or `opencv_fisheye` says the same, `opencv_standard`
means OpenCV's k1 k2 p1 p2 k3 ... Its other models (poly3, poly5, ptlens, insta360, sony, gopro) are none of ours.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, numbers, picture_size, refuse, with_size
from omnisight.formats._opencv_lens import coefficients_of, focal_and_centre, lens
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map

TITLE = "Gyroflow lens profile json"
SUFFIX = ".json"
MODELS = ("kannala_brandt", "radial_tangential", "rational")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 k3 k4; the size is calib_dimension"
FISHEYE = (None, "", "opencv_fisheye")
PARAMS = re.compile(r'"fisheye_params"\s*:')
KNOWN = {"fisheye_params", "calib_dimension", "distortion_model"}
STRETCH = ("input_horizontal_stretch", "input_vertical_stretch")
KEPT = (
    *("name", "note", "calibrated_by", "camera_brand", "camera_model", "lens_model", "camera_setting", "identifier"),
    *("orig_dimension", "output_dimension", "frame_readout_time", "fps", "num_images", "date", "calibrator_version"),
)


def matches(text: str) -> bool:
    """Say whether this is JSON with `fisheye_params` and no file of our own."""
    return text.lstrip().startswith("{") and '"omnisight' not in text[:2000] and PARAMS.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    given, size = data["fisheye_params"], data.get("calib_dimension")
    if not isinstance(given, dict) or not isinstance(size, dict):
        raise ValueError("fisheye_params and calib_dimension must hold names and values")
    for name in STRETCH:
        # Zero is what it writes for none.
        if number(data.get(name) or 1.0, name) != 1:
            raise ValueError(f"{name} is {data[name]:g}: a lens that squeezes the image is none of our models")
    if data.get("digital_lens"):
        raise ValueError(f"digital_lens {str(data['digital_lens'])[:30]!r} stretches the image: none of our models")
    kind = data.get("distortion_model")
    if kind not in (*FISHEYE, "opencv_standard"):
        raise ValueError(f"no distortion_model {str(kind)[:30]!r} of ours; there are opencv_fisheye, opencv_standard")
    k = numbers(given.get("distortion_coeffs"), "distortion_coeffs")
    plane = focal_and_centre(given.get("camera_matrix"), "camera_matrix")
    model = lens(plane, k, fisheye=kind in FISHEYE)
    beside = {
        f"fisheye_{key}": value for key, value in given.items() if key not in ("camera_matrix", "distortion_coeffs")
    }
    extra = note_unknown(data, KNOWN) | beside
    return {"camera": Camera(model, picture_size(size.get("w"), size.get("h")), extra=extra)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with the names that the camera's file held or none."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    values = camera.model.to_dict()
    build(camera.model.name, values)
    dimension = {"w": width, "h": height}
    rms = camera.calibration.get("rms")
    fields: dict[str, Any] = {
        "name": "",
        "note": "",
        "calibrated_by": "",
        "camera_brand": "",
        "camera_model": "",
        "lens_model": "",
        "calib_dimension": dimension,
        "orig_dimension": dimension,
        **dict.fromkeys(STRETCH, 1.0),
        **{key: camera.extra[key] for key in KEPT if key in camera.extra},
        "fisheye_params": {
            "RMS_error": float(rms) if isinstance(rms, int | float) else 0.0,
            "camera_matrix": [[values["fx"], 0.0, values["cx"]], [0.0, values["fy"], values["cy"]], [0.0, 0.0, 1.0]],
            "distortion_coeffs": coefficients_of(values, camera.model.name),
            "radial_distortion_limit": camera.extra.get("fisheye_radial_distortion_limit"),
        },
        "distortion_model": "opencv_fisheye" if camera.model.name == "kannala_brandt" else "opencv_standard",
    }
    kept = (*KEPT, *STRETCH, "fisheye_RMS_error", "fisheye_radial_distortion_limit")
    return json.dumps(fields, indent=2) + "\n", left_out(camera, kept)
