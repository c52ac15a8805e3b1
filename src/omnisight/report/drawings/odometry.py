"""Drawing of a running odometry: the tracks on the image, and the path from above."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.report.drawings.canvas import BLUE, GREEN, WHITE, YELLOW, ImageCanvas, write_text
from omnisight.visual_odometry.odometry import Odometry

Array = NDArray[np.float64]

# Height of the drawing, px.
HEIGHT_PX = 720
BRIGHTNESS = 0.8
# Frames over which the track of a point is drawn.
TRACK_FRAMES = 12
# Smallest side of the map of the path, in units of the trajectory, and its margin over its side.
MIN_EXTENT, MARGIN = 2.0, 0.08
PANEL_GRAY, POINT_COLOR = 24, (90, 98, 112)
# Distance from the middle, over the side of the map, up to which points are drawn.
POINT_RANGE = 0.5


class OdometryDrawing:
    """Draws each frame with the tracks of the last ones.

    Points whose distance is known are green, others yellow.
    """

    def __init__(self) -> None:
        self._tracks: list[dict[int, Array]] = []

    def add(self, tracking: Odometry) -> None:
        """Keep the positions of the patches in the newest frame, also of a frame that is not drawn."""
        seen: dict[int, Array] = {}
        if tracking.tracker is not None:
            patches = tracking.tracker.patches
            shown = patches[patches.is_seen & (patches.sensor == 0)]
            seen = dict(zip(shown.number.tolist(), shown.pixels, strict=True))
        self._tracks = [*self._tracks, seen][-TRACK_FRAMES:]

    def draw(self, tracking: Odometry, image: NDArray[Any]) -> NDArray[np.uint8]:
        """Return the drawing (H, W, 3) of the newest image and the path."""
        canvas = ImageCanvas(image, HEIGHT_PX / image.shape[0], brightness=BRIGHTNESS)
        known = _numbers_with_points(tracking)
        for number in self._tracks[-1] if self._tracks else ():
            color = GREEN if number in known else YELLOW
            track = [frame[number] for frame in self._tracks if number in frame]
            if len(track) > 1:
                canvas.polyline(track, color)
            canvas.dots([track[-1]], color)
        return np.concatenate([np.asarray(canvas.pixels, np.uint8), draw_path(tracking, canvas.pixels.shape[0])], 1)


def draw_path(tracking: Odometry, height: int) -> NDArray[np.uint8]:
    """Return a square panel with the positions and the points from above; x is right, z up, as at the first image."""
    import cv2

    panel = np.full((height, height, 3), PANEL_GRAY, np.uint8)
    centers = np.array([p.rig_from_world.inverse().translation for p in tracking.trajectory]).reshape(-1, 3)[:, [0, 2]]
    if not len(centers):
        write_text(panel, "no position yet", (24, 40), 0.7)
        return panel
    low, high = centers.min(axis=0), centers.max(axis=0)
    side = max((high - low).max(), MIN_EXTENT) * (1 + 2 * MARGIN)
    middle, scale = (low + high) / 2, height / side

    def on_panel(positions: Array) -> Any:
        flipped = (positions - middle) * (1, -1) * scale + np.array(panel.shape[1::-1]) / 2
        return np.rint(flipped * 16).astype(np.int32)

    points = tracking.points[:, [0, 2]]
    near = points[np.abs(points - middle).max(axis=1) < POINT_RANGE * side]
    for position in on_panel(near):
        cv2.circle(panel, position, 16, POINT_COLOR, -1, cv2.LINE_AA, 4)
    cv2.polylines(panel, [on_panel(centers)], False, BLUE, 2, cv2.LINE_AA, 4)
    cv2.circle(panel, on_panel(centers[-1:])[0], 6 * 16, WHITE, -1, cv2.LINE_AA, 4)
    _draw_heading(panel, tracking, on_panel, side)
    _draw_scale(panel, scale)
    return panel


def _draw_heading(panel: NDArray[np.uint8], tracking: Odometry, on_panel: Any, side: float) -> None:
    """Draw where the camera looks."""
    import cv2

    world_from_rig = tracking.trajectory[-1].rig_from_world.inverse()
    center = world_from_rig.translation[[0, 2]]
    ahead = center + 0.06 * side * world_from_rig.rotation[[0, 2], 2]
    start, end = on_panel(np.array([center, ahead]))
    cv2.line(panel, start, end, WHITE, 2, cv2.LINE_AA, 4)


def _draw_scale(panel: NDArray[np.uint8], scale: float) -> None:
    """Draw a bar of a round length in the lower left corner."""
    import cv2

    length = 10.0 ** np.floor(np.log10(0.4 * panel.shape[1] / scale))
    length *= max(factor for factor in (1, 2, 5) if factor * length * scale <= 0.4 * panel.shape[1])
    base = panel.shape[0] - 24
    cv2.line(panel, (24, base), (24 + round(length * scale), base), WHITE, 2, cv2.LINE_AA)
    write_text(panel, f"{length:g}", (24, base - 10), 0.6)


def _numbers_with_points(tracking: Odometry) -> set[int]:
    """Return the numbers of the patches whose distance is known."""
    if tracking.tracker is None:
        return set()
    patches = tracking.tracker.patches
    return set(patches.number[patches.has_point].tolist())
