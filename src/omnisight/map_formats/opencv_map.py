"""Maps of `cv2.remap`."""

import gzip
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.map_formats._protocol import MapFiles
from omnisight.map_formats._table import RemapTable, with_suffix
from omnisight.views.remapper import OUTSIDE_PX

TITLE = "OpenCV maps"
PROGRAMS = ("cv2", "opencv")
CONVENTION = f"(H, W, 2) float32: source pixel (u, v), top-left pixel centre (0, 0); {OUTSIDE_PX:g} if not covered"
# FileStorage writes what C++ programs read; .gz is compressed, because text takes 14 bytes a number.
SUFFIXES = (".npy", ".yml", ".yaml", ".xml", ".yml.gz", ".xml.gz")
FLAGS = {
    "nearest": "INTER_NEAREST",
    "bilinear": "INTER_LINEAR",
    "bicubic": "INTER_CUBIC",
    "lanczos": "INTER_LANCZOS4",
}


def convert(table: RemapTable, output: Path) -> MapFiles:
    """Return the map as an array of NumPy, or as a matrix `map` of OpenCV's FileStorage."""
    file = with_suffix(output, SUFFIXES)
    values = np.stack([table.filled(table.u, OUTSIDE_PX), table.filled(table.v, OUTSIDE_PX)], -1)
    if file.suffix == ".npy":
        data = BytesIO()
        np.save(data, values)
        return MapFiles(((file, data.getvalue()),), _usage(table, f'np.load("{file.name}")'))
    # The storage must outlive its nodes.
    opened = f'storage = cv2.FileStorage("{file.name}", cv2.FILE_STORAGE_READ); '
    return MapFiles(((file, _storage(values, file)),), opened + _usage(table, 'storage.getNode("map").mat()'))


def _usage(table: RemapTable, load: str) -> str:
    """Return the code that remaps an image by the map that an expression loads."""
    flags = f"None, cv2.{FLAGS[table.interpolation]}"
    if not table.is_periodic:
        return f"view = cv2.remap(image, {load}, {flags})"
    wrapped = f"cv2.remap(image, %s, {flags}, borderMode=cv2.BORDER_WRAP)"
    if table.covered.all():
        return f"view = {wrapped % load}"
    # The border also wraps what is not covered.
    return f"table = {load}; view = {wrapped % 'table'}; view[table[..., 0] == {OUTSIDE_PX:g}] = 0"


def _storage(values: NDArray[np.float32], file: Path) -> bytes:
    """Return a file of OpenCV's FileStorage, compressed if its name ends in .gz."""
    import cv2

    name = file.with_suffix("") if file.suffix == ".gz" else file
    storage = cv2.FileStorage(f"map{name.suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("map", values)
    text = storage.releaseAndGetString().encode()
    return gzip.compress(text, mtime=0) if file.suffix == ".gz" else text
