"""Which cameras of a rig see each direction, and how their fields of view overlap."""

import base64

import numpy as np
from numpy.typing import NDArray

from omnisight.report.axes import Axes, chart
from omnisight.report.html import Markup, element, join, table
from omnisight.report.rigs.direction_map import share_of_sphere
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# The map in its drawing.
CHART_SIZE, BOX = (640.0, 350.0), (52.0, 12.0, 622.0, 297.0)
# Space of the name of a camera in the drawing.
NAME_SIZE = (60.0, 15.0)
# Half the width of the edge of a field of view, px of the map.
EDGE_PX = 1
# Gray and opacity of a direction that no camera sees, and of one more camera each.
UNSEEN_ALPHA, SEEN = 0, ((214, 228, 247), (150, 190, 238), (88, 146, 222), (38, 98, 186))
DEGREES = (-180.0, -135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0, 180.0)


def fields_of_view(data: RigReportData) -> Section:
    """Draw the map of the directions around the rig, and list the overlaps."""
    seen = data.visible_directions
    count = seen.sum(0)
    covered = share_of_sphere(count >= 1)
    common = share_of_sphere(count >= 2)
    return Section(
        "fields-of-view",
        "Fields of view",
        join(_map(data, seen), _legend(int(count.max())), _overlap(data)),
        Guide(
            f"All directions around the rig in the frame of {data.reference}, of distant points: forward in the centre,"
            f" right at +90°, up at the top. The cameras see {covered:.0%} of the sphere, two or more of them"
            f" {common:.0%}. Lines are the edges of the calibrated fields of view.",
            "Overlap between neighbours: there boards connect the cameras, and stitching and stereo work.",
            "Show the board where two edges enclose a common area. If there is none, each camera needs a board of its"
            " own that stays in place while the rig moves.",
        ),
        wide=True,
    )


def _map(data: RigReportData, seen: Bools) -> Markup:
    left, top, right, bottom = BOX
    ticks = tuple((value, f"{value:g}°".replace("-", "−")) for value in DEGREES)
    axes = Axes((-180.0, 180.0), (-90.0, 90.0), "longitude, right is positive", "latitude, degrees", BOX, ticks)
    area = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    return chart(
        element("image", href=_png_url(_colors(data, seen)), preserveAspectRatio="none", **area),
        axes.frame(),
        *_names(data, axes),
        label="Directions that the cameras see: " + ", ".join(data.rig.names),
        width=CHART_SIZE[0],
        height=CHART_SIZE[1],
    )


def _names(data: RigReportData, axes: Axes) -> list[Markup]:
    """Write the name of each camera at its direction, or below the names that are there."""
    placed = list[Array]()
    names = list[Markup]()
    for name in data.rig.names:
        x, y, z = data.rig.sensor_from_rig[data.rig.index(name)].rotation[2]
        at = axes.positions(np.degrees(np.arctan2(x, z)), np.degrees(np.arcsin(np.clip(-y, -1, 1))))
        while any((abs(at - other) < NAME_SIZE).all() for other in placed):
            at = at + np.array([0.0, NAME_SIZE[1]])
        placed.append(at)
        text = {"x": float(at[0]), "y": float(at[1]) + 4, "text_anchor": "middle", "class_": "on strong"}
        names.append(element("text", name, fill=data.color(name), **text))
    return names


def _colors(data: RigReportData, seen: Bools) -> NDArray[np.uint8]:
    """Return the map (H, W, 4), RGBA: the number of cameras as a shade, and the edges in the colors of the cameras."""
    count = seen.sum(0)
    pixels = np.zeros((*count.shape, 4), np.uint8)
    for k, color in enumerate(SEEN, 1):
        pixels[count >= k] = (*color, 255)
    pixels[count == 0, 3] = UNSEEN_ALPHA
    for name, mask in zip(data.rig.names, seen, strict=True):
        # Column 0 follows the last one.
        edge = np.zeros_like(mask)
        for shift in range(1, EDGE_PX + 1):
            for rolled in (np.roll(mask, shift, 1), np.roll(mask, -shift, 1)):
                edge |= mask & ~rolled
            edge[shift:] |= mask[shift:] & ~mask[:-shift]
            edge[:-shift] |= mask[:-shift] & ~mask[shift:]
        edge |= np.roll(edge, 1, 1)
        edge[1:] |= edge[:-1].copy()
        pixels[edge] = (*bytes.fromhex(data.color(name)[1:]), 255)
    return pixels


def _png_url(pixels: NDArray[np.uint8]) -> str:
    import cv2

    _, png = cv2.imencode(".png", np.ascontiguousarray(pixels[..., [2, 1, 0, 3]]))
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode()


def _legend(most: int) -> Markup:
    """Return the shades by the number of cameras."""
    items = [
        element(
            "span",
            element("svg", element("rect", width=14, height=14, fill=f"rgb{color}"), width=14, height=14, class_="key"),
            f" {k}{' or more' if k == len(SEEN) else ''} camera{'s' * (k > 1)}",
        )
        for k, color in enumerate(SEEN[: max(most, 1)], 1)
    ]
    return element("p", *items, class_="note middle keys")


def _overlap(data: RigReportData) -> Markup:
    """Return the table of the shares of the fields of view that other cameras see."""
    names, shares = data.rig.names, data.rig.overlap()
    rows = [
        element(
            "tr",
            element("th", name, scope="row"),
            *(
                element("td", "–" if i == j else f"{value:.0%}" if np.isfinite(value) else "unknown", class_="number")
                for j, value in enumerate(row)
            ),
        )
        for i, (name, row) in enumerate(zip(names, shares, strict=True))
    ]
    caption = "Share of the field of view of the camera of the row that the camera of the column sees, far away"
    return table(("", *(f"by {name}" for name in names)), rows, caption=caption, class_="numbers")
