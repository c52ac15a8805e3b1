"""Spherical metadata of MP4 files, so that players show a sphere: Spherical Video V1 (uuid) and V2 (st3d, sv3d).

Google, spatial-media, docs/spherical-video-rfc.md and spherical-video-v2-rfc.md; boxes of ISO/IEC 14496-12.
"""

import struct

_UUID_V1 = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
_XML_V1 = (
    '<?xml version="1.0"?><rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
    ' xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/"><GSpherical:Spherical>true</GSpherical:Spherical>'
    "<GSpherical:Stitched>true</GSpherical:Stitched><GSpherical:StitchingSoftware>omnisight"
    "</GSpherical:StitchingSoftware><GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>"
    "</rdf:SphericalVideo>"
)
# Bytes of a VisualSampleEntry before its boxes: the header of the box and its fixed fields.
_SAMPLE_ENTRY_BYTES = 8 + 78
# Boxes on the way to the sample entry and to the tables of offsets.
_PATH = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def with_spherical_boxes(mp4: bytes) -> bytes:
    """Return an MP4 file with the metadata of an equirectangular sphere in its video track.

    Raises
    ------
    ValueError
        If the file has no video track.
    """
    boxes = _split(mp4)
    moov_at = sum(len(box) for _, box in boxes[: [kind for kind, _ in boxes].index(b"moov")])
    moov = mp4[moov_at : moov_at + next(len(box) for kind, box in boxes if kind == b"moov")]
    tagged = _rebuilt(moov, b"moov")
    if len(tagged) == len(moov):
        raise ValueError("the file has no video track for spherical metadata")
    # Data after the index moves by what the index grows.
    shifted = _with_offsets(tagged, len(tagged) - len(moov), moov_at)
    return mp4[:moov_at] + shifted + mp4[moov_at + len(moov) :]


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


def _with_offsets(box: bytes, shift: int, after: int, kind: bytes = b"moov") -> bytes:
    """Return a box where offsets of samples (stco, co64) beyond a byte are shifted."""
    if kind in _PATH:
        return _box(kind, b"".join(_with_offsets(child, shift, after, name) for name, child in _split(box[8:])))
    if kind not in (b"stco", b"co64"):
        return box
    letter = "I" if kind == b"stco" else "Q"
    (count,) = struct.unpack_from(">I", box, 12)
    offsets = struct.unpack_from(f">{count}{letter}", box, 16)
    moved = [offset + shift if offset > after else offset for offset in offsets]
    return box[:16] + struct.pack(f">{count}{letter}", *moved)
