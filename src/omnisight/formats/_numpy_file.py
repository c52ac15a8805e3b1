"""Reading NumPy's .npz: arrays of numbers and of texts.

Not by `numpy.load`, which makes room for whatever size an array claims before it looks how much there is; the files
come from anywhere. Nothing is unpickled.
"""

import io
import math
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.formats._binary import to_bytes

ZIP, ARRAY = "PK\x03\x04", "\x93NUMPY"
LARGEST = 16_000_000  # bytes of one array
MOST = 100  # arrays
NUMBERS, TEXTS = "biuf", "US"


def read_npz(text: str) -> dict[str, NDArray[Any]]:
    """Give the arrays by name, in the shapes they were saved in; what holds neither numbers nor texts is passed over.

    Raises
    ------
    ValueError
        If the file is damaged, or larger than any calibration.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(to_bytes(text))) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            if not 0 < len(members) <= MOST:
                raise ValueError(f"{len(members)} arrays in it; a calibration has from 1 to {MOST}")
            found = {info.filename[:-4]: _array(archive, info) for info in members}
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ValueError(f"a damaged npz: {error}") from error
    except Exception as error:
        # zlib.error is none of the above.
        raise ValueError(f"a damaged npz: {error}") if not isinstance(error, ValueError) else error from error
    return {name: array for name, array in found.items() if array is not None}


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any] | None:
    """Give an array; None for what holds neither numbers nor texts."""
    with archive.open(info) as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise ValueError(f"{info.filename[:40]} is larger than {LARGEST} bytes")
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = header(stream)
    if dtype.kind not in NUMBERS + TEXTS:
        return None
    body = data[stream.tell() :]
    if math.prod(shape) * dtype.itemsize != len(body):
        raise ValueError(f"{info.filename[:40]} claims {shape} of {dtype} in {len(body)} bytes")
    return np.frombuffer(body, dtype).reshape(shape, order="F" if fortran else "C")
