"""Which images of the cameras of a rig are simultaneous: by file name, number, order or time."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.pipeline.inputs.image_set import simultaneous_images
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A file of the times of a million images has 30 MB; a larger one is another file.
MAX_TIMES_BYTES = 50_000_000
# Columns of frame_time_history.csv, which caliscope writes beside the clips port_0.mp4, port_1.mp4, ...
CALISCOPE_COLUMNS = {"port": "camera", "frame_time": "seconds"}
# Share of the interval between two images of a camera up to which images of two cameras are simultaneous.
MAX_INTERVAL_SHARE = 0.5
# Difference (s) of timestamps in file names up to which images are simultaneous: half of the interval at 10 images per
# second, since images may have been left out.
MAX_STAMP_DIFFERENCE_S = 0.05
# Seconds per unit of a timestamp since 1970, by its number of digits.
STAMP_UNITS = {19: 1e-9, 16: 1e-6, 13: 1e-3}


@dataclass(frozen=True, eq=False)
class SimultaneousViews:
    """Which images of several cameras are simultaneous.

    Attributes
    ----------
    frame
        For each camera, the time of each image by its name, as an index.
    names
        Name of each time: that of its first image.
    rule
        What simultaneous images have in common: "name", "number", "order", "time", or "timestamp" if the times are
        those in the file names.
    seconds
        (F,) time of each index, s; None if unknown.
    delay
        For each camera, the time (s) of each image after that of its index; zero if unknown.
    """

    frame: tuple[Mapping[str, int], ...]
    names: tuple[str, ...]
    rule: str
    seconds: Array | None
    delay: tuple[Mapping[str, float], ...]

    def of_views(self, camera: int, views: Sequence[str]) -> tuple[Indices, Array]:
        """Return the time index (V,) and delay (V,) of the views of a camera, by their names."""
        images = [_image_of(view) for view in views]
        frames = np.array([self.frame[camera][image] for image in images], np.intp)
        return frames, np.array([self.delay[camera][image] for image in images], float)


def simultaneous_views(
    images: Mapping[str, Sequence[str]], times: Mapping[str, Mapping[str, float]] | None = None
) -> SimultaneousViews:
    """Determine which images of several cameras are simultaneous.

    Parameters
    ----------
    images
        Names of the images of each camera, by its name.
    times
        Time (s) of each image, by camera and name; None to use names.

    Raises
    ------
    ValueError
        If no rule finds simultaneous images, or times are missing.
    """
    names = [name for found in images.values() for name in found]
    stamps = _timestamps(images) if times is None else None
    if times is None and stamps is None:
        keys = [_key(name, camera) for camera, found in images.items() for name in found]
        index = np.repeat(np.arange(len(images)), [len(found) for found in images.values()])
        frame, rule = simultaneous_images(keys, index)
        seconds, delays = None, np.zeros(len(frame))
    else:
        given = times or {}
        taken = stamps or {name: _times_of(found, name, given.get(name, {})) for name, found in images.items()}
        frame, seconds, delays = _by_time(taken, np.inf if stamps is None else MAX_STAMP_DIFFERENCE_S)
        rule = "time" if stamps is None else "timestamp"
    first: dict[int, str] = {}
    for k, name in zip(frame.tolist(), names, strict=True):
        first.setdefault(k, name)
    labels = tuple(first.get(k, "") for k in range(int(frame.max(initial=-1)) + 1))
    rows = np.cumsum([0, *(len(found) for found in images.values())])
    sliced = [(list(found), slice(rows[k], rows[k + 1])) for k, found in enumerate(images.values())]
    return SimultaneousViews(
        tuple(dict(zip(found, frame[own].tolist(), strict=True)) for found, own in sliced),
        labels,
        rule,
        seconds,
        tuple(dict(zip(found, delays[own].tolist(), strict=True)) for found, own in sliced),
    )


def image_names(observations: Observations) -> list[str]:
    """Return the names of all images, those without a board too."""
    return list(dict.fromkeys(_image_of(image.name) for image in observations.images))


def _image_of(view: str) -> str:
    """Return the image of a view: a second board in an image is named `image #2`."""
    return re.sub(r" #\d+$", "", view)


def _key(name: str, camera: str) -> str:
    """Return the name of an image without its suffix and the name of its camera."""
    # "left1" contains the word left, but the camera "1" is no part of "0011".
    word = "a-z" if camera.isalpha() else "a-z0-9"
    return re.sub(rf"(?<![{word}]){re.escape(camera)}(?![{word}])", "", Path(name).stem, flags=re.IGNORECASE)


def _timestamps(images: Mapping[str, Sequence[str]]) -> dict[str, Array] | None:
    """Return the times (s) of the images of each camera from their names; None unless all names are timestamps.

    Timestamps are numbers of nanoseconds, microseconds or milliseconds since 1970. If two cameras have images of the
    same name, the names are used as they are: the times are those of a common trigger.
    """
    stems = {camera: [Path(name).stem for name in names] for camera, names in images.items()}
    every = [stem for found in stems.values() for stem in found]
    if not every or len(set(every)) < len(every):
        return None
    digits = {len(stem) for stem in every}
    if len(digits) != 1 or not all(stem.isdecimal() for stem in every) or (count := digits.pop()) not in STAMP_UNITS:
        return None
    # Seconds from the first image: a double holds nanoseconds since 1970 to 0.2 us only.
    origin = min(int(stem) for stem in every)
    return {
        camera: np.array([(int(s) - origin) * STAMP_UNITS[count] for s in found]) for camera, found in stems.items()
    }


def _by_time(taken: Mapping[str, Array], max_difference: float) -> tuple[Indices, Array, Array]:
    """Return the frame of each image, the time of each frame, and the delay of each image.

    Frames are the images of the first camera, and further images that are near none of them.
    """
    seconds = list[float]()
    frame, delays = list[int](), list[float]()
    for at in taken.values():
        known = np.array(seconds)
        interval = median_interval(at)
        used = set[int]()
        for moment in at:
            nearest = int(np.argmin(abs(known - moment))) if len(known) else -1
            limit = min(MAX_INTERVAL_SHARE * interval, max_difference)
            is_near = nearest >= 0 and abs(known[nearest] - moment) <= limit
            if is_near and nearest not in used:
                used.add(nearest)
                frame.append(nearest)
                delays.append(float(moment - known[nearest]))
            else:
                frame.append(len(seconds))
                seconds.append(float(moment))
                delays.append(0.0)
    return np.array(frame, np.intp), np.array(seconds), np.array(delays)


def median_interval(seconds: Array) -> float:
    """Return the median time (s) between successive images at times (N,); inf for a single image."""
    return float(np.median(np.diff(np.sort(seconds)))) if len(seconds) > 1 else np.inf


def _times_of(names: Sequence[str], camera: str, times: Mapping[str, float]) -> Array:
    """Return the times (s) of the images of a camera, given by file name, stem, or the last number in it."""
    by_number, found = frame_times(times), list[float]()
    for name in names:
        stem = Path(name).stem
        numbers = re.findall(r"\d+", stem)
        seconds = times.get(name, times.get(stem, by_number.get(int(numbers[-1])) if numbers else None))
        if seconds is None:
            raise ValueError(
                f"--times: no time for {name} of the camera {camera}: add a line {camera},{name},SECONDS, or one with"
                " the number of the image or frame in place of its name"
            )
        found.append(seconds)
    return np.array(found)


def frame_times(times: Mapping[str, float]) -> dict[int, float]:
    """Return the times (s) of the frames of a camera that are given by their numbers."""
    return {int(frame): seconds for frame, seconds in times.items() if frame.isdecimal()}


def read_times(path: Path) -> dict[str, dict[str, float]]:
    """Read the time (s) of each image, by camera and name, from a CSV file with the columns camera,frame,seconds.

    The file may also be a frame_time_history.csv of caliscope, whose cameras are named like its clips.

    Raises
    ------
    ValueError
        If a column is missing, or a time is not a number; the message names the file and the line.
    """
    if path.stat().st_size > MAX_TIMES_BYTES:
        raise ValueError(
            f"{path}: {path.stat().st_size} bytes; a file of times has at most {MAX_TIMES_BYTES}:"
            " specify a CSV file with the columns camera,frame,seconds"
        )
    try:
        return _times(path)
    except csv.Error as error:
        raise ValueError(f"{path}: is no CSV file: {error}") from error


def _times(path: Path) -> dict[str, dict[str, float]]:
    times: dict[str, dict[str, float]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.DictReader(file)
        columns = [name.strip() for name in reader.fieldnames or ()]
        is_caliscope = {*CALISCOPE_COLUMNS} <= {*columns}
        if is_caliscope:
            columns = [CALISCOPE_COLUMNS.get(name, name) for name in columns]
        elif missing := [name for name in ("camera", "frame", "seconds") if name not in columns]:
            raise ValueError(f"{path}: has no column {missing[0]}; the first line must be camera,frame,seconds")
        reader.fieldnames = columns
        for row in reader:
            try:
                seconds = float(row["seconds"])
            except (TypeError, ValueError):
                raise ValueError(f"{path}: line {reader.line_num}: {row['seconds']!r:.40} is no time in s") from None
            if not np.isfinite(seconds):
                raise ValueError(f"{path}: line {reader.line_num}: the time {row['seconds']!r:.40} is not finite")
            frame = str(reader.line_num) if is_caliscope else (row["frame"] or "").strip()
            times.setdefault((row["camera"] or "").strip(), {})[frame] = seconds
    return _of_caliscope(times) if is_caliscope else times


def _of_caliscope(times: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the times of the frames of clips of caliscope, by the port and the line of its file.

    Its frame_index is the counter of the camera: the number of a frame in the clip is the rank of its time.
    """
    return {
        f"port_{port}": {str(frame): seconds for frame, seconds in enumerate(sorted(lines.values()))}
        for port, lines in times.items()
    }
