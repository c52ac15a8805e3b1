"""From boards found in images to a camera: look, calibrate roughly, look again, calibrate."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.redetection import RedetectionStats, redetect
from omnisight.pipeline.central import Calibration, Progress, calibrate_camera, must_be_enough
from omnisight.targets import Detections
from omnisight.targets.observations import Observations


@dataclass(frozen=True)
class PicturesCalibration:
    """A calibration and the images behind it.

    Attributes
    ----------
    calibration
        The camera, and what supports it; its views are the boards of `search`, image by image.
    search
        The boards as the second look found them.
    won
        What the second look brought.
    looked
        Seconds that it took.
    """

    calibration: Calibration
    search: Detections
    won: RedetectionStats
    looked: float


def calibrate_pictures(
    search: Detections,
    *,
    names: Sequence[str] | None = None,
    model: str = "auto",
    loss: str = "huber",
    square: bool = False,
    flat: bool = False,
    force: bool = False,
    apply_exif: bool = False,
    progress: Progress | None = None,
) -> PicturesCalibration:
    """Calibrate a camera from boards found in images.

    A first camera tells where every corner must be and how the edges bend there; all are measured again so, and those
    that were missed are looked for.

    Parameters
    ----------
    search
        What `detect_boards` found.
    names
        One for each image; the files' unless told otherwise.
    model, loss, square, flat, force, progress
        As in `calibrate_camera`.
    apply_exif
        As in `detect_boards`.

    Raises
    ------
    ValueError
        As `calibrate_camera`.
    """
    report = progress or (lambda stage, done, total: None)
    views = Observations.of_search(search, names)
    must_be_enough(views, force=force)
    report("start", 0, 1)
    start = estimate_initial_camera(views, search.size)
    report("start", 1, 1)
    begun = time.perf_counter()
    search, won = redetect(
        search, views, start, apply_exif=apply_exif, progress=lambda done, total: report("look again", done, total)
    )
    looked = time.perf_counter() - begun
    views = Observations.of_search(search, names)
    calibration = calibrate_camera(
        views,
        search.size,
        model=model,
        loss=loss,
        square=square,
        flat=flat,
        force=force,
        start=start.model,
        field=search.field,
        progress=progress,
    )
    return PicturesCalibration(calibration, search, won, looked)
