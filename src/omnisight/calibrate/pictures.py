"""From boards found in pictures to a camera: look, calibrate roughly, look again, calibrate."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from omnisight.calibrate.calibration import Calibration, Progress, calibrate_camera, must_be_enough
from omnisight.calibrate.initialise import initialise
from omnisight.calibrate.second_pass import Won, second_pass
from omnisight.calibrate.views import BoardViews
from omnisight.targets import BoardSearch


@dataclass(frozen=True)
class PicturesCalibration:
    """A calibration and the pictures behind it.

    Attributes
    ----------
    calibration
        The camera, and what supports it; its views are the boards of `search`, picture by picture.
    search
        The boards as the second look found them.
    won
        What the second look brought.
    looked
        Seconds that it took.
    """

    calibration: Calibration
    search: BoardSearch
    won: Won
    looked: float


def calibrate_pictures(
    search: BoardSearch,
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
    """Calibrate a camera from boards found in pictures.

    A first camera tells where every corner must be and how the edges bend there; all are measured again so, and those
    that were missed are looked for.

    Parameters
    ----------
    search
        What `find_boards` found.
    names
        One for each picture; the files' unless told otherwise.
    model, loss, square, flat, force, progress
        As in `calibrate_camera`.
    apply_exif
        As in `find_boards`.

    Raises
    ------
    ValueError
        As `calibrate_camera`.
    """
    report = progress or (lambda stage, done, total: None)
    views = BoardViews.of_search(search, names)
    must_be_enough(views, force=force)
    report("start", 0, 1)
    start = initialise(views, search.size)
    report("start", 1, 1)
    begun = time.perf_counter()
    search, won = second_pass(
        search, views, start, apply_exif=apply_exif, progress=lambda done, total: report("look again", done, total)
    )
    looked = time.perf_counter() - begun
    views = BoardViews.of_search(search, names)
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
