"""Read NumPy's .npz files: arrays of numbers and of texts.

`numpy.load` allocates whatever size an array claims before it reads the data; this reader compares the two first.
Nothing is unpickled.
"""

import io
import math
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.formats._files import encode
from omnisight.formats._limits import MAX_ARRAYS, MAX_UNPACKED_BYTES

ZIP_SIGNATURE, ARRAY_SIGNATURE = "PK\x03\x04", "\x93NUMPY"
NUMBER_KINDS, TEXT_KINDS = "biuf", "US"  # of dtype.kind


def read_npz(text: str) -> dict[str, NDArray[Any]]:
    """Return the arrays by name; those that hold neither numbers nor texts are skipped.

    Raises
    ------
    ValueError
        If the file is damaged, or larger than any calibration.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(encode(text))) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            if not 0 < len(members) <= MAX_ARRAYS:
                raise ValueError(f"{len(members)} arrays in it; 1 to {MAX_ARRAYS} are read")
            arrays = {info.filename[:-4]: _array(archive, info) for info in members}
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ValueError(f"a damaged npz: {error}") from error
    except Exception as error:
        # zlib.error derives from Exception directly.
        raise ValueError(f"a damaged npz: {error}") if not isinstance(error, ValueError) else error from error
    return {name: array for name, array in arrays.items() if array is not None}


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any] | None:
    """Return an array, or None if it holds neither numbers nor texts."""
    with archive.open(info) as file:
        data = file.read(MAX_UNPACKED_BYTES + 1)
    if len(data) > MAX_UNPACKED_BYTES:
        raise ValueError(f"{info.filename[:40]} is larger than {MAX_UNPACKED_BYTES} bytes")
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = header(stream)
    if dtype.kind not in NUMBER_KINDS + TEXT_KINDS:
        return None
    body = data[stream.tell() :]
    if math.prod(shape) * dtype.itemsize != len(body):
        raise ValueError(f"{info.filename[:40]} claims {shape} of {dtype} in {len(body)} bytes")
    return np.frombuffer(body, dtype).reshape(shape, order="F" if fortran else "C")
