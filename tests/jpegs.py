"""JPEG files with EXIF tags, as cameras write them."""

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


def jpeg_at(image, latitude, longitude, altitude=None, order="<"):
    """Encode an image taken at a position: degrees, and metres above the ellipsoid."""
    tags = [
        (1, 2, b"S\0" if latitude < 0 else b"N\0"),
        (2, 5, _sexagesimal(latitude, order)),
        (3, 2, b"W\0" if longitude < 0 else b"E\0"),
        (4, 5, _sexagesimal(longitude, order)),
    ]
    if altitude is not None:
        tags += [
            (5, 1, bytes([int(altitude < 0)])),
            (6, 5, struct.pack(order + "II", round(abs(altitude) * 1000), 1000)),
        ]
    magic = b"II*\0" if order == "<" else b"MM\0*"
    first = magic + struct.pack(order + "IHHHIII", 8, 1, 0x8825, 4, 1, 26, 0)
    data_at = 26 + 2 + 12 * len(tags) + 4
    entries, data = struct.pack(order + "H", len(tags)), b""
    for tag, kind, value in tags:
        count = len(value) // {1: 1, 2: 1, 5: 8}[kind]
        inline = len(value) <= 4
        entries += struct.pack(order + "HHI", tag, kind, count)
        entries += value.ljust(4, b"\0") if inline else struct.pack(order + "I", data_at + len(data))
        data += b"" if inline else value
    payload = b"Exif\0\0" + first + entries + struct.pack(order + "I", 0) + data
    plain = jpeg(image)
    return plain[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + plain[2:]


def _sexagesimal(degrees, order):
    """Return the rationals of degrees, minutes and seconds."""
    ten_thousandths = round(abs(degrees) * 36e6)
    minutes, seconds = divmod(ten_thousandths, 600_000)
    return struct.pack(order + "6I", minutes // 60, 1, minutes % 60, 1, seconds, 10_000)
