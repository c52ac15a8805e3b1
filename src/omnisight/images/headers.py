"""The structure of JPEG and PNG files: checks before they are decoded, and their segments and chunks.

Decoders are too lenient for measurements: they return a truncated JPEG at full size with a gray lower part. These
checks read the structure only, not the pixels, and never read past the end of the data.
"""

import re
import struct
import zlib
from collections.abc import Iterator

JPEG_MAGIC = b"\xff\xd8\xff"
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
# Marker of a JPEG segment with EXIF tags or an XMP packet, and its largest payload.
APP1, MAX_PAYLOAD = 0xE1, 0xFFFF - 2

# Characters and bytes of other files that messages show.
SHOWN_CHARACTERS, SHOWN_BYTES = 16, 5

_SOI_LENGTH, _JFIF, _PNG_HEADER_LENGTH = 2, b"\xff\xe0", 13
_EOI, _SOS = 0xD9, 0xDA
_STANDALONE = frozenset({0x01, *range(0xD0, 0xD8)})
_FRAME_HEADERS = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
# In the coded data 0xff is followed by 0 (a stuffed byte), a restart marker or fill bytes. Anything else starts the
# next segment.
_NEXT_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]")


def describe_start(data: bytes) -> str:
    """Return the beginning of a file's content, readable: its text, or the first bytes in hexadecimal."""
    text = data[:SHOWN_CHARACTERS].decode("ascii", errors="replace").partition("\n")[0].rstrip()
    if text and text.isascii() and text.isprintable():
        return f"starts with the text {text!r}"
    return f"starts with the bytes {data[:SHOWN_BYTES].hex(' ')}"


def jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (marker, payload) of each JPEG segment without the coded data.

    The last one is the end-of-image marker; if it is missing, the data is truncated.
    """
    at = _SOI_LENGTH
    while at + 2 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        at += 2
        if marker == _EOI:
            yield marker, b""
            return
        if marker in _STANDALONE:
            continue
        length = int.from_bytes(data[at : at + 2], "big")
        if length < 2 or at + length > len(data):
            return
        yield marker, data[at + 2 : at + length]
        at += length
        if marker == _SOS:
            following = _NEXT_MARKER.search(data, at)
            if following is None:
                return
            at = following.start()


def find_jpeg_defect(data: bytes) -> str | None:
    """Return what is wrong with the structure of a JPEG file, or None."""
    markers = [marker for marker, _ in jpeg_segments(data)]
    if _EOI not in markers:
        return "truncated JPEG (no end-of-image marker)"
    if _SOS not in markers:
        return "JPEG without image data"
    return None


def find_png_defect(data: bytes) -> str | None:
    """Return what is wrong with the structure of a PNG file (chunk lengths, checksums, IEND), or None."""
    at = len(PNG_MAGIC)
    for kind, payload in png_chunks(data):
        checksum_at = at + 8 + len(payload)
        checksum = data[checksum_at : checksum_at + 4]
        if zlib.crc32(memoryview(data)[at + 4 : checksum_at]) != int.from_bytes(checksum, "big"):
            return f"damaged PNG (checksum of chunk {kind!r} at byte {at})"
        if kind == b"IEND":
            return None
        at = checksum_at + 4
    return "truncated PNG (no IEND chunk)"


def png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield (kind, payload) of each complete PNG chunk."""
    at = len(PNG_MAGIC)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if at + 12 + length > len(data):
            return
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


def with_app1(jpeg: bytes, payload: bytes) -> bytes:
    """Return a JPEG file with one more segment `APP1`, after the JFIF header, which must be the first one."""
    at = _SOI_LENGTH
    if jpeg[at : at + 2] == _JFIF:
        at += 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return jpeg[:at] + bytes([0xFF, APP1]) + (len(payload) + 2).to_bytes(2, "big") + payload + jpeg[at:]


def with_png_chunk(png: bytes, kind: bytes, payload: bytes) -> bytes:
    """Return a PNG file with one more chunk, after the header."""
    at = len(PNG_MAGIC) + 12 + _PNG_HEADER_LENGTH
    chunk = kind + payload
    return png[:at] + struct.pack(">I", len(payload)) + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[at:]


def declared_size(data: bytes) -> tuple[int, int] | None:
    """Read (width, height), px, from the header of a JPEG or PNG file; None for other formats."""
    if data.startswith(PNG_MAGIC) and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if data.startswith(JPEG_MAGIC):
        for marker, payload in jpeg_segments(data):
            if marker in _FRAME_HEADERS and len(payload) >= 5:
                height, width = struct.unpack_from(">HH", payload, 1)
                return width, height
    return None
