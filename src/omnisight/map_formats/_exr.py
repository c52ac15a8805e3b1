"""Writing of OpenEXR images: scan lines of 32-bit floats, compressed by ZIP.

OpenEXR file layout, Academy Software Foundation, https://openexr.com/en/latest/OpenEXRFileLayout.html. OpenCV's wheels
read and write no EXR.
"""

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

MAGIC, VERSION = 20000630, 2
FLOAT_PIXELS = 2
ZIP_COMPRESSION, ROWS_PER_BLOCK = 3, 16


def encode_exr(channels: Mapping[str, NDArray[np.float32]]) -> bytes:
    """Return an EXR file of channels (H, W), all of one shape, by name."""
    names = sorted(channels)  # the order that the format prescribes
    height, width = channels[names[0]].shape
    header = _header(names, width, height)
    blocks = list[bytes]()
    for first in range(0, height, ROWS_PER_BLOCK):
        # A block holds, row by row, the values of one channel after those of the other.
        rows = np.stack([channels[name][first : first + ROWS_PER_BLOCK] for name in names], axis=1)
        data = _compressed(np.ascontiguousarray(rows, "<f4").tobytes())
        blocks.append(struct.pack("<ii", first, len(data)) + data)
    start = len(header) + 8 * len(blocks)
    offsets = start + np.cumsum([0, *(len(block) for block in blocks[:-1])])
    return header + offsets.astype("<u8").tobytes() + b"".join(blocks)


def _header(names: list[str], width: int, height: int) -> bytes:
    """Return the magic number, the version and the attributes."""
    channels = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", FLOAT_PIXELS, 0, 1, 1) for name in names)
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    attributes = (
        ("channels", "chlist", channels + b"\0"),
        ("compression", "compression", struct.pack("<B", ZIP_COMPRESSION)),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", struct.pack("<B", 0)),  # increasing y
        ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        ("screenWindowCenter", "v2f", struct.pack("<ff", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
    )
    parts = [
        name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
        for name, kind, value in attributes
    ]
    return struct.pack("<ii", MAGIC, VERSION) + b"".join(parts) + b"\0"


def _compressed(data: bytes) -> bytes:
    """Return the bytes of a block: even and odd bytes apart, differences of neighbours, deflated."""
    raw = np.frombuffer(data, np.uint8)
    apart = np.concatenate([raw[::2], raw[1::2]])
    differences = apart.copy()
    differences[1:] = apart[1:] - apart[:-1] + np.uint8(128)
    packed = zlib.compress(differences.tobytes())
    return packed if len(packed) < len(data) else data  # a block that does not shrink is stored as it is
