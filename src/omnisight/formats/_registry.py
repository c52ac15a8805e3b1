"""Find the format of a file, read and write calibration files."""

import dataclasses
import re
from collections.abc import Collection
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np

from omnisight.camera import Camera
from omnisight.extensions import did_you_mean, module_in, names_in
from omnisight.formats._export import max_difference_px
from omnisight.formats._files import encode, is_binary, read_file
from omnisight.formats._protocol import Format, FormatError, RigFormat, SaveResult
from omnisight.formats._readers import reader_note
from omnisight.geometry.rotation import log
from omnisight.images import IMAGE_SUFFIXES, write_bytes
from omnisight.images.output_paths import nearest_existing
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

PACKAGE = "omnisight.formats"
MAX_LISTED = 12  # names of cameras in a message
YAML_SUFFIXES = (".yaml", ".yml")
# The first field of a file of omnisight target, or of a target of Kalibr.
BOARD_FILE = re.compile(r'\s*(\{\s*"target"|target_type)\s*:')
# What a damaged file raises where no check has a better message.
PARSE_ERRORS = (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)


def format_names() -> tuple[str, ...]:
    """Return the names of all formats, sorted: the names of the files in this folder."""
    return names_in(PACKAGE)


def get_format(name: str) -> Format:
    """Return the format of this name; raise ValueError with the known names if there is none."""
    return cast(Format, module_in(PACKAGE, name, "format"))


def load(path: str | Path, *, name: str | None = None, option: str | None = "--name") -> Camera | RayCamera:
    """Read a camera from a calibration file of any format; the content determines the format.

    Parameters
    ----------
    path
        The file.
    name
        The camera to read if the file holds several.
    option
        The option of the command line that specifies `name`, which the message then advises; None if there is none.

    Raises
    ------
    FormatError
        If the file is not a calibration file, is damaged, or holds several cameras and `name` is not given.
    """
    cameras = load_all(path)
    if name is not None:
        if name not in cameras:
            raise FormatError(f"{path}: no camera {name!r}{did_you_mean(name, cameras)}; it holds {_listed(cameras)}")
        return cameras[name]
    if len(cameras) > 1:
        first = next(iter(cameras))
        raise FormatError(
            f"{path}: holds {len(cameras)} cameras: {_listed(cameras)}; specify one:"
            f"{f' {option} {first},' if option else ''} in Python name={first!r}, or write it to a file of its own:"
            f" omnisight convert {path} --name {first} --to native -o {first}.json"
        )
    return next(iter(cameras.values()))


def _listed(names: Collection[str]) -> str:
    """Return names, shortened."""
    return ", ".join([*islice(names, MAX_LISTED), *(["..."] if len(names) > MAX_LISTED else [])])


def load_all(path: str | Path) -> dict[str, Camera | RayCamera]:
    """Read all cameras of a calibration file of any format, by name."""
    text = read_file(Path(path))
    # The native format first: the import of those that precede it takes 0.04 s.
    for name in sorted(format_names(), key=lambda name: name != "native"):
        candidate = get_format(name)
        if not candidate.matches(text):
            continue
        source = {"file": Path(path).name, "format": name}
        try:
            cameras: dict[str, Camera | RayCamera] = {
                key: dataclasses.replace(camera, provenance=dict(camera.provenance) or source)
                for key, camera in candidate.parse(text).items()
            }
        except PARSE_ERRORS as error:
            raise FormatError(f"{path}: {candidate.TITLE}: {parse_error_message(error)}") from error
        if not cameras:
            raise FormatError(f"{path}: {candidate.TITLE}: holds no camera")
        return cameras
    raise FormatError(f"{path}: {_content(Path(path), text)}")


def _content(path: Path, text: str) -> str:
    """Return what a file of none of the formats is instead of a calibration."""
    if is_binary(text) and path.suffix.lower() in IMAGE_SUFFIXES:
        return "is an image, not a calibration file, which omnisight calibrate makes from images"
    if BOARD_FILE.match(text):
        return "describes a board (--target), not a camera"
    content = "binary data" if is_binary(text) else f"begins with {text.strip()[:40]!r}"
    return f"not a calibration file of a known format ({content}); known formats: {', '.join(format_names())}"


def parse_error_message(error: Exception) -> str:
    """Return the message of an error that a parser raised."""
    return str(error) if type(error) is ValueError else f"damaged ({type(error).__name__}: {error})"


def format_of_suffix(path: str | Path) -> str:
    """Return the format that a file name specifies: native for .json and names without a suffix.

    Raises
    ------
    FormatError
        If the suffix is that of several formats, or of none.
    """
    suffix = Path(path).suffix.lower()
    if suffix in ("", get_format("native").SUFFIX):
        return "native"
    same = YAML_SUFFIXES if suffix in YAML_SUFFIXES else (suffix,)
    names = [name for name in format_names() if get_format(name).SUFFIX in same]
    if len(names) == 1:
        return names[0]
    reason = f"{suffix} is the suffix of {', '.join(names)}" if names else f"{suffix} is the suffix of no format"
    raise FormatError(
        f"{path}: {reason}; write {Path(path).stem}.json and convert it: omnisight convert {Path(path).stem}.json --to"
        f" {(names or ['NAME'])[0]} -o {Path(path).name}, in Python format={(names or ['NAME'])[0]!r}"
    )


def save(
    camera: Camera | RayCamera | Rig, path: str | Path, *, format: str | None = None, max_error: float = float("inf")
) -> SaveResult:
    """Write a camera or a rig, read it back, and return the difference.

    The file is replaced atomically; its folder is created.

    Parameters
    ----------
    camera
        The camera or rig to write; `rig_format_names()` are the formats that hold rigs.
    path
        The file to write.
    format
        One of `format_names()`. By default that of the suffix: native for .json.
    max_error
        The largest difference (px) after reading back with which the file is written.

    Raises
    ------
    FormatError
        If the suffix does not determine the format, the format cannot hold the camera, the difference is too large, or
        the file cannot be written.
    """
    name = format_of_suffix(path) if format is None else format
    chosen = get_format(name)
    if isinstance(camera, Rig):
        return _save_rig(camera, Path(path), chosen, max_error)
    if isinstance(camera, RayCamera):
        return _save_rays(camera, Path(path), chosen, name)
    try:
        text, notes = chosen.serialize(camera)
        note = reader_note(camera, chosen.READERS)
        if chosen.COMMENT:
            text += chosen.COMMENT.format(note) + "\n"
        again = next(iter(chosen.parse(text).values()))
    except ValueError as error:
        raise FormatError(f"{path}: {chosen.TITLE}: {error}") from error
    error_px = difference_px(camera, again)
    if error_px > max_error:
        raise FormatError(
            f"{path}: {chosen.TITLE}: reads back {error_px:.3g} px off, {max_error:g} allowed; nothing was written"
        )
    _write(path, text)
    return SaveResult(Path(path), error_px, notes if name == "native" else (*notes, note))


def _save_rays(camera: RayCamera, path: Path, chosen: Format, format: str) -> SaveResult:
    """Write a non-central camera, which only the native format holds."""
    if format != "native":
        raise FormatError(
            f"{path}: {chosen.TITLE} holds central cameras, and this one is non-central ({camera.model.name}): save it"
            " as native, or save the central camera that fits at the distance of the scene: RayCamera.central,"
            " omnisight convert --distance"
        )
    from omnisight.formats.native import parse, serialize

    text, notes = serialize(camera)
    again = parse(text)["camera"]
    if not np.array_equal(again.model.params, camera.model.params):
        raise FormatError(f"{path}: {chosen.TITLE}: does not read back unchanged; nothing was written")
    _write(path, text)
    return SaveResult(path, 0.0, notes)


def _save_rig(rig: Rig, path: Path, chosen: Format, max_error: float) -> SaveResult:
    """Write a rig, read it back, and compare the cameras and their poses relative to the first one."""
    if not hasattr(chosen, "serialize_rig"):
        raise FormatError(f"{path}: {chosen.TITLE} holds no rigs; formats of rigs: {', '.join(rig_format_names())}")
    rig_format = cast(RigFormat, chosen)
    try:
        text, notes = rig_format.serialize_rig(rig)
        again = rig_format.parse_rig(text)
    except ValueError as error:
        raise FormatError(f"{path}: {chosen.TITLE} of a rig: {error}") from error
    pixels = [_sensor_difference_px(a, b) for a, b in zip(rig.cameras, again.cameras, strict=True)]
    angle, length = _pose_differences(rig, again)
    if max(pixels) > max_error:
        raise FormatError(
            f"{path}: {chosen.TITLE}: reads back {max(pixels):.3g} px off, {max_error:g} allowed; nothing was written"
        )
    _write(path, text)
    return SaveResult(path, max(pixels), (*notes, *_renamed(rig, again)), angle, length)


def _renamed(rig: Rig, again: Rig) -> tuple[str, ...]:
    """Return a note on the names of cameras that a format does not hold, or nothing."""
    pairs = [f"{old} is {new}" for old, new in zip(rig.names, again.names, strict=True) if old != new]
    return (f"the names of the cameras are those of the format: {_listed(pairs)}",) if pairs else ()


def _sensor_difference_px(camera: Camera | RayCamera, other: Camera | RayCamera) -> float:
    """Return the largest distance between the pixels of two cameras; of non-central ones, whether they are equal."""
    if isinstance(camera, Camera) and isinstance(other, Camera):
        return difference_px(camera, other)
    return 0.0 if np.array_equal(camera.model.params, other.model.params) else np.inf


def _pose_differences(rig: Rig, other: Rig) -> tuple[float, float]:
    """Return the largest differences (degrees, length) of the poses relative to the first camera."""
    pairs = list(zip(rig.with_reference(0).sensor_from_rig, other.with_reference(0).sensor_from_rig, strict=True))
    angles = [np.linalg.norm(log(a.rotation @ b.rotation.T)) for a, b in pairs]
    lengths = [np.linalg.norm(a.translation - b.translation) for a, b in pairs]
    return float(np.degrees(max(angles))), float(max(lengths))


def rig_format_names() -> tuple[str, ...]:
    """Return the names of the formats that hold rigs, sorted."""
    return tuple(name for name in format_names() if hasattr(get_format(name), "parse_rig"))


def is_rig_file(path: str | Path) -> bool:
    """Return whether a file is of a format of rigs and holds several cameras; their poses may be missing or damaged."""
    text = read_file(Path(path))
    chosen = next((name for name in format_names() if get_format(name).matches(text)), None)
    if chosen not in rig_format_names():
        return False
    try:
        return len(load_rig(path)) > 1
    except FormatError:
        return len(load_all(path)) > 1


def load_rig(path: str | Path) -> Rig:
    """Read a rig: cameras and their poses, from a file of any format that holds them.

    Raises
    ------
    FormatError
        If the file is not a rig, is damaged, or its extrinsics contradict each other, as inverted ones do.
    """
    text = read_file(Path(path))
    for name in rig_format_names():
        chosen = cast(RigFormat, get_format(name))
        if not chosen.matches(text):
            continue
        try:
            rig = chosen.parse_rig(text)
        except PARSE_ERRORS as error:
            raise FormatError(f"{path}: {chosen.TITLE} of a rig: {parse_error_message(error)}") from error
        return dataclasses.replace(rig, provenance={"file": Path(path).name, "format": name, **rig.provenance})
    raise FormatError(f"{path}: not a rig; formats of rigs: {', '.join(rig_format_names())}")


def _write(path: str | Path, text: str) -> None:
    """Write a file, in a new folder if necessary; raise `FormatError` if that fails."""
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, encode(text))
    except OSError as error:
        existing = nearest_existing(Path(path).parent)
        reason = (error.strerror or error) if existing.is_dir() else f"{existing} is a file, not a folder"
        raise FormatError(f"{path}: cannot be written: {reason}") from error


def difference_px(camera: Camera, other: Camera) -> float:
    """Return the largest distance (px) between the pixels of two cameras over the image of the first."""
    if not all(camera.size):
        # For an unknown size, assume that the principal point is the centre of the image.
        values = camera.model.to_dict()
        width, height = (max(2, round(2 * abs(values[key]))) for key in ("cx", "cy"))
        camera = dataclasses.replace(camera, size=(width, height))
    bearings, pixels = camera.samples()
    return max_difference_px(other.model, bearings, pixels) if len(bearings) else 0.0
