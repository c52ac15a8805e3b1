"""Where to hold the board next, drawn over an image of the set."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.cli._next_report import FACING, distance_said, error_said, nearer_edge, side_of
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.images import read_image, to_gray8, write_image
from omnisight.next_view.board_placements import spacing_of
from omnisight.next_view.proposal import NextView, Proposal, unknown_px
from omnisight.targets import Board, Detections

Array = NDArray[np.float64]
Color = tuple[int, int, int]

WHITE, GREY, DOT, BORDER = (255, 255, 255), (170, 170, 170), (120, 220, 255), (150, 190, 255)
COLORS: tuple[Color, ...] = ((90, 255, 120), (255, 120, 255), (80, 220, 255), (255, 170, 60), (255, 255, 110))
INK, PAPER = (25, 25, 25), (240, 240, 240)
LONGER = 1500  # px of the image as drawn
PANEL = 560  # px of the words beside it
HEAD, ENTRY, LEGEND = 110, 150, 330  # px in height of their parts
DIM, WASH = 0.55, 0.45
BARE = np.uint8(150)  # an empty frame
# How firmly the first board is pasted, those after it, and what the lens does not show of them.
PASTED, LATER, UNSEEN = 0.9, 0.4, 0.15
FARTHEST = 1e5  # px; nothing is drawn farther away
SURE = 0.01  # the lower end of the scale, as a share of the error that is unknown
HATCH = 22  # px between lines
BADGE = 34  # px, radius of a number's disc


def draw_proposal(
    proposal: Proposal, search: Detections, board: Board, file: Path, *, apply_exif: bool = False
) -> None:
    """Draw the proposed boards over an image, with how sure the camera is of each direction, and words beside.

    Corners that were given without their images are drawn over an empty frame, with the circle that the camera shows.
    """
    seen = [picture.path for picture in search.found if picture.path.is_file()]
    sheet = _Sheet(read_image(seen[0], apply_exif=apply_exif) if seen else np.full(search.size[::-1], BARE))
    sheet.wash(proposal, search)
    if not seen:
        sheet.line(_circle(proposal), BORDER)
    for border in () if search.field is None else (search.field.outer, search.field.inner):
        if border is not None:
            sheet.line([*border.outline(240), border.outline(1)[0]], BORDER)
    sheet.dots(proposal.known.views.pixels)
    for i, view in reversed(list(enumerate(proposal.views))):
        sheet.board(proposal, view, board, i)
    sheet.numbers(proposal, board)
    height = max(len(sheet.canvas), HEAD + ENTRY * len(proposal.views) + LEGEND)
    picture = np.pad(sheet.canvas, ((0, height - len(sheet.canvas)), (0, 0), (0, 0)))
    write_image(file, np.concatenate([picture, _panel(proposal, board, height)], 1))


def _circle(proposal: Proposal) -> Array:
    """Give pixels (N, 2) around what the camera shows, back to the first: as far as its model goes in the image."""
    camera = proposal.known.camera
    farthest = min(camera.image_theta_max(), camera.model.theta_max * (1 - 1e-6))
    pixels, valid = camera.model.project_numpy(polar(np.full(240, farthest), np.linspace(0, 2 * np.pi, 240)))
    return pixels[valid]


class _Sheet:
    """An image in grey, dimmed and enlarged; places are pixels of the image."""

    def __init__(self, image: Any) -> None:
        import cv2

        gray = to_gray8(image)
        self.zoom = LONGER / max(gray.shape)
        how = cv2.INTER_CUBIC if self.zoom > 1 else cv2.INTER_AREA
        large = cv2.resize(gray, None, fx=self.zoom, fy=self.zoom, interpolation=how)
        self.canvas = cv2.cvtColor((large * DIM).astype(np.uint8), cv2.COLOR_GRAY2RGB)
        self.shown = np.ones(self.canvas.shape[:2], np.bool_)  # where the lens shows anything

    def wash(self, proposal: Proposal, search: Detections) -> None:
        """Colour the image by how unsure the camera is, and hatch what lies beyond all corners."""
        import cv2

        known = proposal.known
        camera = known.camera
        height, width = self.canvas.shape[:2]
        step = 8  # px between pixels that are asked about
        v, u = np.mgrid[0 : height + step : step, 0 : width + step : step]
        pixels = np.stack([u.ravel(), v.ravel()], -1) / self.zoom
        bearings, valid = camera.model.unproject_numpy(pixels)
        # Where the model has no bearing it knows nothing.
        level, theta = np.ones(len(pixels)), np.full(len(pixels), np.pi)
        level[valid] = scale_of(proposal, proposal.visible.errors_at(known, bearings[valid]))
        theta[valid] = angle_from_axis(bearings[valid])
        full = (width + step, height + step)

        def large(values: Array) -> Any:
            return cv2.resize(values.reshape(u.shape).astype(np.float32), full, interpolation=cv2.INTER_LINEAR)[
                step // 2 : height + step // 2, step // 2 : width + step // 2
            ]

        color = tint(large(level))
        row, column = np.mgrid[:height, :width]
        seen = np.stack([column, row], -1) / self.zoom
        shown = camera.in_image(seen) if search.field is None else search.field.contains(seen)
        self.shown = shown
        beyond = shown & (large(theta) > known.reach)
        hatch = beyond & ((row + column) % HATCH < 2)
        mixed = (1 - WASH) * self.canvas + WASH * color
        self.canvas[shown] = mixed[shown].astype(np.uint8)
        self.canvas[hatch] = (0.6 * self.canvas[hatch] + 0.4 * 235).astype(np.uint8)

    def dots(self, pixels: Array) -> None:
        import cv2

        for place in self.at(pixels):
            cv2.circle(self.canvas, place, 2 * 16, DOT, -1, cv2.LINE_AA, 4)

    def line(self, pixels: Any, color: Color, thick: int = 2) -> None:
        import cv2

        cv2.polylines(self.canvas, [self.at(pixels)], False, color, thick, cv2.LINE_AA, 4)

    def board(self, proposal: Proposal, view: NextView, board: Board, number: int) -> None:
        """Paste the board as the camera would see it: its squares with their curved edges, the nearer edge thick.

        The first is pasted firmly, the others, which come later, faintly; so is what the lens does not show.
        """
        import cv2

        low, high = board.points.min(0)[:2], board.points.max(0)[:2]
        counts = np.maximum(np.rint((high - low) / spacing_of(board)).astype(int), 1)
        side = (high - low) / counts
        over = self.canvas.copy()
        for i, j in product(range(-1, counts[0] + 1), range(-1, counts[1] + 1)):
            square, seen = self._seen(proposal, view, _outline(low + side * (i, j), low + side * (i + 1, j + 1), 8))
            if seen.all():
                cv2.fillPoly(over, [square], INK if (i + j) % 2 == 0 else PAPER, cv2.LINE_AA, 4)
        firm = np.where(self.shown, PASTED if number == 0 else LATER, UNSEEN)[..., None]
        self.canvas[:] = firm * over + (1 - firm) * self.canvas
        color, whole = COLORS[number % len(COLORS)], (low - side, high + side)
        self._curve(proposal, view, _outline(*whole, 60), color, 4)
        if view.tilt >= FACING:
            middle, grown = (low + high) / 2, 1 + 2 * side / (high - low)
            start, end = middle + (nearer_edge(proposal.known, view, board)[1][:, :2] - middle) * grown
            self._curve(proposal, view, start + np.linspace(0, 1, 60)[:, None] * (end - start), color, 14)

    def numbers(self, proposal: Proposal, board: Board) -> None:
        """Number the boards at their middles, side by side where several have the same."""
        taken: list[Any] = []
        for i, view in enumerate(proposal.views):
            places, seen = self._seen(proposal, view, board.points.mean(0)[None, :2])
            place = np.clip(places[0] // 16, BADGE, np.array(self.canvas.shape[1::-1]) - BADGE)
            while any(np.linalg.norm(place - other) < 2 * BADGE for other in taken):
                place = np.add(place, (2 * BADGE, 0))
            if seen.all():
                taken.append(place)
                badge(self.canvas, place, i)

    def _curve(self, proposal: Proposal, view: NextView, plane: Array, color: Color, thick: int) -> None:
        """Draw a line of the board (N, 2) as far as the camera sees it."""
        import cv2

        places, seen = self._seen(proposal, view, plane)
        for i in np.flatnonzero(seen[:-1] & seen[1:]):
            cv2.line(self.canvas, places[i], places[i + 1], color, thick, cv2.LINE_AA, 4)

    def _seen(self, proposal: Proposal, view: NextView, plane: Array) -> tuple[Any, NDArray[np.bool_]]:
        """Give places on the canvas of points (N, 2) of the board, and which of them there are."""
        pixels, valid = proposal.known.camera.model.project_numpy(view.cam_from_board @ np.pad(plane, ((0, 0), (0, 1))))
        seen = valid & (np.abs(np.nan_to_num(pixels, nan=np.inf)) < FARTHEST).all(1)
        return self.at(np.where(seen[:, None], pixels, 0.0)), seen

    def at(self, pixels: Any) -> Any:
        """Give places on the canvas in sixteenths of its pixels, as cv2 wants with shift=4."""
        return np.rint(((np.asarray(pixels) + 0.5) * self.zoom - 0.5) * 16).astype(np.int32)


def _outline(low: Array, high: Array, steps: int) -> Array:
    """Give points (4 steps + 1, 2) around a rectangle, back to the first."""
    t = np.linspace(0, 1, steps, endpoint=False)[:, None]
    turns = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    return np.concatenate([*(turns[i] + t * (turns[i + 1] - turns[i]) for i in range(4)), low[None]])


def badge(canvas: Any, place: Any, number: int) -> None:
    """Put a number in a disc of its colour."""
    import cv2

    x, y = int(place[0]), int(place[1])
    cv2.circle(canvas, (x, y), BADGE, (0, 0, 0), -1, cv2.LINE_AA)
    cv2.circle(canvas, (x, y), BADGE - 3, COLORS[number % len(COLORS)], -1, cv2.LINE_AA)
    text = str(number + 1)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.3, 3)
    cv2.putText(
        canvas, text, (x - width // 2, y + height // 2), cv2.FONT_HERSHEY_SIMPLEX, 1.3, (0, 0, 0), 3, cv2.LINE_AA
    )


def scale_of(proposal: Proposal, errors: Array) -> Array:
    """Give errors (px) as places on the scale, 0 sure and 1 unknown, evenly by their logarithm."""
    high = unknown_px(proposal.known)
    low = SURE * high
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.clip(np.log(np.maximum(errors, low) / low) / np.log(high / low), 0, 1), nan=1.0)


def tint(level: Any) -> Any:
    """Give the colours (..., 3) of places on the scale."""
    import cv2

    return cv2.cvtColor(
        cv2.applyColorMap((255 * np.atleast_2d(level)).astype(np.uint8), cv2.COLORMAP_TURBO), cv2.COLOR_BGR2RGB
    )


def _panel(proposal: Proposal, board: Board, height: int) -> Any:
    """Give the words: each board, and what the colours mean."""
    import cv2

    panel = np.full((height, PANEL, 3), 24, np.uint8)
    y = 20

    def write(text: str, size: float = 0.7, color: Color = WHITE, x: int = 24) -> None:
        nonlocal y
        y += round(44 * size)
        cv2.putText(panel, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, color, 2 if size > 0.8 else 1, cv2.LINE_AA)

    known = proposal.known
    write("Hold the board like this", 1.0)
    if len(proposal.views) > 1:
        write("one image each, in this order", 0.65, GREY)
    y += 14
    for i, view in enumerate(proposal.views):
        badge(panel, (58, y + 52), i)
        color = COLORS[i % len(COLORS)]
        write(f"{distance_said(view, board)} away", 0.75, color, 110)
        if view.tilt >= FACING:
            edge = nearer_edge(known, view, board)[0]
            write(f"tilted {np.degrees(view.tilt):.0f} degrees:", 0.7, WHITE, 110)
            write(f"{edge} edge (thick) nearer", 0.7, WHITE, 110)
        else:
            write("facing the camera", 0.7, WHITE, 110)
        write(f"worst {error_said(known, view.before)} -> {error_said(known, view.after)}", 0.65, GREY, 110)
        y += 22
    y = height - LEGEND
    write("How sure the camera is", 0.85)
    y += 12
    ramp = tint(np.linspace(0, 1, PANEL - 48))[0]
    panel[y : y + 26, 24:-24] = (1 - WASH) * 60 + WASH * ramp + 40 * WASH
    y += 26
    high = unknown_px(known)
    for text, x in (
        (f"{SURE * high:.1g} px", 24),
        (f"{high / 10:.1g} px", PANEL // 2 - 24),
        (f"{high:.0f} px: unknown", PANEL - 174),
    ):
        cv2.putText(panel, text, (x, y + 26), cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1, cv2.LINE_AA)
    y += 44
    for kind, text in (
        ("dot", "corners so far"),
        ("hatch", "beyond all corners: extrapolated"),
        ("thick", "edge nearer to the camera"),
    ):
        write(text, 0.65, WHITE, 80)
        middle = y - 7
        if kind == "dot":
            for x in (34, 46, 58):
                cv2.circle(panel, (x, middle), 3, DOT, -1, cv2.LINE_AA)
        elif kind == "thick":
            cv2.line(panel, (30, middle), (64, middle), WHITE, 10, cv2.LINE_AA)
        else:
            for x in (28, 40, 52):
                cv2.line(panel, (x, middle + 9), (x + 16, middle - 9), (200, 200, 200), 2, cv2.LINE_AA)
    side = side_of(known, proposal.now.pixel)
    write(f"worst: {np.degrees(proposal.now.theta):.0f} degrees, {side}", 0.65, GREY)
    return panel
