"""EXIF tags of JPEG and PNG files: orientation and position.

JEITA CP-3451, Exchangeable image file format for digital still cameras. Offsets and lengths are not trusted: what lies
outside the data is missing.
"""

import math
import struct
from typing import NamedTuple

from omnisight.images.headers import APP1, JPEG_MAGIC, PNG_MAGIC, jpeg_segments, png_chunks

# The tags precede the pixels, but other data may precede the tags.
EXIF_BYTES = 1 << 17
EXIF_HEADER, EXIF_CHUNK = b"Exif\0\0", b"eXIf"
GPS = 0x8825

_SOS, _PIXELS = 0xDA, b"IDAT"
_FIRST_DIRECTORY_AT, _ENTRY_BYTES = 4, 12
_ORIENTATION = 0x0112
_LATITUDE, _LONGITUDE, _ALTITUDE = 2, 4, 6  # the tag before each is its reference: N or S, E or W, above or below
# Types of values: BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SLONG and SRATIONAL, with format of struct and number
# of its items in one value.
_TYPES = {1: ("B", 1), 2: ("B", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2), 7: ("B", 1), 9: ("i", 1), 10: ("i", 2)}


class Entry(NamedTuple):
    """A tag of a directory: its type, its number of values, and their bytes."""

    kind: int
    length: int
    data: bytes


class ExifData:
    """The tags of an image file, in directories.

    Attributes
    ----------
    order
        Byte order in the notation of `struct`.
    first
        The entries of the first directory, by tag; empty if there are no tags.
    """

    def __init__(self, data: bytes) -> None:
        """Read the tags of a JPEG or PNG file, or of its first `EXIF_BYTES`."""
        self._tiff = _tiff(data)
        self.order = ">" if self._tiff[:2] == b"MM" else "<"
        is_complete = self._tiff[:2] in (b"II", b"MM") and len(self._tiff) >= _FIRST_DIRECTORY_AT + 4
        self.first = self._entries(*self._unpack("I", _FIRST_DIRECTORY_AT)) if is_complete else {}

    def below(self, pointer: int) -> dict[int, Entry]:
        """Return the entries of the directory to which a tag of the first one points; empty if it is missing."""
        offsets = self.integers(self.first.get(pointer))
        return self._entries(offsets[0]) if len(offsets) == 1 and offsets[0] >= 0 else {}

    def integers(self, entry: Entry | None) -> tuple[int, ...]:
        """Return the integers of an entry, two for a rational; empty if it is missing."""
        if entry is None:
            return ()
        letter, items = _TYPES[entry.kind]
        return struct.unpack(f"{self.order}{entry.length * items}{letter}", entry.data)

    def _entries(self, at: int) -> dict[int, Entry]:
        """Return the entries of the directory at an offset."""
        entries: dict[int, Entry] = {}
        if at + 2 > len(self._tiff):
            return entries
        (count,) = self._unpack("H", at)
        end = min(at + 2 + _ENTRY_BYTES * count, len(self._tiff) - _ENTRY_BYTES + 1)
        for start in range(at + 2, end, _ENTRY_BYTES):
            tag, kind, values = self._unpack("HHI", start)
            letter, items = _TYPES.get(kind, ("", 0))
            size = values * items * struct.calcsize(letter)
            value_at = start + 8 if size <= 4 else self._unpack("I", start + 8)[0]
            if 0 < size <= len(self._tiff) - value_at:
                entries[tag] = Entry(kind, values, self._tiff[value_at : value_at + size])
        return entries

    def _unpack(self, kinds: str, at: int) -> tuple[int, ...]:
        return struct.unpack_from(self.order + kinds, self._tiff, at)


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
    """Read the EXIF orientation of a JPEG or PNG file.

    Parameters
    ----------
    data
        The file, or at least its first `EXIF_BYTES`.

    Returns
    -------
    1 to 8 as in the EXIF standard; 1 (upright) if it is missing or invalid.
    """
    tags = ExifData(data)
    value = tags.integers(tags.first.get(_ORIENTATION))
    return value[0] if len(value) == 1 and 1 <= value[0] <= 8 else 1


def exif_position(data: bytes) -> GeodeticPosition | None:
    """Read the position at which a JPEG or PNG file was taken; None if it is missing or invalid.

    Parameters
    ----------
    data
        The file, or at least its first `EXIF_BYTES`.
    """
    tags = ExifData(data)
    gps = {tag: tags.integers(entry) for tag, entry in tags.below(GPS).items()}
    latitude, longitude = _degrees(gps, _LATITUDE, ord("S")), _degrees(gps, _LONGITUDE, ord("W"))
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        return None
    altitude = _rationals(gps.get(_ALTITUDE, ()))
    sign = -1 if gps.get(_ALTITUDE - 1) == (1,) else 1
    return GeodeticPosition(latitude, longitude, sign * altitude[0] if len(altitude) == 1 else math.nan)


def _tiff(data: bytes) -> bytes:
    """Return the TIFF structure with the tags of a JPEG or PNG file; empty if there is none."""
    if data.startswith(JPEG_MAGIC):
        for marker, payload in jpeg_segments(data):
            if marker == APP1 and payload.startswith(EXIF_HEADER):
                return payload[len(EXIF_HEADER) :]
            if marker == _SOS:
                break
    elif data.startswith(PNG_MAGIC):
        for kind, payload in png_chunks(data):
            if kind == EXIF_CHUNK:
                return payload
            if kind == _PIXELS:
                break
    return b""


def _degrees(gps: dict[int, tuple[int, ...]], tag: int, negative: int) -> float:
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
