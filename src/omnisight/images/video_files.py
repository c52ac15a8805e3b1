"""Recognition of video files by their first bytes, before a decoder reads them."""

import os
from os import PathLike
from pathlib import Path
from typing import Any

from omnisight.extensions import file_error
from omnisight.images.headers import describe_start

VIDEO_SUFFIXES = (
    *(".mp4", ".mov", ".m4v", ".qt", ".3gp", ".3g2", ".avi", ".divx", ".mkv", ".webm", ".ogv", ".wmv", ".asf", ".flv"),
    *(".mpg", ".mpeg", ".mpe", ".m2v", ".vob", ".ts", ".m2t", ".mts", ".m2ts", ".mxf"),
    # The containers of Insta360 and GoPro MAX cameras.
    *(".insv", ".360"),
)
# First bytes of Matroska, MPEG program streams, MPEG elementary streams, ASF, Ogg, Flash and MXF.
SIGNATURES = (
    *(b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"),
    *(b"OggS", b"FLV\1", b"\x06\x0e\x2b\x34\x02\x05\x01\x01"),
)
# A limit on the top-level boxes of an MP4 file: a hostile file cannot stall the reader.
MAX_MP4_BOXES = 1000


def has_clip_suffix(path: str | PathLike[str]) -> bool:
    """Return whether a path has the extension of a video clip and is not a folder."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES and not Path(path).is_dir()


def find_defect(path: Path) -> str | None:
    """Return why a file must not be decoded, or None.

    Only known containers are decoded, since decoders also follow playlists, which refer to other files.
    """
    try:
        with path.open("rb") as file:
            head = file.read(400)
            if not head:
                return "empty file; copy it from the camera again"
            if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return None if _has_index(file) else "no index (moov): the recording or the copy is truncated"
    except OSError as error:
        return file_error(path, error)
    is_video = (
        (head.startswith(b"RIFF") and head[8:12] == b"AVI ")
        or head.startswith(SIGNATURES)
        # MPEG transport streams, without and with time stamps (M2TS).
        or (head[0] == 0x47 and head[188:189] == b"\x47")
        or (head[4] == 0x47 and head[196:197] == b"\x47" if len(head) > 196 else False)
    )
    return None if is_video else f"not a video ({describe_start(head)})"


def avi_frame_count(path: Path) -> int:
    """Read the number of frames from an AVI header, or 0; FFmpeg does not report it for a truncated file."""
    with path.open("rb") as file:
        head = file.read(52)
    return int.from_bytes(head[48:52], "little") if head[8:12] == b"AVI " and head[24:28] == b"avih" else 0


def _has_index(file: Any) -> bool:
    """Return whether an MP4 or MOV file (ISO/IEC 14496-12) has a complete moov box."""
    end, at = file.seek(0, os.SEEK_END), 0
    for _ in range(MAX_MP4_BOXES):
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            return False
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        at = end if length == 0 else at + length
        if head[4:8] == b"moov":
            return at <= end
        if length < 8 and length != 0:
            return False
    return False
