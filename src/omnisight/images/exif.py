"""EXIF tags of JPEG files: orientation and position.

JEITA CP-3451, Exchangeable image file format for digital still cameras. Offsets and lengths are not trusted: what lies
outside the data is missing.
"""

import math
import struct
from typing import NamedTuple

from omnisight.images.headers import JPEG_MAGIC, jpeg_segments

_APP1, _SOS = 0xE1, 0xDA
_HEADER = b"Exif\0\0"
_FIRST_DIRECTORY_AT, _ENTRY_BYTES = 4, 12
_ORIENTATION, _GPS = 0x0112, 0x8825
_LATITUDE, _LONGITUDE, _ALTITUDE = 2, 4, 6  # the tag before each is its reference: N or S, E or W, above or below
# Types of values: BYTE, ASCII, SHORT, LONG and RATIONAL, with format of struct and number of its items in one value.
_TYPES = {1: ("B", 1), 2: ("B", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2)}

Directory = dict[int, tuple[int, ...]]


class GeodeticPosition(NamedTuple):
    """A position on the ellipsoid WGS 84.

    Attributes
    ----------
    latitude, longitude
        Degrees, north and east.
    altitude
        Metres; NaN if it is unknown.
    """

    latitude: float
    longitude: float
    altitude: float


def exif_orientation(data: bytes) -> int:
    """Read the EXIF orientation of a JPEG file.

    Parameters
    ----------
    data
        The file, or at least its first 64 KiB.

    Returns
    -------
    1 to 8 as in the EXIF standard; 1 (upright) if it is missing or invalid.
    """
    value = _first_directory(_tiff(data)).get(_ORIENTATION, ())
    return value[0] if len(value) == 1 and 1 <= value[0] <= 8 else 1


def exif_position(data: bytes) -> GeodeticPosition | None:
    """Read the position at which a JPEG file was taken; None if it is missing or invalid.

    Parameters
    ----------
    data
        The file, or at least its first 64 KiB.
    """
    tiff = _tiff(data)
    pointer = _first_directory(tiff).get(_GPS, ())
    gps = _directory(tiff, pointer[0]) if len(pointer) == 1 else {}
    latitude, longitude = _degrees(gps, _LATITUDE, ord("S")), _degrees(gps, _LONGITUDE, ord("W"))
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        return None
    altitude = _rationals(gps.get(_ALTITUDE, ()))
    sign = -1 if gps.get(_ALTITUDE - 1) == (1,) else 1
    return GeodeticPosition(latitude, longitude, sign * altitude[0] if len(altitude) == 1 else math.nan)


def _tiff(data: bytes) -> bytes:
    """Return the TIFF structure with the tags of a JPEG file; empty if there is none."""
    if data.startswith(JPEG_MAGIC):
        for marker, payload in jpeg_segments(data):
            if marker == _APP1 and payload.startswith(_HEADER):
                return payload[len(_HEADER) :]
            if marker == _SOS:
                break
    return b""


def _first_directory(tiff: bytes) -> Directory:
    order = _order(tiff)
    if order is None or len(tiff) < _FIRST_DIRECTORY_AT + 4:
        return {}
    return _directory(tiff, *struct.unpack_from(order + "I", tiff, _FIRST_DIRECTORY_AT))


def _order(tiff: bytes) -> str | None:
    """Return the byte order in the notation of struct."""
    return {b"II": "<", b"MM": ">"}.get(tiff[:2])


def _directory(tiff: bytes, at: int) -> Directory:
    """Return the integers of each tag of the directory at an offset; a rational has two."""
    order = _order(tiff)
    if order is None or at + 2 > len(tiff):
        return {}
    (entries,) = struct.unpack_from(order + "H", tiff, at)
    values: Directory = {}
    for entry in range(at + 2, min(at + 2 + _ENTRY_BYTES * entries, len(tiff) - _ENTRY_BYTES + 1), _ENTRY_BYTES):
        tag, kind, count = struct.unpack_from(order + "HHI", tiff, entry)
        letter, items = _TYPES.get(kind, ("", 0))
        size = count * items * struct.calcsize(letter)
        start = entry + 8 if size <= 4 else struct.unpack_from(order + "I", tiff, entry + 8)[0]
        if 0 < size <= len(tiff) - start:
            values[tag] = struct.unpack_from(f"{order}{count * items}{letter}", tiff, start)
    return values


def _degrees(gps: Directory, tag: int, negative: int) -> float:
    """Return an angle of degrees, minutes and seconds; NaN if it is missing."""
    parts = _rationals(gps.get(tag, ()))
    reference = gps.get(tag - 1, (0,))[0]
    if len(parts) != 3 or not reference:
        return math.nan
    angle = parts[0] + parts[1] / 60 + parts[2] / 3600
    return -angle if reference == negative else angle


def _rationals(values: tuple[int, ...]) -> tuple[float, ...]:
    """Return the quotients of pairs of numerator and denominator; NaN if that is 0."""
    return tuple(a / b if b else math.nan for a, b in zip(values[::2], values[1::2], strict=False))
