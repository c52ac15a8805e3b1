"""The rig in 3-D: cameras with their axes and fields of view, and the boards around them."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import polar
from omnisight.report.axes import nice_floor, path_data
from omnisight.report.color_scale import LogColorScale
from omnisight.report.html import Markup, element, format_coordinate
from omnisight.report.report_data import MIN_SCALE_PX
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section
from omnisight.report.sections.board_poses import (
    AXES,
    HEIGHT,
    WIDTH,
    SceneView,
    board_faces,
    coordinates,
    label,
)
from omnisight.rig import Sensor
from omnisight.rig_overlap import sees

Array = NDArray[np.float64]

# Directions along the edge of a field of view, every how many of them is joined to the camera, and the step at which
# the edge is searched, radians.
EDGE_DIRECTIONS, EDGE_STRIDE, EDGE_STEP_RAD = 48, 12, np.radians(0.5)
# Points of a field of view are tested at this multiple of the extent of the scene.
FAR = 100.0
# Length of the camera axes, and of the fields of view, as a fraction of the extent of the scene.
AXIS_FRACTION, CONE_FRACTION = 1 / 8, 1 / 5


def rig_scene(data: RigReportData) -> Section:
    """Draw the cameras, their axes and fields of view, and the boards in the rig frame."""
    names = data.rig.names
    boards = [board_faces(data.observations_of_board(view.board)) for view in data.views]
    outlines = [view.rig_from_board @ faces for view, faces in zip(data.views, boards, strict=True)]
    centres = np.array([data.centre(name) for name in names])
    extent = float(np.linalg.norm(np.concatenate(outlines).reshape(-1, 3) - centres.mean(0), axis=1).max())
    axes = {name: _axes(data, name, nice_floor(extent * AXIS_FRACTION)) for name in names}
    edges = {name: _field_of_view(data, name, CONE_FRACTION * extent) for name in names}
    view = SceneView.of(np.concatenate([*outlines, *edges.values(), *axes.values()], axis=None).reshape(-1, 3))
    scale = LogColorScale(*_rms_range(data))
    faces, labels = _draw_boards(data, outlines, view, scale)
    lines, line_labels = list[Markup](), list[Markup]()
    for name in names:
        color = data.color(name)
        edge, centre = edges[name], data.centre(name)
        spokes = [np.stack([centre, point]) for point in edge[::EDGE_STRIDE]]
        for points in (np.concatenate([edge, edge[:1]]), *spokes):
            lines.append(_line(view, points, class_="cone", stroke=color))
            line_labels.append(label("", np.zeros(2)))
        for (axis, _), ends in zip(AXES, axes[name], strict=True):
            lines.append(_line(view, ends, class_=f"axis axis-{axis}"))
            line_labels.append(label(name if axis == "z" else "", view.project(ends)[1][1], fill=color))
    drawing = element(
        "svg",
        element("g", *faces),
        element("g", *lines),
        element("g", *labels, *line_labels),
        viewBox=f"0 0 {format_coordinate(WIDTH)} {format_coordinate(HEIGHT)}",
        role="group",
        tabindex=0,
        aria_label=f"{len(names)} cameras and {data.frames} boards. Arrow keys rotate, plus and minus zoom.",
        class_="scene rig",
        **view.attributes(),
    )
    unit = data.rig.unit
    directions = ", ".join(f"{axis} {direction} ({color})" for (axis, direction), color in zip(AXES, RGB, strict=True))
    note = (
        f"Camera axes: {directions}; z has the name of the camera. The farthest board corner is"
        f" {extent:.3g} {unit} from the cameras. Board color: rms of the simultaneous images,"
        f" {scale.low:.2f} px (dark) to {scale.high:.2f} px (bright). Dashed: views that contradict the extrinsics."
    )
    return Section(
        "rig",
        "Rig in 3-D",
        element("div", drawing, element("p", note, class_="note")),
        Guide(
            "The cameras with the edges of their fields of view, and the boards, in the frame of"
            f" {data.reference}. Boards have the numbers of the simultaneous images. Drag to rotate. Click and scroll,"
            " or press + and −, to zoom. Double-click to reset.",
            "Cameras where they are mounted, upright ones with the green axis down. Boards where the fields of view"
            " overlap, near and far, with different tilts.",
            "If a camera is at the wrong place, check that its images are those of the right camera and moment. Add"
            " boards where two cameras see them.",
        ),
        wide=True,
    )


RGB = ("red", "green", "blue")


def _draw_boards(
    data: RigReportData, outlines: list[Array], view: SceneView, scale: LogColorScale
) -> tuple[list[Markup], list[Markup]]:
    """Draw one board per moment, and one for each view that contradicts; the farthest first."""
    drawn: set[tuple[int, int]] = set()
    shapes = list[tuple[float, Markup, Markup]]()
    for one, faces in zip(data.views, outlines, strict=True):
        key = one.number, one.board
        if one.agrees and key in drawn:
            continue
        drawn |= {key} if one.agrees else set()
        same = [v for v in data.views if (v.number, v.board, v.agrees) == (*key, True)] if one.agrees else [one]
        rms = float(np.sqrt(np.mean([v.rms_px**2 for v in same])))
        text = "; ".join(f"{v.camera} {v.image}: rms {v.rms_px:.2f} px" for v in same)
        title = element("title", f"{one.number} {text}" + ("" if one.agrees else ", contradicts the extrinsics"))
        for k, corners in enumerate(faces):
            depth, points = view.project(corners)
            class_ = "board" if one.agrees else "board dropped"
            fill = scale.color(rms)
            path = path_data(points) + "Z"
            shape = element("path", title, d=path, fill=fill, class_=class_, data_corners=coordinates(corners))
            shapes.append((depth, shape, label("" if k else str(one.number), points.mean(0))))
    shapes.sort(key=lambda shape: -shape[0])
    return [shape for _, shape, _ in shapes], [text for _, _, text in shapes]


def _line(view: SceneView, points: Array, **attributes: str) -> Markup:
    """Draw a line through points (N, 3)."""
    d = path_data(view.project(points)[1])
    return element("path", d=d, data_corners=coordinates(points), data_open=True, **attributes)


def _axes(data: RigReportData, name: str, length: float) -> Array:
    """Return the axes (3, 2, 3) of a camera in the rig frame."""
    rig_from_sensor = data.rig.sensor_from_rig[data.rig.index(name)].inverse()
    return rig_from_sensor @ np.stack([np.zeros((3, 3)), length * np.eye(3)], 1)


def _field_of_view(data: RigReportData, name: str, length: float) -> Array:
    """Return the edge (N, 3) of the field of view of a camera in the rig frame, at a distance from the camera."""
    k = data.rig.index(name)
    return data.rig.sensor_from_rig[k].inverse() @ (length * edge_bearings(data.rig.cameras[k], FAR * length))


def edge_bearings(camera: Sensor, distance: float) -> Array:
    """Return bearings (N, 3) along the edge of what a camera sees at a distance."""
    phi = np.linspace(0, 2 * np.pi, EDGE_DIRECTIONS, endpoint=False)
    theta = np.arange(0.0, np.pi, EDGE_STEP_RAD)
    grid = polar(*np.broadcast_arrays(theta, phi[:, None]))
    seen = sees(camera, distance * grid)
    # The last angle that is seen: mirror cameras do not see the centre.
    last = len(theta) - 1 - np.argmax(seen[:, ::-1], axis=1)
    return polar(np.where(seen.any(1), theta[last], 0.0), phi)


def _rms_range(data: RigReportData) -> tuple[float, float]:
    rms = [max(view.rms_px, MIN_SCALE_PX) for view in data.views]
    return min(rms), max(rms)
