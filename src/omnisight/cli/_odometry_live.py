"""Progress of `omnisight odometry --live`: a line in the terminal, and a page."""

import sys
import time
from collections import deque
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from shutil import get_terminal_size

import numpy as np

from omnisight.cli._output import is_quiet
from omnisight.compilation import watch_compilation
from omnisight.pipeline.odometry.frame_sequence import SequenceFrame
from omnisight.pipeline.odometry.odometry import Watch
from omnisight.progress import Progress
from omnisight.report.drawings.odometry import OdometryDrawing
from omnisight.report.live.server import LivePage
from omnisight.visual_odometry.odometry import Odometry

# Seconds between two images of the page: drawing and encoding take a third of the time of a frame.
PAGE_PERIOD_S = 0.25
# Frames over which the rate is measured.
RATE_FRAMES = 30


class LiveFigures:
    """The figures of a running odometry."""

    def __init__(self) -> None:
        self.length = 0.0
        self._poses = 0
        self._last = np.zeros(3)
        self._arrivals: deque[float] = deque(maxlen=RATE_FRAMES)

    def add(self, tracking: Odometry) -> None:
        """Count a frame, and add the new part of the path."""
        self._arrivals.append(time.perf_counter())
        for pose in tracking.trajectory[self._poses :]:
            center = pose.rig_from_world.inverse().translation
            self.length += float(np.linalg.norm(center - self._last)) if self._poses else 0.0
            self._poses, self._last = self._poses + 1, center

    def rows(self, tracking: Odometry, frame: SequenceFrame) -> dict[str, str]:
        """Return names and values."""
        unit = "m" if tracking.has_scale else "baselines (scale unknown)"
        spent = self._arrivals[-1] - self._arrivals[0]
        return {
            "Frames": f"{frame.index + 1}, {self._poses} with a pose; {tracking.keyframes} keyframes",
            "Dropped": f"{frame.dropped} that arrived while another one was processed",
            "Rate": f"{(len(self._arrivals) - 1) / spent:.1f} frames per second" if spent > 0 else "-",
            "Path": f"{self.length:.2f} {unit}",
            "Distance from the start": f"{np.linalg.norm(self._last):.2f} {unit}",
            "Tracks": "green where the distance of the point is known, otherwise yellow",
        }


def advice(tracking: Odometry, frame: SequenceFrame) -> str:
    """Return the state in a few words."""
    if frame.reason:
        return frame.reason
    if not tracking.trajectory:
        return "move the camera sideways: no position is known yet"
    newest = tracking.trajectory[-1]
    if newest.seconds < frame.seconds:
        return "the position is lost: return to a place that the camera has seen"
    return "tracking" if newest.motion == "general" else "the camera turns without moving"


@contextmanager
def live_view(source: str, *, has_page: bool) -> Generator[tuple[Watch, Progress]]:
    """Show the odometry and its progress as a line on stderr, if it is a terminal, and the odometry as a page."""
    has_line = not is_quiet() and sys.stderr.isatty()
    drawing, figures, drawn = OdometryDrawing(), LiveFigures(), 0.0
    with ExitStack() as stack:
        page = stack.enter_context(LivePage(f"Odometry of {source}")) if has_page else None
        if page is not None:
            print(f"page      {page.url}", file=sys.stderr, flush=True)

        def show(line: str) -> None:
            if has_line:
                print(f"\r{line[: get_terminal_size().columns - 1]}\x1b[K", end="", file=sys.stderr, flush=True)

        def report(stage: str, done: int, total: int) -> None:
            show(f"{stage}: {done} of {total}")

        def report_compilation(function: str, seconds: float | None) -> None:
            show(f"compiling code (first run): {function}")

        def watch(tracking: Odometry, frame: SequenceFrame) -> None:
            nonlocal drawn
            figures.add(tracking)
            drawing.add(tracking)
            if has_line:
                rows = figures.rows(tracking, frame)
                text = f"{rows['Frames']}, {frame.dropped} dropped, {rows['Rate']}, path {rows['Path']}"
                show(f"{advice(tracking, frame)}: {text}")
            if page is not None and frame.images and time.perf_counter() - drawn > PAGE_PERIOD_S:
                drawn = time.perf_counter()
                image = drawing.draw(tracking, frame.images[0])
                page.show(image, advice(tracking, frame), figures.rows(tracking, frame))

        stack.enter_context(watch_compilation(report_compilation))
        yield watch, report
        show("")
