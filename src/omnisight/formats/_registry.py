"""Finding a format, reading and writing files."""

import dataclasses
import json
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np

from omnisight.camera import Camera
from omnisight.extensions import module_in, names_in
from omnisight.formats._binary import read_file, to_bytes
from omnisight.formats._protocol import Format, FormatError, Written
from omnisight.images import write_bytes
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

PACKAGE = "omnisight.formats"
NAMED = 12  # cameras that a message names
# What reading a damaged file runs into, where no check of its own says it better.
DAMAGED = (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)


def format_names() -> tuple[str, ...]:
    """Give the names of all formats, sorted: the names of the files here."""
    return names_in(PACKAGE)


def format_named(name: str) -> Format:
    """Give the format of that name, or say which there are."""
    return cast(Format, module_in(PACKAGE, name, "format"))


def load(path: str | Path, *, name: str | None = None) -> Camera | RayCamera:
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
            raise FormatError(f"{path}: no camera {name!r}; it holds {_named(cameras)}")
        return cameras[name]
    if len(cameras) > 1:
        such = next(iter(cameras))
        raise FormatError(
            f"{path}: holds {len(cameras)} cameras: {_named(cameras)}; say which one: --name {such}, in Python"
            f" name={such!r}"
        )
    return next(iter(cameras.values()))


def _named(cameras: Mapping[str, Camera | RayCamera]) -> str:
    return ", ".join([*islice(cameras, NAMED), *(["..."] if len(cameras) > NAMED else [])])


def load_all(path: str | Path) -> dict[str, Camera | RayCamera]:
    """Read every camera of a calibration file of any format, by name."""
    text = read_file(Path(path))
    for name in format_names():
        candidate = format_named(name)
        if not candidate.matches(text):
            continue
        source = {"file": Path(path).name, "format": name}
        try:
            cameras: dict[str, Camera | RayCamera] = {
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


def save(
    camera: Camera | RayCamera, path: str | Path, *, format: str = "native", max_error: float = float("inf")
) -> Written:
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
    if isinstance(camera, RayCamera):
        return _save_rays(camera, Path(path), chosen, format)
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
    _write(path, text)
    return Written(Path(path), error_px, notes)


def _save_rays(camera: RayCamera, path: Path, chosen: Format, format: str) -> Written:
    """Write a camera of rays, which only our own format holds."""
    if format != "native":
        raise FormatError(
            f"{path}: {chosen.TITLE} holds cameras whose rays meet in a point, and this one's do not"
            f" ({camera.model.name}): save it as native, or save the central camera that fits at the distance of what"
            " you look at: RayCamera.central, omnisight convert --distance"
        )
    from omnisight.formats.native import parse, render

    text, notes = render(camera)
    again = parse(text)["camera"]
    if not np.array_equal(again.model.params, camera.model.params):
        raise FormatError(f"{path}: {chosen.TITLE}: does not read back as it is; nothing is written")
    _write(path, text)
    return Written(path, 0.0, notes)


def load_rig(path: str | Path) -> Rig:
    """Read a rig from omnisight's JSON.

    Raises
    ------
    FormatError
        If it is none, or is damaged.
    """
    from omnisight.formats.native import TITLE, rig_from_json

    text = read_file(Path(path))
    try:
        rig = rig_from_json(json.loads(text))
    except DAMAGED as error:
        said = str(error) if type(error) is ValueError else f"damaged ({type(error).__name__}: {error})"
        raise FormatError(f"{path}: {TITLE} of a rig: {said}") from error
    return dataclasses.replace(rig, provenance={"file": Path(path).name, "format": "native"})


def save_rig(rig: Rig, path: str | Path) -> Path:
    """Write a rig as omnisight's JSON; the file appears whole or not at all.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    from omnisight.formats.native import rig_to_json

    _write(path, json.dumps(rig_to_json(rig), indent=2, allow_nan=False) + "\n")
    return Path(path)


def _write(path: str | Path, text: str) -> None:
    try:
        write_bytes(path, to_bytes(text))
    except OSError as error:
        raise FormatError(str(error)) from error


def difference_px(camera: Camera, other: Camera) -> float:
    """Give the largest distance (px) between the pixels of two cameras, over the first one's image."""
    if not all(camera.size):
        # Where the size is not known, an image with the principal point in its middle stands in.
        middle = camera.model.to_dict()
        sides = (max(2, round(2 * abs(middle[key]))) for key in ("cx", "cy"))
        camera = dataclasses.replace(camera, size=(next(sides), next(sides)))
    bearings, pixels = camera.samples()
    if not len(bearings):
        return 0.0
    seen, valid = other.model.project_numpy(bearings)
    return float(np.linalg.norm(seen - pixels, axis=1).max()) if valid.all() else float("inf")
