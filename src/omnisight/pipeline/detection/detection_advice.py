"""Explanations of missing or poor detections, with what to do."""

from collections.abc import Sequence

import numpy as np

from omnisight.targets import Board, Checkerboard, Detections, ImageDetection, PointTarget
from omnisight.targets.boards.checkerboard import squares_text
from omnisight.targets.observations import Observations

# Gray levels of the board's white: above, it is clipped; below, noise is high.
CLIPPED_LEVEL, DARK_LEVEL = 253, 70
# Standard deviation (px) of the blur from which corners are clearly less exact.
BLURRED_PX = 2.5
# Ratio to the median rms of all images, and rms (px), above which an image stands out.
OUTLIER_RMS_RATIO, MIN_OUTLIER_RMS_PX = 2.5, 0.15
# Ratio to the median blur above which, and to the median sharpness below which, an image is less sharp than the others.
BLUR_RATIO, SHARPNESS_RATIO = 1.5, 0.5
# Files whose notes are listed in a message.
MAX_LISTED = 5


def board_advice(board: Board | PointTarget) -> str:
    """Return what to check if a board is not detected."""
    if isinstance(board, Checkerboard):
        size = f"{board} inner corners, which are {squares_text(board.columns, board.rows)}"
        return f"does it have {size}? Is it sharp, and lit evenly?"
    fields = ", ".join(f"{key} {value}" for key, value in board.to_dict().items() if key != "target")
    return f"is it really this {board.kind}: {fields}? Is it sharp, and large enough to decode its markers?"


def light_problems(image: ImageDetection) -> list[str]:
    """Return what is wrong with the sharpness or exposure of an image."""
    problems: list[str] = []
    if image.blur > BLURRED_PX:
        problems.append("blurred")
    if image.boards and image.exposure >= CLIPPED_LEVEL:
        problems.append("overexposed")
    if image.boards and image.exposure < DARK_LEVEL:
        problems.append("dark")
    return problems


class ForceRequired(ValueError):
    """Images from which a camera is calibrated only with --force.

    Attributes
    ----------
    reason
        Why, without the option.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        summary, line, notes = reason.partition("\n")
        super().__init__(f"{summary} (--force calibrates anyway){line}{notes}")


def explain_too_few_detections(observations: Observations, required: int) -> str:
    """Return why there are fewer views than required, and what to do."""
    if observations.detections is None:
        count = len(observations)
        return (
            f"{count} {'image' if count == 1 else 'images'} with a board: at least {required} are needed, 10 to 20 are"
            " good, with the board tilted and everywhere in the image"
        )
    detections = observations.detections
    number, total = len(detections.found), len(detections.images)
    notes = list_notes(detections)
    if isinstance(detections.board, PointTarget):
        summary = f"{number} of {total} images have enough corners; at least {required} are needed, 10 to 20 are good"
        return "\n".join([summary, *(f"  {note}" for note in detections.notes), *notes])
    if detections.board is None:
        return "\n".join([_describe_no_board(detections), *notes])
    kind = "board" if detections.board.kind == "checkerboard" else detections.board.kind
    summary = f"{detections.board} {kind} detected in {number} of {total} images"
    if number:
        summary += f"; at least {required} are needed, 10 to 20 are good"
    if number and number == total:
        return f"{summary}: take more, with the board tilted"
    return "\n".join([f"{summary}: {detections.hint or board_advice(detections.board)}", *notes])


def explain_no_detection(detections: Detections) -> str:
    """Return why no image shows the board, and what to do."""
    total = len(detections.images)
    if isinstance(detections.board, PointTarget):
        summary = f"none of {total} images has enough corners"
    elif detections.board is None:
        summary = _describe_no_board(detections)
    else:
        advice = detections.hint or board_advice(detections.board)
        summary = f"{detections.board} board detected in none of {total} images: {advice}"
    return "\n".join([summary, *list_notes(detections)])


def _describe_no_board(detections: Detections) -> str:
    sizes = [image.size for image in detections.images if image.size is not None]
    are_spheres = bool(sizes) and all(width == 2 * height for width, height in sizes)
    return (
        f"no checkerboard, markers or grid of circles detected in {len(detections.images)} images:"
        f"{' equirectangular images (2:1) need no calibration;' if are_spheres else ''} if they show a board, specify"
        " --pattern, its inner corners as columns x rows such as 9x6, or --target"
    )


def describe_image_outliers(observations: Observations, rms: Sequence[float | None]) -> str | None:
    """Describe the images whose rms (px, one per image) stands out; None if there are none."""
    detections, known = observations.detections, [value for value in rms if value is not None]
    if detections is None or not known:
        return None
    median = float(np.median(known))
    described: list[str] = []
    drops: list[str] = []
    for image, name, value in zip(detections.images, observations.image_names, rms, strict=True):
        if value is not None and value > max(OUTLIER_RMS_RATIO * median, MIN_OUTLIER_RMS_PX):
            differences = "".join(f", {text}" for text in _differences(image, detections.found))
            described.append(f"{name} ({value:.2f} px{differences})")
            drops.append(f"--drop {name}")
    if not described:
        return None
    return (
        f"images with an rms far above the median of {median:.2f} px: {', '.join(described)}; look at them with --draw,"
        f" or leave them out: {' '.join(drops)}"
    )


def _differences(image: ImageDetection, others: Sequence[ImageDetection]) -> list[str]:
    """Return how the sharpness of an image differs from that of the others."""
    blur = np.array([other.blur for other in others])
    usual_blur = float(np.median(blur[np.isfinite(blur)])) if np.isfinite(blur).any() else np.nan
    sharpness = float(np.median([other.sharpness for other in others]))
    problems = light_problems(image)
    if image.blur > BLUR_RATIO * usual_blur:
        remaining = [problem for problem in problems if problem != "blurred"]
        return [f"blurred: {image.blur:.1f} px across edges, {usual_blur:.1f} px in other images", *remaining]
    if not np.isfinite(image.blur) and image.sharpness < SHARPNESS_RATIO * sharpness:
        return [f"sharpness {image.sharpness:.2f}, {sharpness:.2f} in other images", *problems]
    return problems


def list_notes(detections: Detections) -> list[str]:
    """Return a line for each of the first images that have a note: the file name and the note."""
    notes = [f"{image.path.name}: {image.note}" for image in detections.images if image.note]
    return [f"  {note}" for note in notes[:MAX_LISTED]] + ["  ..."] * (len(notes) > MAX_LISTED)
