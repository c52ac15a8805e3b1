"""The frame of the HTML of a result: a heading, a table of figures and a drawing."""

import base64
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.report.axes import Axes, path_data
from omnisight.report.drawings.cross_section import svg_document
from omnisight.report.html import Markup, element

Array = NDArray[np.float64]

# Size of a plan, and the length of the view directions as a fraction of its extent.
PLAN_SIZE, ARROW_FRACTION = 340.0, 0.08
# Names of cameras that are written into a plan.
MAX_LABELS = 12


def summary(title: str, figures: Mapping[str, str], drawing: str | None, notes: Sequence[str] = ()) -> str:
    """Return a heading, figures by name, an SVG drawing beside them, and notes below.

    The drawing is an image of its own, because the styles of a notebook and of a drawing would affect each other.
    """
    rows = [
        element("tr", element("th", name, style="text-align:left"), element("td", value, style="text-align:left"))
        for name, value in figures.items()
    ]
    image = None
    if drawing is not None:
        data = base64.b64encode(drawing.encode()).decode()
        image = element("td", Markup(f'<img width="420" alt="" src="data:image/svg+xml;base64,{data}">'))
    return element(
        "div",
        element("b", title),
        element("table", element("tr", element("td", element("table", *rows), style="vertical-align:top"), image)),
        *(element("p", note) for note in notes),
    )


def plan(poses: Mapping[str, Pose], unit: str, axes: tuple[Array, Array] | None = None) -> str:
    """Draw the positions and view directions of cameras from above, as SVG.

    Parameters
    ----------
    poses
        world_from_cam by the name of the camera.
    unit
        Unit of the positions.
    axes
        Directions (3,) of the world to the right and upwards in the plan; by default x and z, as seen from above.
    """
    right, up = axes if axes is not None else (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    basis = np.stack([right, up], -1)
    centres = np.array([pose.translation for pose in poses.values()]) @ basis
    directions = np.array([pose.rotation[:, 2] for pose in poses.values()]) @ basis
    middle = (centres.max(0) + centres.min(0)) / 2
    extent = max(float(np.ptp(centres, axis=0).max()), 1e-9) * (1 + 4 * ARROW_FRACTION)
    ranges = [(float(m - extent / 2), float(m + extent / 2)) for m in middle]
    frame = Axes(ranges[0], ranges[1], f"right, {unit}", f"forward, {unit}", (70.0, 12.0, PLAN_SIZE, PLAN_SIZE - 58))
    starts = frame.positions(*centres.T)
    ends = frame.positions(*(centres + ARROW_FRACTION * extent * directions).T)
    lines = "".join(path_data(pair) for pair in zip(starts, ends, strict=True))
    labels = [
        element("text", name, x=float(x) + 6, y=float(y) - 6)
        for name, (x, y) in list(zip(poses, starts, strict=True))[:MAX_LABELS]
    ]
    return svg_document(
        frame.frame(),
        element("path", d=lines, stroke="#1f77b4", stroke_width=2, fill="none"),
        *(element("circle", cx=float(x), cy=float(y), r=3.5, fill="#d62728") for x, y in starts),
        *(labels if len(poses) <= MAX_LABELS else ()),
        width=PLAN_SIZE + 20,
        height=PLAN_SIZE,
        title="Cameras from above",
    )
