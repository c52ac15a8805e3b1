"""Spherical metadata of MP4 files, with which players show a sphere: Spherical Video V1 (uuid) and V2 (st3d, sv3d).

Google, spatial-media, docs/spherical-video-rfc.md and spherical-video-v2-rfc.md; boxes of ISO/IEC 14496-12.
"""

import os
import struct
from pathlib import Path

_UUID_V1 = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
_XML_V1 = (
    '<?xml version="1.0"?><rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
    ' xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/"><GSpherical:Spherical>true</GSpherical:Spherical>'
    "<GSpherical:Stitched>true</GSpherical:Stitched><GSpherical:StitchingSoftware>omnisight"
    "</GSpherical:StitchingSoftware><GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>"
    "</rdf:SphericalVideo>"
)
# Containers of MP4's boxes, in which the metadata of a sphere are written.
MP4_SUFFIXES = (".mp4", ".m4v", ".mov")
# Bytes of a VisualSampleEntry before its boxes: the header of the box and its fixed fields.
_SAMPLE_ENTRY_BYTES = 8 + 78
# Boxes on the way to the sample entry.
_PATH = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def tag_sphere(path: Path) -> None:
    """Add the metadata of an equirectangular sphere to the video track of an MP4 file whose index is its last box.

    Only the index is rewritten: the data before it do not move.

    Raises
    ------
    ValueError
        If the file has no such index, or no video track.
    """
    with path.open("r+b") as file:
        end, at = file.seek(0, os.SEEK_END), 0
        while at < end:
            file.seek(at)
            head = file.read(16)
            size = int.from_bytes(head[:4], "big")
            size = int.from_bytes(head[8:16], "big") if size == 1 else size or end - at
            if size < 8:
                raise ValueError(f"{path}: damaged MP4 file: box {head[4:8]!r} of {size} bytes at byte {at}")
            if head[4:8] == b"moov" and at + size == end:
                file.seek(at)
                moov = file.read(size)
                tagged = _rebuilt(moov, b"moov")
                if len(tagged) == len(moov):
                    raise ValueError(f"{path}: has no video track for spherical metadata")
                file.seek(at)
                file.write(tagged)
                return
            at += size
    raise ValueError(f"{path}: has no index at its end for spherical metadata")


def _split(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return type and bytes of consecutive boxes."""
    boxes: list[tuple[bytes, bytes]] = []
    at = 0
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if size == 1:
            size = int.from_bytes(data[at + 8 : at + 16], "big")
        size = len(data) - at if size == 0 else size
        if size < 8 or at + size > len(data):
            raise ValueError(f"damaged MP4 file: box {data[at + 4 : at + 8]!r} of {size} bytes at byte {at}")
        boxes.append((data[at + 4 : at + 8], data[at : at + size]))
        at += size
    return boxes


def _box(kind: bytes, payload: bytes) -> bytes:
    return struct.pack(">I", len(payload) + 8) + kind + payload


def _rebuilt(box: bytes, kind: bytes) -> bytes:
    """Return a box with spherical metadata in the video tracks below it."""
    if kind in _PATH:
        parts = [_rebuilt(child, name) for name, child in _split(box[8:])]
        if kind == b"trak" and b"vmhd" in box:
            parts.append(_box(b"uuid", _UUID_V1 + _XML_V1.encode()))
        return _box(kind, b"".join(parts))
    if kind == b"stsd" and _is_visual(box):
        entry = box[16:]
        grown = entry[4:] + _st3d() + _sv3d()
        return _box(b"stsd", box[8:16] + struct.pack(">I", len(grown) + 4) + grown)
    return box


def _is_visual(stsd: bytes) -> bool:
    """Return whether a sample description has one entry, of a video codec."""
    codecs = (b"avc1", b"avc3", b"hev1", b"hvc1", b"mp4v", b"vp09", b"av01")
    return stsd[12:16] == b"\0\0\0\1" and len(stsd) >= 16 + _SAMPLE_ENTRY_BYTES and stsd[20:24] in codecs


def _st3d() -> bytes:
    return _box(b"st3d", bytes(4) + b"\0")  # mono


def _sv3d() -> bytes:
    header = _box(b"svhd", bytes(4) + b"omnisight\0")
    pose = _box(b"prhd", bytes(4) + struct.pack(">iii", 0, 0, 0))
    bounds = _box(b"equi", bytes(4) + struct.pack(">IIII", 0, 0, 0, 0))
    return _box(b"sv3d", header + _box(b"proj", pose + bounds))
