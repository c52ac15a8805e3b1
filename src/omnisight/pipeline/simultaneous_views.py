"""Which views of the cameras of a rig are simultaneous: by file name, number, order or time."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.pipeline.image_set import simultaneous_images
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_TIMES_BYTES = 50_000_000
# Share of the interval between two images of a camera up to which images of two cameras are simultaneous.
MAX_INTERVAL_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class SimultaneousViews:
    """Groups of simultaneous views.

    Attributes
    ----------
    groups
        For each camera (V,) the group of each view.
    names
        Name of each group: that of its first image.
    rule
        What simultaneous images have in common: "name", "number", "order" or "time".
    seconds
        (G,) time of each group; None if unknown.
    delays
        For each camera (V,) time (s) of each view after that of its group; zero if unknown.
    images
        Number of images of each camera.
    """

    groups: tuple[Indices, ...]
    names: tuple[str, ...]
    rule: str
    seconds: Array | None
    delays: tuple[Array, ...]


def simultaneous_views(
    observations: Mapping[str, Observations], times: Mapping[str, Mapping[str, float]] | None = None
) -> SimultaneousViews:
    """Assign the views of all cameras to groups of simultaneous ones.

    Parameters
    ----------
    observations
        Observations of each camera by name.
    times
        Time (s) of each image, by camera and name; None to use names.

    Raises
    ------
    ValueError
        If no rule finds simultaneous images, or times are missing.
    """
    images = {camera: _image_names(o) for camera, o in observations.items()}
    if times is None:
        keys = [_key(name, camera) for camera, names in images.items() for name in names]
        index = np.repeat(np.arange(len(images)), [len(names) for names in images.values()])
        frame, rule = simultaneous_images(keys, index)
        seconds, delays = None, np.zeros(len(frame))
    else:
        frame, seconds, delays, index = _by_time(images, times)
        rule = "time"
    names = [name for found in images.values() for name in found]
    first: dict[int, str] = {}
    for k, name in zip(frame.tolist(), names, strict=True):
        first.setdefault(k, name)
    groups, view_delays = list[Indices](), list[Array]()
    for camera, o in enumerate(observations.values()):
        at = {name: k for k, name in zip(np.flatnonzero(index == camera).tolist(), _image_names(o), strict=True)}
        rows = np.array([at[_image_of(view)] for view in o.names], np.intp)
        groups.append(frame[rows])
        view_delays.append(delays[rows])
    count = int(frame.max(initial=-1)) + 1
    labels = tuple(first.get(k, "") for k in range(count))
    return SimultaneousViews(tuple(groups), labels, rule, seconds, tuple(view_delays))


def _image_names(observations: Observations) -> list[str]:
    """Return the names of all images, those without a board too."""
    return list(dict.fromkeys(image.name for image in observations.images))


def _image_of(view: str) -> str:
    """Return the image of a view: a second board in an image is named `image #2`."""
    return re.sub(r" #\d+$", "", view)


def _key(name: str, camera: str) -> str:
    """Return the name of an image without its suffix and the name of its camera."""
    # "left1" contains the word left, but the camera "1" is no part of "0011".
    word = "a-z" if camera.isalpha() else "a-z0-9"
    return re.sub(rf"(?<![{word}]){re.escape(camera)}(?![{word}])", "", Path(name).stem, flags=re.IGNORECASE)


def _by_time(
    images: Mapping[str, Sequence[str]], times: Mapping[str, Mapping[str, float]]
) -> tuple[Indices, Array, Array, Indices]:
    """Return the frame of each image, the time of each frame, the delay of each image, and its camera.

    Frames are the images of the first camera, and further images that are near none of them.
    """
    taken = {camera: np.array([_time(times, camera, name) for name in names]) for camera, names in images.items()}
    seconds = list[float]()
    frame, delays, index = list[int](), list[float](), list[int]()
    for camera, at in enumerate(taken.values()):
        known = np.array(seconds)
        interval = float(np.median(np.diff(np.sort(at)))) if len(at) > 1 else np.inf
        used = set[int]()
        for moment in at:
            nearest = int(np.argmin(abs(known - moment))) if len(known) else -1
            is_near = nearest >= 0 and abs(known[nearest] - moment) <= MAX_INTERVAL_SHARE * interval
            if is_near and nearest not in used:
                used.add(nearest)
                frame.append(nearest)
                delays.append(float(moment - known[nearest]))
            else:
                frame.append(len(seconds))
                seconds.append(float(moment))
                delays.append(0.0)
            index.append(camera)
    return np.array(frame, np.intp), np.array(seconds), np.array(delays), np.array(index, np.intp)


def _time(times: Mapping[str, Mapping[str, float]], camera: str, name: str) -> float:
    """Return the time of an image, given by its file name or its stem."""
    own = times.get(camera, {})
    found = own.get(name, own.get(Path(name).stem))
    if found is None:
        raise ValueError(f"--times: no time for {name} of the camera {camera}: add a line {camera},{name},SECONDS")
    return found


def read_times(path: Path) -> dict[str, dict[str, float]]:
    """Read the time (s) of each image, by camera and name, from a CSV file with the columns camera,frame,seconds.

    Raises
    ------
    ValueError
        If a column is missing, or a time is not a number; the message names the file and the line.
    """
    if path.stat().st_size > MAX_TIMES_BYTES:
        raise ValueError(f"{path}: {path.stat().st_size} bytes; a file of times has at most {MAX_TIMES_BYTES}")
    times: dict[str, dict[str, float]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.DictReader(file)
        columns = [name.strip() for name in reader.fieldnames or ()]
        if missing := [name for name in ("camera", "frame", "seconds") if name not in columns]:
            raise ValueError(f"{path}: has no column {missing[0]}; the first line must be camera,frame,seconds")
        reader.fieldnames = columns
        for row in reader:
            try:
                seconds = float(row["seconds"])
            except (TypeError, ValueError):
                raise ValueError(f"{path}: line {reader.line_num}: {row['seconds']!r:.40} is no time in s") from None
            if not np.isfinite(seconds):
                raise ValueError(f"{path}: line {reader.line_num}: the time {row['seconds']!r:.40} is not finite")
            times.setdefault((row["camera"] or "").strip(), {})[(row["frame"] or "").strip()] = seconds
    return times
