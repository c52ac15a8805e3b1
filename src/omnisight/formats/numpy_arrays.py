"""NumPy's .npz of a camera matrix and coefficients, as scripts save what OpenCV gave them.

The arrays are told by the names that OpenCV's files use (K, mtx, camera_matrix; D, dist, distortion_coefficients; xi),
and mean what they mean there: px, integer pixel = pixel centre, k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4. Four
coefficients need a `fisheye` of 0 or 1 beside them. Most such files do not hold the image's size (`image_size`, width
and height). Nothing is unpickled, and sizes are checked before they are believed.
"""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, refuse
from omnisight.formats._numpy_file import ARRAY, NUMBERS, ZIP, read_npz
from omnisight.formats._opencv_lens import coefficients_of
from omnisight.formats.opencv import cameras_of

TITLE = "NumPy npz of K and D"
SUFFIX = ".npz"
MODELS = ("kannala_brandt", "mei", "radial_tangential", "rational", "pinhole", "unified")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 p1 p2 k3 ..., of a fisheye k1 k2 k3 k4"


def matches(text: str) -> bool:
    """Say whether this is a zip file or a NumPy array."""
    return text.startswith((ZIP, ARRAY))


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or each of a stereo pair."""
    if text.startswith(ARRAY):
        raise ValueError("a single array without a name; save both with np.savez('camera.npz', K=K, D=D, fisheye=1)")
    held = {key: _plain(value) for key, value in read_npz(text).items() if value.dtype.kind in NUMBERS}
    return cameras_of({key: value for key, value in held.items() if value is not None})


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the bytes, as text."""
    refuse(camera, MODELS)
    name, values = camera.model.name, camera.model.to_dict()
    build(name, values)
    skew = values.get("skew", 0.0)
    arrays: dict[str, Any] = {
        "K": np.array([[values["fx"], skew, values["cx"]], [0.0, values["fy"], values["cy"]], [0.0, 0.0, 1.0]]),
        "D": np.array(coefficients_of(values, name)),
    }
    notes: tuple[str, ...] = ("the image's size is not known, and so not written",)
    if all(camera.size):
        arrays["image_size"] = np.array(camera.size)
        notes = ()
    if "xi" in values:
        arrays["xi"] = np.array([values["xi"]])
    else:
        arrays["fisheye"] = np.array(int(name == "kannala_brandt"))
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue().decode("latin-1"), notes + left_out(camera)


def _plain(array: NDArray[Any]) -> Any:
    """Give an array as lists, a single number as it is, and None for what has more than two sides."""
    found = array.squeeze() if array.ndim > 2 else array
    return found.tolist() if found.ndim <= 2 else None
