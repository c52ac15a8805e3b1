"""Finding a format, reading and writing files."""

import dataclasses
import importlib
import pkgutil
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._binary import to_bytes, to_text
from omnisight.formats._protocol import Format, FormatError, Written
from omnisight.images import write_bytes

LARGEST = 50_000_000  # bytes; a calibration file is a few kilobytes
# What reading a damaged file runs into, where no check of its own says it better.
DAMAGED = (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)


@cache
def format_names() -> tuple[str, ...]:
    """Give the names of all formats, sorted: the names of the files here."""
    folder = [str(Path(__file__).parent)]
    return tuple(sorted(m.name for m in pkgutil.iter_modules(folder) if not m.name.startswith("_")))


def format_named(name: str) -> Format:
    """Give the format of that name, or say which there are."""
    if name not in format_names():
        raise ValueError(f"unknown format {name!r}; there are: {', '.join(format_names())}")
    return cast(Format, importlib.import_module(f"omnisight.formats.{name}"))


def load(path: str | Path, *, name: str | None = None) -> Camera:
    """Read a camera from a calibration file of any format, told by what it holds.

    Parameters
    ----------
    path
        The file.
    name
        Which camera, where the file holds several.

    Raises
    ------
    FormatError
        If it is no calibration file, is damaged, or holds several cameras and none was named.
    """
    cameras = load_all(path)
    if name is not None:
        if name not in cameras:
            raise FormatError(f"{path}: no camera {name!r}; it holds {', '.join(cameras)}")
        return cameras[name]
    if len(cameras) > 1:
        raise FormatError(f"{path}: holds {len(cameras)} cameras: {', '.join(cameras)}; say which one")
    return next(iter(cameras.values()))


def load_all(path: str | Path) -> dict[str, Camera]:
    """Read every camera of a calibration file of any format, by name."""
    text = _read(Path(path))
    for name in format_names():
        candidate = format_named(name)
        if not candidate.matches(text):
            continue
        source = {"file": Path(path).name, "format": name}
        try:
            cameras = {
                key: dataclasses.replace(camera, provenance=dict(camera.provenance) or source)
                for key, camera in candidate.parse(text).items()
            }
        except DAMAGED as error:
            said = str(error) if type(error) is ValueError else f"damaged ({type(error).__name__}: {error})"
            raise FormatError(f"{path}: {candidate.TITLE}: {said}") from error
        if not cameras:
            raise FormatError(f"{path}: {candidate.TITLE}: holds no camera")
        return cameras
    start = text.strip()[:40]
    raise FormatError(
        f"{path}: no calibration file that is known (begins with {start!r}); known are: {', '.join(format_names())}"
    )


def save(camera: Camera, path: str | Path, *, format: str = "native", max_error: float = float("inf")) -> Written:
    """Write a camera, read it again, and report the difference.

    The file appears whole or not at all.

    Parameters
    ----------
    camera
        What to write.
    path
        Where to; its folder must exist.
    format
        One of `format_names()`.
    max_error
        Do not write what reads back farther off than this, px.

    Raises
    ------
    FormatError
        If the format cannot hold the camera's model, reads back too far off, or the file cannot be written.
    """
    chosen = format_named(format)
    try:
        text, notes = chosen.render(camera)
        again = next(iter(chosen.parse(text).values()))
    except ValueError as error:
        raise FormatError(f"{path}: {chosen.TITLE}: {error}") from error
    error_px = difference_px(camera, again)
    if error_px > max_error:
        raise FormatError(
            f"{path}: {chosen.TITLE}: reads back {error_px:.3g} px off, {max_error:g} allowed; nothing is written"
        )
    try:
        write_bytes(path, to_bytes(text))
    except OSError as error:
        raise FormatError(str(error)) from error
    return Written(Path(path), error_px, notes)


def difference_px(camera: Camera, other: Camera) -> float:
    """Give the largest distance (px) between the pixels of two cameras, over the first one's picture."""
    if not all(camera.size):
        # Where the size is not known, a picture with the principal point in its middle stands in.
        middle = camera.model.to_dict()
        sides = (max(2, round(2 * abs(middle[key]))) for key in ("cx", "cy"))
        camera = dataclasses.replace(camera, size=(next(sides), next(sides)))
    bearings, pixels = camera.samples()
    if not len(bearings):
        return 0.0
    seen, valid = other.model.project_numpy(bearings)
    return float(np.linalg.norm(seen - pixels, axis=1).max()) if valid.all() else float("inf")


def _read(path: Path) -> str:
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise FormatError(f"{path}: is a folder, not a calibration file")
        if size > LARGEST:
            raise FormatError(f"{path}: {size} bytes; a calibration file has at most {LARGEST}")
        text = to_text(path.read_bytes())
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror}") from error
    if not text.strip():
        raise FormatError(f"{path}: empty file")
    return text
