"""A sensor model: exposure, blur, noise, quantization to 8 bits and JPEG compression."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.random_process import gauss_markov
from omnisight.simulation.texture import to_display

Floats = NDArray[np.float32]

# The light that sRGB encodes as 128 of 255 (middle gray), and the derivative of the encoded value there.
MIDDLE_GRAY_LIGHT = 0.2158
MIDDLE_GRAY_SLOPE = 1.0752 * 255
# Share of the noise variance at middle gray that is read noise; the rest is photon noise.
READ_NOISE_SHARE = 0.01
DRIFT_CORRELATION_S = 10.0


def develop(
    light: Floats,
    rng: np.random.Generator,
    *,
    exposure: float = 0.0,
    blur: float = 0.7,
    noise: float = 1.5,
    jpeg: int | None = None,
) -> NDArray[np.uint8]:
    """Convert light to an image (H, W, 3) of 8 bits.

    Parameters
    ----------
    light
        (H, W, 3), 1 for white.
    rng
        Source of the noise.
    exposure
        Stops; each doubles the light.
    blur
        Standard deviation of the lens blur, px.
    noise
        Standard deviation at middle gray, of 255: photon noise (square root of the light) plus some read noise.
    jpeg
        Quality, 1 to 100, of a JPEG compression; None for none.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """
    import cv2

    check_sensor(exposure=exposure, blur=blur, noise=noise, jpeg=jpeg)
    exposed = light if exposure == 0 else light * np.float32(2.0**exposure)
    if blur > 0:
        exposed = np.asarray(cv2.GaussianBlur(exposed, (0, 0), blur))
    if noise > 0:
        photons = (1 - READ_NOISE_SHARE) * np.maximum(exposed, 0) / MIDDLE_GRAY_LIGHT
        variance = (noise / MIDDLE_GRAY_SLOPE) ** 2 * (READ_NOISE_SHARE + photons)
        exposed = exposed + np.sqrt(variance, dtype=np.float32) * rng.standard_normal(exposed.shape, np.float32)
    image = np.rint(255 * to_display(exposed)).astype(np.uint8)
    if jpeg is None:
        return image
    packed = np.asarray(cv2.imdecode(encode_jpeg(image, jpeg), cv2.IMREAD_COLOR), np.uint8)
    return np.ascontiguousarray(packed[..., ::-1])


def exposure_drift(times: NDArray[np.float64], sigma: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a slow random change (N,) of the exposure, stops, at times (N,), seconds.

    A Gauss-Markov process of standard deviation `sigma` that is correlated over 10 s, as of an automatic exposure.
    """
    return sigma * gauss_markov(times / DRIFT_CORRELATION_S, 1, rng)[:, 0]


def check_sensor(*, exposure: float, blur: float, noise: float, jpeg: int | None) -> None:
    """Check the ranges of the parameters of `develop`.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """
    for name, value, low, high in (
        *(("exposure", exposure, -20, 20), ("blur", blur, 0, 100), ("noise", noise, 0, 255)),
        ("jpeg", 75 if jpeg is None else jpeg, 1, 100),
    ):
        if not low <= value <= high:
            raise ValueError(f"{name} must be from {low} to {high}, got {value}")


def encode_jpeg(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Return an RGB image (H, W, 3) as the bytes of a JPEG file of a quality from 1 to 100."""
    import cv2

    options: Any = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], options)[1], np.uint8)
