"""Images of ROS messages: sensor_msgs/Image and sensor_msgs/CompressedImage.

Encodings are those of `sensor_msgs/image_encodings.hpp`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images.read import MAX_PIXELS, UnreadableImage, decode_image

COMPRESSED_TYPE = "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = frozenset({"sensor_msgs/msg/Image", COMPRESSED_TYPE})

# Channels, bytes per channel, and the channels that are red, green, blue; none for gray.
PIXELS: dict[str, tuple[int, int, tuple[int, ...]]] = {
    "mono8": (1, 1, ()),
    "mono16": (1, 2, ()),
    "8UC1": (1, 1, ()),
    "16UC1": (1, 2, ()),
    "rgb8": (3, 1, (0, 1, 2)),
    "bgr8": (3, 1, (2, 1, 0)),
    "8UC3": (3, 1, (2, 1, 0)),
    "rgba8": (4, 1, (0, 1, 2)),
    "bgra8": (4, 1, (2, 1, 0)),
    "rgb16": (3, 2, (0, 1, 2)),
    "bgr16": (3, 2, (2, 1, 0)),
}
# Conversions by OpenCV to RGB: the codes name the first two rows of a Bayer pattern, and the order of YUV 4:2:2.
CONVERSIONS = {
    **{
        f"bayer_{order.lower()}{bits}": f"COLOR_Bayer{order}2RGB"
        for order in ("RGGB", "BGGR", "GBRG", "GRBG")
        for bits in (8, 16)
    },
    "yuv422": "COLOR_YUV2RGB_UYVY",
    "uyvy": "COLOR_YUV2RGB_UYVY",
    "yuv422_yuy2": "COLOR_YUV2RGB_YUYV",
    "yuyv": "COLOR_YUV2RGB_YUYV",
}


def image_of_message(message: Any, label: str) -> NDArray[Any]:
    """Return the image of a message.

    Parameters
    ----------
    message
        Message of one of `IMAGE_TYPES`.
    label
        Name of the message in errors.

    Returns
    -------
    Gray image (H, W) or RGB image (H, W, 3), uint8 or uint16.

    Raises
    ------
    UnreadableImage
        If its encoding is not supported, or its data are shorter than its size.
    """
    if message.__msgtype__ == COMPRESSED_TYPE:
        image = decode_image(bytes(message.data), label)
        return image if image.ndim == 2 else np.ascontiguousarray(image[..., :3])
    if message.encoding in PIXELS:
        channels, depth, order = PIXELS[message.encoding]
        image = _pixels(message, channels, depth, label)
        return np.ascontiguousarray(image[..., list(order)] if order else image[..., 0])
    if message.encoding in CONVERSIONS:
        import cv2

        is_yuv = "yu" in message.encoding
        depth = 2 if message.encoding.endswith("16") else 1
        image = _pixels(message, 2 if is_yuv else 1, depth, label)
        return np.asarray(cv2.cvtColor(image, getattr(cv2, CONVERSIONS[message.encoding])))
    raise UnreadableImage(
        f"{label}: the encoding {str(message.encoding)[:40]!r} is not supported; convert the images to rgb8 or mono8"
    )


def _pixels(message: Any, channels: int, depth: int, label: str) -> NDArray[Any]:
    """Return the pixels (H, W, channels) without the padding of rows."""
    width, height, step = int(message.width), int(message.height), int(message.step)
    row = width * channels * depth
    if min(width, height) < 1 or width * height > MAX_PIXELS or step < row or len(message.data) < step * height:
        raise UnreadableImage(
            f"{label}: {width}x{height} pixels in rows of {step} bytes do not fit {len(message.data)} bytes of data"
        )
    rows = np.asarray(message.data, np.uint8)[: step * height].reshape(height, step)[:, :row]
    kind = np.dtype(np.uint8 if depth == 1 else (">u2" if message.is_bigendian else "<u2"))
    pixels = np.ascontiguousarray(rows).view(kind).reshape(height, width, channels)
    return pixels.astype(kind.newbyteorder("="), copy=False)
