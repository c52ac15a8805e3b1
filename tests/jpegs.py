"""JPEG files as cameras write them: with an EXIF orientation."""

import struct

import cv2


def jpeg(image, orientation=None, order="<"):
    """Encode a gray or RGB image, without EXIF if it has no orientation; `order` is that of the EXIF's bytes."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    if orientation is None:
        return data
    mark = b"II*\0" if order == "<" else b"MM\0*"
    tiff = mark + struct.pack(order + "IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    payload = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + data[2:]
