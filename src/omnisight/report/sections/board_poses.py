"""Where the boards stood around the camera: a drawing that turns where scripts run, and stands still elsewhere."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.report.axes import path_of, round_down
from omnisight.report.color_scale import LogScale
from omnisight.report.html import Markup, element, short
from omnisight.report.report_data import LEAST, Figure, Material

Array = NDArray[np.float64]

WIDE, HIGH = 640.0, 440.0
# How the scene is first looked at: turned about the camera's y axis, then tipped, radians.
YAW, PITCH = np.radians(-35.0), np.radians(-24.0)
# What is drawn fits into this part of the paper.
FILLED = 0.46
# How far from the middle the eye is, radii of the scene.
EYE = 3.5
AXES = (("x", "right"), ("y", "down"), ("z", "forward"))


def scene(m: Material) -> Figure:
    """Draw the boards and the camera."""
    boards, count = _boards(m), len(m.calibration.views)
    reach = float(np.linalg.norm(boards.reshape(-1, 3), axis=1).max())
    length = round_down(reach / 3)
    axes = np.stack([np.zeros((3, 3)), length * np.eye(3)], 1)
    view = _View.around(np.concatenate([boards.reshape(-1, 3), axes.reshape(-1, 3)]))
    colours = _colours(m)
    shapes, labels = list[tuple[float, Markup]](), list[Markup]()
    sides = len(boards) // count
    pictures = [picture for picture in m.images for _ in range(len(picture.views) * sides)]
    for i, (picture, corners) in enumerate(zip(pictures, boards, strict=True)):
        depth, places = view.of(corners)
        title = element("title", f"{picture.number} {picture.name}: rms {picture.rms:.2f} px")
        held = {"class_": "board", "data_corners": _said(corners), "data_number": picture.number}
        shapes.append(
            (depth, element("path", title, d=path_of(places) + "Z", fill=colours.colour(picture.rms), **held))
        )
        labels.append(_label("" if i % sides else str(picture.number), places.mean(0), data_number=picture.number))
    lines, letters = list[Markup](), list[Markup]()
    for (name, _), ends in zip(AXES, axes, strict=True):
        _, places = view.of(ends)
        lines.append(element("path", d=path_of(places), class_=f"axis axis-{name}", data_corners=_said(ends)))
        letters.append(_label(name, places[1]))
    # The farthest first, the camera over all. Scripts find the label of a shape by its place among them.
    order = sorted(range(len(shapes)), key=lambda i: -shapes[i][0])
    drawing = element(
        "svg",
        element("g", *(shapes[i][1] for i in order)),
        element("g", *lines),
        element("g", *(labels[i] for i in order), *letters),
        viewBox=f"0 0 {short(WIDE)} {short(HIGH)}",
        role="group",
        tabindex=0,
        aria_label=f"{count} boards around the camera. Arrow keys turn, plus and minus come nearer and go away.",
        class_="scene",
        data_middle=" ".join(f"{value:.6g}" for value in view.middle),
        data_scale=f"{view.scale:.6g}",
        data_eye=f"{view.eye:.6g}",
        data_yaw=f"{YAW:.6g}",
        data_pitch=f"{PITCH:.6g}",
    )
    named = ", ".join(f"{name} {where}" for name, where in AXES)
    return Figure(
        "boards",
        "Where the boards stood",
        element(
            "div",
            drawing,
            element(
                "p",
                f"The camera's axes are {length:g} {m.unit} long: {named}. Boards are up to {reach:.3g} {m.unit} away.",
                f" Colours: rms of the image, {colours.low:.2f} px dark to {colours.high:.2f} px bright.",
                class_="note",
            ),
        ),
        (
            "Each outline is the board of one image, as the camera saw it around itself. Drag to turn; click it and"
            " roll the wheel, or press + and −, to come nearer; double-click to begin again.",
            "Boards near and far, on all sides, and tilted differently. Boards that are all parallel leave the focal"
            " length open.",
            "A board in an impossible place (behind a wall, inside another) means wrong corners: drop its image. Add"
            " images where no board stands.",
        ),
        "Boards",
    )


def _boards(m: Material) -> Array:
    """Give the corners (V, 4, 3) of every board in the camera frame; of a solid body three sides (3 V, 4, 3)."""
    state, views = m.calibration.state, m.calibration.views
    (left, top), (right, bottom) = views.extent
    outline = np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])[None]
    if not views.is_planar:
        low, high = views.points.min(0), views.points.max(0)
        around = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        outline = low + (high - low) * np.stack([around, around[:, [2, 0, 1]], around[:, [1, 2, 0]]])
    turned = outline @ np.swapaxes(state.rotations, 1, 2)[:, None] + state.translations[:, None, None]
    return turned.reshape(-1, 4, 3)


@dataclass(frozen=True)
class _View:
    """How the scene is seen at first: `middle` in the middle, `scale` px per unit there, from `eye` away."""

    middle: Array
    scale: float
    eye: float

    @classmethod
    def around(cls, points: Array) -> "_View":
        """Fit points (N, 3) into the paper."""
        middle = (points.max(0) + points.min(0)) / 2
        view = cls(middle, 1.0, EYE * float(np.linalg.norm(points - middle, axis=1).max()))
        away = np.abs(view.of(points)[1] - (WIDE / 2, HIGH / 2)).max(0)
        return replace(view, scale=float(FILLED * np.min((WIDE, HIGH) / away)))

    def of(self, points: Array) -> tuple[float, Array]:
        """Give how far behind the middle points (N, 3) are, and their places (N, 2) on the paper."""
        x, y, z = (points - self.middle).T
        across, away = x * np.cos(YAW) + z * np.sin(YAW), z * np.cos(YAW) - x * np.sin(YAW)
        down, depth = y * np.cos(PITCH) - away * np.sin(PITCH), y * np.sin(PITCH) + away * np.cos(PITCH)
        size = self.scale * self.eye / (self.eye + depth)
        return float(depth.mean()), np.stack([WIDE / 2 + size * across, HIGH / 2 + size * down], -1)


def _colours(m: Material) -> LogScale:
    found = [max(picture.rms, LEAST) for picture in m.images if picture.views]
    return LogScale(min(found), max(found))


def _label(said: str, at: Array, **attributes: Any) -> Markup:
    x, y = map(float, at)
    return element("text", said, x=x, y=y + 4, text_anchor="middle", class_="on", **attributes)


def _said(points: Array) -> str:
    return " ".join(f"{value:.5g}" for value in points.ravel())
