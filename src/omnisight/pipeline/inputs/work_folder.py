"""Results of the stages of a long computation, kept in files to continue it after an interruption."""

import hashlib
import io
import shutil
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import omnisight
from omnisight.images import write_bytes

# Ending of the files: no others are deleted.
SUFFIX = ".stage.npz"
BATCH_FOLDER = "batch"

# What reading a damaged file raises.
DAMAGED = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error)

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class WorkFolder:
    """A folder of arrays that are named by what they were computed from; without a folder nothing is kept."""

    folder: Path | None = None

    def arrays(self, key: str, compute: Callable[[], Arrays]) -> Arrays:
        """Return the arrays of a key from their file, or compute and write them.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        if self.folder is None:
            return compute()
        file = self.folder / f"{key}{SUFFIX}"
        if (found := _read(file)) is not None:
            return found
        computed = compute()
        self.folder.mkdir(parents=True, exist_ok=True)
        write_bytes(file, to_bytes(computed))
        return computed

    @property
    def batch_folder(self) -> Path | None:
        """The folder of what workers compute."""
        return None if self.folder is None else self.folder / BATCH_FOLDER

    def remove(self) -> None:
        """Delete the files, and the folder and the one that contains it if they are then empty."""
        if self.folder is None or not self.folder.is_dir():
            return
        shutil.rmtree(self.folder / BATCH_FOLDER, ignore_errors=True)
        for file in self.folder.glob(f"*{SUFFIX}"):
            file.unlink()
        for folder in (self.folder, self.folder.parent):
            if not any(folder.iterdir()):
                folder.rmdir()


def digest(*parts: Any) -> str:
    """Return a text that differs with the contents of arrays, dataclasses and other values, and with the version."""
    total = hashlib.sha256(omnisight.__version__.encode())
    _update(total, parts)
    return total.hexdigest()[:40]


def _update(total: Any, part: Any) -> None:
    """Add the content of a value to a hash."""
    if isinstance(part, np.ndarray):
        total.update(f"{part.shape} {part.dtype.str}:".encode())
        total.update(np.ascontiguousarray(part).data)
    elif isinstance(part, list | tuple):
        total.update(f"{len(part)}:".encode())
        for each in part:
            _update(total, each)
    elif is_dataclass(part):
        total.update(f"{type(part).__name__}:".encode())
        _update(total, [getattr(part, field.name) for field in fields(part)])
    else:
        total.update(f"{part!r}:".encode())


def to_bytes(arrays: Arrays) -> bytes:
    """Return the content of a file of arrays."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def from_bytes(data: bytes) -> Arrays:
    """Return the arrays of a file's content; raise an error of `DAMAGED` if it is none."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _read(file: Path) -> Arrays | None:
    """Return the arrays of a file; None if it is missing or damaged."""
    try:
        return from_bytes(file.read_bytes())
    except DAMAGED:
        return None
