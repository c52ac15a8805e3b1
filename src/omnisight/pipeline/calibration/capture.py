"""Capture of calibration images: the counterpart of `omnisight capture`."""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from omnisight.display import Displayed
from omnisight.images import read_image, write_image
from omnisight.images.live_camera import CameraFrame
from omnisight.images.output_paths import check_output_folder
from omnisight.persistent_interruption import until_interrupted
from omnisight.pipeline.calibration.capture_options import CaptureOptions
from omnisight.pipeline.calibration.capture_session import CaptureSession, JudgedCandidate
from omnisight.pipeline.calibration.capture_source import CaptureSource
from omnisight.targets.clip_detection import CandidateFrame, best_of_intervals

# Stored images: capture-001.png, ...
NAME = "capture-{:03d}.png"
NAME_PATTERN = re.compile(r"capture-(\d+)\.png")

Show = Callable[[CaptureSession, JudgedCandidate], None]


@dataclass(frozen=True)
class CaptureResult(Displayed):
    """The images of a capture; false if there is none.

    Attributes
    ----------
    images
        The stored images, those of earlier runs first.
    session
        What they show.
    searched, found
        Number of frames that were searched, and of those with the board.
    reason
        Why the capture ended: "coverage", "end" of the clip or folder, or "interrupted".
    rejected
        Number of frames that were not stored, by the advice of what to do; the most frequent first.
    """

    images: tuple[Path, ...]
    session: CaptureSession
    searched: int
    found: int
    reason: str
    rejected: Mapping[str, int]

    def __bool__(self) -> bool:
        """Return whether there are images."""
        return bool(self.images)


def capture(
    source: str | int,
    output: str | PathLike[str],
    options: CaptureOptions = CaptureOptions(),
    show: Show = lambda session, judged: None,
) -> CaptureResult:
    """Capture calibration images from a connected camera: those that are sharp, still and informative.

    The images of an earlier run in the same folder are continued.

    Parameters
    ----------
    source
        Number of the camera, such as 0; or a clip or a folder of images.
    output
        Folder of the images; it is created.
    options
        Options of the command; the board must be specified.
    show
        Called with the images so far and each searched frame.

    Returns
    -------
    The images. Ctrl-C ends the capture.

    Raises
    ------
    ValueError
        If the board is not specified or cannot be read, or the source cannot be opened.
    OSError
        If an image cannot be written.
    """
    board = options.board
    if board is None:
        raise ValueError("capture needs the board: specify its file (--target board.json) or its corners (--pattern)")
    frames = CaptureSource.open(str(source), apply_exif=options.apply_exif)
    folder, rejected = Path(output), Counter[str]()
    check_output_folder(folder, [] if str(source).isdigit() else [Path(str(source))])
    session = CaptureSession(board)
    images = _continue(session, folder)
    searched = found = 0
    reason = "end"
    with until_interrupted():
        reason = "interrupted"
        for candidate in frames.candidates:
            _check_size(session, candidate, frames.label)
            judged = session.judge(candidate)
            searched, found = searched + 1, found + (judged.detection is not None)
            if judged.advice:
                rejected[judged.advice] += 1
            else:
                folder.mkdir(parents=True, exist_ok=True)
                file = folder / NAME.format(_number(images) + 1)
                write_image(file, candidate.frame.image)  # Ctrl-C may interrupt it
                images.append(file)
                session.add(judged, file)
                session.estimate()
            show(session, judged)
            if is_complete(session, options):
                reason = "coverage"
                break
        else:
            reason = "end"
    return CaptureResult(tuple(images), session, searched, found, reason, dict(rejected.most_common()))


def is_complete(session: CaptureSession, options: CaptureOptions) -> bool:
    """Return whether there are enough images, and their corners cover enough of the visible directions."""
    enough = len(session.detections.images) >= options.images
    return enough and session.coverage is not None and 100 * session.coverage.share >= options.coverage


def _continue(session: CaptureSession, folder: Path) -> list[Path]:
    """Add the images of an earlier run that show the board; return all of them."""
    files = sorted(file for file in (folder.iterdir() if folder.is_dir() else ()) if NAME_PATTERN.fullmatch(file.name))
    for file in files:
        candidate = next(best_of_intervals([CameraFrame(0, 0.0, read_image(file))], 1))
        _check_size(session, candidate, str(file))
        judged = session.judge(candidate)
        if judged.detection is not None:
            session.add(judged, file)
    session.estimate()
    return files


def _check_size(session: CaptureSession, candidate: CandidateFrame, label: str) -> None:
    """Raise `ValueError` if a frame has another size than the images so far."""
    size, used = candidate.gray.shape[::-1], session.detections.size
    if session.detections.images and size != used:
        raise ValueError(
            f"{label}: {size[0]}x{size[1]} px, and the images so far are {used[0]}x{used[1]} px: a calibration needs"
            " images of one size; name another folder (--output)"
        )


def _number(images: list[Path]) -> int:
    """Return the largest number of an image."""
    return max((int(match[1]) for file in images if (match := NAME_PATTERN.fullmatch(file.name))), default=0)
