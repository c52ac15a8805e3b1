"""The board poses around the camera, as a drawing that rotates if scripts run and is static otherwise."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.report.axes import nice_floor, path_data
from omnisight.report.color_scale import LogColorScale
from omnisight.report.html import Markup, element, format_coordinate
from omnisight.report.report_data import MIN_SCALE_PX, ReportData
from omnisight.report.section import Guide, Section
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

WIDTH, HEIGHT = 640.0, 440.0
# Initial rotation about the y axis of the camera, then about the horizontal axis of the drawing, radians.
YAW, PITCH = np.radians(-35.0), np.radians(-24.0)
# Half the extent of the scene in the drawing, as a fraction of its size.
FILL_FRACTION = 0.46
# Distance of the eye from the centre in radii of the scene.
EYE_DISTANCE = 3.5
AXES = (("x", "right"), ("y", "down"), ("z", "forward"))


def board_poses(data: ReportData) -> Section:
    """Draw the boards and the camera axes."""
    boards, count = _board_outlines(data), len(data.observations)
    extent = float(np.linalg.norm(boards.reshape(-1, 3), axis=1).max())
    length = nice_floor(extent / 3)
    axes = np.stack([np.zeros((3, 3)), length * np.eye(3)], 1)
    view = SceneView.of(np.concatenate([boards.reshape(-1, 3), axes.reshape(-1, 3)]))
    scale = _color_scale(data)
    images = [image for image in data.images for _ in image.views]
    shapes, labels, depths = list[Markup](), list[Markup](), list[float]()
    faces = len(boards) // count
    for i, corners in enumerate(boards):
        image = images[i // faces]
        depth, points = view.project(corners)
        title = element("title", f"{image.number} {image.name}: rms {image.rms_px:.2f} px")
        attributes = {"class_": "board", "data_corners": coordinates(corners), "data_number": image.number}
        fill = scale.color(image.rms_px)
        shapes.append(element("path", title, d=path_data(points) + "Z", fill=fill, **attributes))
        text = "" if i % faces else str(image.number)
        labels.append(label(text, points.mean(0), data_number=image.number))
        depths.append(depth)
    # Draw the farthest board first and the camera last. The script matches labels to shapes by their order.
    order = np.argsort(-np.array(depths), kind="stable")
    lines, letters = list[Markup](), list[Markup]()
    for (name, _), ends in zip(AXES, axes, strict=True):
        _, points = view.project(ends)
        attributes = {"class_": f"axis axis-{name}", "data_corners": coordinates(ends)}
        lines.append(element("path", d=path_data(points), **attributes))
        letters.append(label(name, points[1]))
    drawing = element(
        "svg",
        element("g", *(shapes[i] for i in order)),
        element("g", *lines),
        element("g", *(labels[i] for i in order), *letters),
        viewBox=f"0 0 {format_coordinate(WIDTH)} {format_coordinate(HEIGHT)}",
        role="group",
        tabindex=0,
        aria_label=f"{count} boards around the camera. Arrow keys rotate, plus and minus zoom.",
        class_="scene",
        **view.attributes(),
    )
    names = ", ".join(f"{name} {direction}" for name, direction in AXES)
    note = (
        f"Camera axes of {length:g} {data.unit}: {names}. The farthest board corner is {extent:.3g} {data.unit} away."
        f" Color: rms of the image, {scale.low:.2f} px (dark) to {scale.high:.2f} px (bright)."
    )
    return Section(
        "board-poses",
        "Board poses",
        element("div", drawing, element("p", note, class_="note")),
        Guide(
            "Outlines of the boards in the camera frame, one per image. Drag to rotate. Click and scroll, or press +"
            " and −, to zoom. Double-click to reset.",
            "Near and far boards on all sides with different tilts. The focal length cannot be determined from boards"
            " that are all parallel.",
            "A board at an impossible position (behind a wall, inside another board) has wrong corners: drop its"
            " image. Add images where there are no boards.",
        ),
    )


@dataclass(frozen=True)
class SceneView:
    """A perspective view of the scene.

    Attributes
    ----------
    centre
        (3,) point in the centre of the drawing.
    scale
        Units of the drawing per unit of length at the centre.
    eye
        Distance of the eye from the centre.
    """

    centre: Array
    scale: float
    eye: float

    @classmethod
    def of(cls, points: Array) -> "SceneView":
        """Return a view that fits points (N, 3) into the drawing."""
        centre = (points.max(0) + points.min(0)) / 2
        view = cls(centre, 1.0, EYE_DISTANCE * float(np.linalg.norm(points - centre, axis=1).max()))
        extent = np.abs(view.project(points)[1] - (WIDTH / 2, HEIGHT / 2)).max(0)
        return replace(view, scale=float(FILL_FRACTION * np.min((WIDTH, HEIGHT) / extent)))

    def project(self, points: Array) -> tuple[float, Array]:
        """Return the mean depth of points (N, 3) behind the centre, and their positions (N, 2) in the drawing."""
        x, y, z = (points - self.centre).T
        horizontal, forward = x * np.cos(YAW) + z * np.sin(YAW), z * np.cos(YAW) - x * np.sin(YAW)
        vertical, depth = y * np.cos(PITCH) - forward * np.sin(PITCH), y * np.sin(PITCH) + forward * np.cos(PITCH)
        scale = self.scale * self.eye / (self.eye + depth)
        return float(depth.mean()), np.stack([WIDTH / 2 + scale * horizontal, HEIGHT / 2 + scale * vertical], -1)

    def attributes(self) -> dict[str, str]:
        """Return the view as attributes that the script reads."""
        values = {"scale": self.scale, "eye": self.eye, "yaw": YAW, "pitch": PITCH}
        centre = " ".join(f"{value:.6g}" for value in self.centre)
        return {"data_centre": centre, **{f"data_{name}": f"{value:.6g}" for name, value in values.items()}}


def _board_outlines(data: ReportData) -> Array:
    """Return the outline (V, 4, 3) of every board in the camera frame; three faces (3 V, 4, 3) of a solid target."""
    state = data.state
    faces = board_faces(data.observations)
    outlines = faces @ np.swapaxes(state.rotations, 1, 2)[:, None] + state.translations[:, None, None]
    return outlines.reshape(-1, 4, 3)


def board_faces(observations: Observations) -> Array:
    """Return the outline (1, 4, 3) of the board in its own frame, or three faces (3, 4, 3) of a solid target."""
    (left, top), (right, bottom) = observations.extent
    faces = np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])[None]
    if not observations.is_planar:
        low, high = observations.points.min(0), observations.points.max(0)
        square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        faces = low + (high - low) * np.stack([square, square[:, [2, 0, 1]], square[:, [1, 2, 0]]])
    return faces


def _color_scale(data: ReportData) -> LogColorScale:
    rms = [max(image.rms_px, MIN_SCALE_PX) for image in data.images if image.views]
    return LogColorScale(min(rms), max(rms))


def label(text: str, position: Array, **attributes: Any) -> Markup:
    """Return a text whose middle is at a position (2,)."""
    x, y = map(float, position)
    return element("text", text, x=x, y=y + 4, text_anchor="middle", class_="on", **attributes)


def coordinates(points: Array) -> str:
    """Return points (N, 3) as an attribute that the script reads."""
    return " ".join(f"{value:.5g}" for value in points.ravel())
