"""What a sensor makes of light: exposure, noise, values of 8 bits, and what JPEG leaves of them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.texture import to_display

Floats = NDArray[np.float32]

MIDDLE = 0.2158  # the light that sRGB shows as 128 of 255
SLOPE = 1.0752 * 255  # by which noise of that light grows as it is shown
READ_SHARE = 0.01  # of the noise's variance there that is not the photons'


def develop(
    light: Floats,
    rng: np.random.Generator,
    *,
    exposure: float = 0.0,
    blur: float = 0.7,
    noise: float = 1.5,
    jpeg: int | None = None,
) -> NDArray[np.uint8]:
    """Give the image that light (H, W, 3), 1 for white, leaves on a sensor.

    Parameters
    ----------
    light
        What comes through the lens.
    rng
        Makes the noise.
    exposure
        In stops: each doubles the light.
    blur
        Standard deviation of the lens' blur, px.
    noise
        Standard deviation at a middle gray, of 255: that of photons, as the root of the light, and a little read noise.
    jpeg
        Quality, 1 to 100, of the JPEG that it went through; None for none.

    Raises
    ------
    ValueError
        If a figure is out of its range.
    """
    import cv2

    check_sensor(exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
    seen = light if exposure == 0 else light * np.float32(2.0**exposure)
    if blur > 0:
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), blur))
    if noise > 0:
        variance = (noise / SLOPE) ** 2 * (READ_SHARE + (1 - READ_SHARE) * np.maximum(seen, 0) / MIDDLE)
        seen = seen + np.sqrt(variance, dtype=np.float32) * rng.standard_normal(seen.shape, np.float32)
    image = np.rint(255 * to_display(seen)).astype(np.uint8)
    if jpeg is None:
        return image
    packed = np.asarray(cv2.imdecode(encode_jpeg(image, jpeg), cv2.IMREAD_COLOR), np.uint8)
    return np.ascontiguousarray(packed[..., ::-1])


def check_sensor(*, exposure: float, blur: float, noise: float, jpeg: int | None) -> None:
    """Refuse figures out of their range; see `develop`.

    Raises
    ------
    ValueError
        Naming the figure and its range.
    """
    for what, value, least, most in (
        *(("exposure", exposure, -20, 20), ("blur", blur, 0, 100), ("noise", noise, 0, 255)),
        ("jpeg", 75 if jpeg is None else jpeg, 1, 100),
    ):
        if not least <= value <= most:
            raise ValueError(f"{what} must be from {least} to {most}, got {value}")


def encode_jpeg(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Give the bytes of an RGB image (H, W, 3) as a JPEG file of a quality from 1 to 100."""
    import cv2

    options: Any = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], options)[1], np.uint8)
