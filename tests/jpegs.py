"""JPEG files with an EXIF orientation, as cameras write them."""

import struct

import cv2


def jpeg(image, orientation=None, order="<"):
    """Encode a gray or RGB image, with an EXIF segment if an orientation is given; `order` is its byte order."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    if orientation is None:
        return data
    magic = b"II*\0" if order == "<" else b"MM\0*"
    tiff = magic + struct.pack(order + "IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    payload = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + data[2:]
