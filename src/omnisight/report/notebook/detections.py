"""HTML of detections: the corners of all images, in one image."""

import numpy as np

from omnisight.report.notebook._summary import corner_map, summary
from omnisight.targets import Detections


def html(detections: Detections) -> str:
    """Return the numbers of images and corners, the board, and the corners over the image."""
    found = detections.found
    pixels = [board.pixels for image in found for board in image.boards]
    figures = {
        "board": "unknown" if detections.board is None else repr(detections.board),
        "images": f"{len(found)} of {len(detections.images)} show the board",
        "corners": str(sum(map(len, pixels))),
        "image size": " x ".join(map(str, detections.size)) + " px" if all(detections.size) else "unknown",
    }
    drawing = corner_map(detections.size, {"#1f77b4": np.concatenate(pixels)}) if pixels else None
    notes = [*detections.notes, *filter(None, (detections.assumption, detections.hint))]
    return summary("Detections", figures, drawing, notes)
