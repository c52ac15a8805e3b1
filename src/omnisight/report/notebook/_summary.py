"""The frame of the HTML of a result: a heading, a table of figures and a drawing."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.report.axes import Axes, dot_path_data, path_data
from omnisight.report.drawings.cross_section import svg_document
from omnisight.report.html import Markup, element
from omnisight.report.jpeg_url import encode_jpeg_url

Array = NDArray[np.float64]

# Width of an image beside the figures, and most corners that are drawn, each of about 20 bytes.
IMAGE_WIDTH_PX, MAX_DOTS = 420, 4000
# Width of an image of several maps with text.
WIDE_PX = 900
# Size of a plan, and the length of the view directions as a fraction of its extent.
PLAN_SIZE, ARROW_FRACTION = 340.0, 0.08
# Names of cameras that are written into a plan.
MAX_LABELS = 12


def summary(
    title: str,
    figures: Mapping[str, str],
    drawing: str | None,
    notes: Sequence[str] = (),
    *,
    width: int = IMAGE_WIDTH_PX,
) -> str:
    """Return a heading, figures by name, a drawing beside them or, if it is wide, below, and notes.

    The drawing is SVG or a data: URL. It is an image of its own, because the styles of a notebook and of a drawing
    would affect each other.
    """
    rows = [
        element("tr", element("th", name, style="text-align:left"), element("td", value, style="text-align:left"))
        for name, value in figures.items()
    ]
    image = None
    if drawing is not None:
        url = drawing
        if not drawing.startswith("data:"):
            url = f"data:image/svg+xml;base64,{base64.b64encode(drawing.encode()).decode()}"
        image = element("td", Markup(f'<img width="{width}" alt="" src="{url}">'))
    table = element("td", element("table", *rows), style="vertical-align:top")
    cells = [[table, image]] if width <= IMAGE_WIDTH_PX else [[table], [image]]
    return element(
        "div",
        element("b", title),
        element("table", *(element("tr", *row) for row in cells)),
        *(element("p", note) for note in notes),
    )


def photo_url(pixels: NDArray[Any], width: int = 2 * IMAGE_WIDTH_PX) -> str:
    """Return an image (H, W) or (H, W, C) as a data: URL of a JPEG, small enough for a notebook."""
    return encode_jpeg_url(pixels, width)


def corner_map(size: tuple[int, int], pixels: Mapping[str, Array]) -> str | None:
    """Draw corners (N, 2) over the area of the image, by colour, as SVG; None if the image size is unknown."""
    if not all(size):
        return None
    scale = IMAGE_WIDTH_PX / size[0]
    width, height = IMAGE_WIDTH_PX, scale * size[1]
    step = 1 + sum(map(len, pixels.values())) // MAX_DOTS
    dots = [
        element("path", d=dot_path_data(scale * (group[::step] + 0.5)), stroke=color, stroke_width=3, fill="none")
        for color, group in pixels.items()
    ]
    frame = element("rect", x=0, y=0, width=width, height=height, stroke="#888", fill="none")
    caps = element("g", frame, *dots, stroke_linecap="round")
    return svg_document(caps, width=width, height=height, title="Corners of all images")


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
