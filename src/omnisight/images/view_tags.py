"""EXIF tags of a photo that hold for its views, too: when, where, by whom, with which camera and exposure it was taken.

Tags of the size, the orientation and the focal length, and the thumbnail, are those of the photo alone.
"""

import struct
from collections.abc import Mapping
from pathlib import Path

from omnisight.images.exif import EXIF_BYTES, EXIF_CHUNK, EXIF_HEADER, GPS, Entry, ExifData
from omnisight.images.headers import JPEG_MAGIC, MAX_PAYLOAD, PNG_MAGIC, with_app1, with_png_chunk

_DETAILS = 0x8769
_LONG = 4
# Description, make and model, time, artist, copyright.
_FIRST_TAGS = (0x010E, 0x010F, 0x0110, 0x0132, 0x013B, 0x8298)
# Of the directory to which a tag of the first one points. Exposure time and f-number; ISO; version; times, their zones
# and fractions; exposure bias; owner and serial number; make and model of the lens. All of the position.
_TAGS_BELOW = {
    _DETAILS: (
        *(0x829A, 0x829D, 0x8827, 0x9000, 0x9003, 0x9004, 0x9010, 0x9011, 0x9012),
        *(0x9204, 0x9290, 0x9291, 0x9292, 0xA430, 0xA431, 0xA433, 0xA434),
    ),
    GPS: tuple(range(32)),
}


def view_tags(data: bytes) -> bytes:
    """Return the tags of a photo that hold for its views, for `with_view_tags`.

    Parameters
    ----------
    data
        A JPEG or PNG file, or at least its first `omnisight.images.exif.EXIF_BYTES`.

    Returns
    -------
    EXIF data; empty if there are no such tags, or if they do not fit into a segment of a JPEG file.
    """
    tags = ExifData(data)
    first = _chosen(tags.first, _FIRST_TAGS)
    below = {pointer: _chosen(tags.below(pointer), names) for pointer, names in _TAGS_BELOW.items()}
    below = {pointer: entries for pointer, entries in below.items() if entries}
    if not first and not below:
        return b""
    at = 8 + len(_directory(tags.order, first | dict.fromkeys(below, Entry(_LONG, 1, bytes(4))), 8))
    directories = list[bytes]()
    for pointer, entries in below.items():
        first[pointer] = Entry(_LONG, 1, struct.pack(tags.order + "I", at))
        directories.append(_directory(tags.order, entries, at))
        at += len(directories[-1])
    header = (b"II" if tags.order == "<" else b"MM") + struct.pack(tags.order + "HI", 42, 8)
    exif = b"".join([header, _directory(tags.order, first, 8), *directories])
    return exif if len(EXIF_HEADER) + len(exif) <= MAX_PAYLOAD else b""


def read_view_tags(path: Path) -> bytes:
    """Return the tags of a photo that hold for its views; see `view_tags`."""
    with path.open("rb") as file:
        return view_tags(file.read(EXIF_BYTES))


def with_view_tags(image: bytes, tags: bytes) -> bytes:
    """Return a JPEG or PNG file with tags of `view_tags`; other files, and those without tags, are returned as is."""
    if tags and image.startswith(JPEG_MAGIC):
        return with_app1(image, EXIF_HEADER + tags)
    if tags and image.startswith(PNG_MAGIC):
        return with_png_chunk(image, EXIF_CHUNK, tags)
    return image


def _chosen(entries: Mapping[int, Entry], tags: tuple[int, ...]) -> dict[int, Entry]:
    return {tag: entries[tag] for tag in tags if tag in entries}


def _directory(order: str, entries: Mapping[int, Entry], at: int) -> bytes:
    """Return the bytes of a directory at an offset, followed by its values that are longer than 4 bytes."""
    table, values = struct.pack(order + "H", len(entries)), b""
    values_at = at + 2 + 12 * len(entries) + 4
    for tag, entry in sorted(entries.items()):
        table += struct.pack(order + "HHI", tag, entry.kind, entry.length)
        if len(entry.data) <= 4:
            table += entry.data.ljust(4, b"\0")
        else:
            table += struct.pack(order + "I", values_at + len(values))
            values += entry.data + bytes(len(entry.data) % 2)  # offsets are even
    return table + bytes(4) + values
