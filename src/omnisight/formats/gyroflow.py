"""Gyroflow's lens profile json.

`fisheye_params` holds OpenCV's camera matrix (px, integer pixel = pixel centre) and k1 ... k4 of OpenCV's fisheye, of
images of `calib_dimension`; so it does with a `distortion_model` of null or `opencv_fisheye`, while `opencv_standard`
means OpenCV's k1 k2 p1 p2 k3 ... The other models (poly3, poly5, ptlens, insta360, sony, gopro) are not supported.
"""

import json
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import export, kept_fields, unknown_fields
from omnisight.formats._opencv_lens import camera_matrix, coefficients_of, focal_and_centre, lens
from omnisight.formats._readers import Reader
from omnisight.formats._values import image_size, mapping, number, numbers
from omnisight.formats._yaml import read_map

TITLE = "Gyroflow lens profile json"
SUFFIX = ".json"
MODELS = ("kannala_brandt", "radial_tangential", "rational")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 k3 k4; the size is calib_dimension"
FISHEYE = (None, "", "opencv_fisheye")
KNOWN = {"fisheye_params", "calib_dimension", "distortion_model"}
STRETCH = ("input_horizontal_stretch", "input_vertical_stretch")
KEPT = (
    *("name", "note", "calibrated_by", "camera_brand", "camera_model", "lens_model", "camera_setting", "identifier"),
    *("orig_dimension", "output_dimension", "frame_readout_time", "fps", "num_images", "date", "calibrator_version"),
)
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with `fisheye_params`."""
    return is_json_with(text, "fisheye_params")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    given = mapping(data["fisheye_params"], "fisheye_params")
    size = mapping(data.get("calib_dimension"), "calib_dimension")
    for name in STRETCH:
        # Gyroflow writes zero for no stretch.
        if number(data.get(name) or 1.0, name) != 1:
            raise ValueError(f"{name} is {data[name]:g}: an anamorphic lens is not supported")
    if data.get("digital_lens"):
        raise ValueError(f"digital_lens {str(data['digital_lens'])[:30]!r} stretches the image and is not supported")
    kind = data.get("distortion_model")
    if kind not in (*FISHEYE, "opencv_standard"):
        raise ValueError(f"unknown distortion_model {str(kind)[:30]!r}; known are opencv_fisheye, opencv_standard")
    k = numbers(given.get("distortion_coeffs"), "distortion_coeffs")
    plane = focal_and_centre(given.get("camera_matrix"), "camera_matrix")
    model = lens(plane, k, fisheye=kind in FISHEYE)
    unknown = unknown_fields(given, ("camera_matrix", "distortion_coeffs"))
    extra = unknown_fields(data, KNOWN) | {f"fisheye_{key}": value for key, value in unknown.items()}
    return {"camera": Camera(model, image_size(size.get("w"), size.get("h")), extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the names that its file held."""
    exported = export(camera, MODELS)
    values = exported.values
    dimension = {"w": exported.size[0], "h": exported.size[1]}
    rms = camera.calibration.get("rms")
    fields: dict[str, Any] = {
        **dict.fromkeys(("name", "note", "calibrated_by", "camera_brand", "camera_model", "lens_model"), ""),
        "calib_dimension": dimension,
        "orig_dimension": dimension,
        **dict.fromkeys(STRETCH, 1.0),
        **kept_fields(camera, KEPT),
        "fisheye_params": {
            "RMS_error": float(rms) if isinstance(rms, int | float) else 0.0,
            "camera_matrix": camera_matrix(values),
            "distortion_coeffs": coefficients_of(values, camera.model.name),
            "radial_distortion_limit": camera.extra.get("fisheye_radial_distortion_limit"),
        },
        "distortion_model": "opencv_fisheye" if camera.model.name == "kannala_brandt" else "opencv_standard",
    }
    kept = (*KEPT, *STRETCH, "fisheye_RMS_error", "fisheye_radial_distortion_limit")
    return exported.result(json.dumps(fields, indent=2) + "\n", kept)
