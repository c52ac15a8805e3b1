"""Residuals of each camera of a rig: over its images, and over the image area."""

from collections.abc import Sequence

import numpy as np

from omnisight.report.axes import Axes, chart
from omnisight.report.html import Markup, element, join
from omnisight.report.report_data import MIN_SCALE_PX
from omnisight.report.rigs.rig_report_data import RigReportData, RigView
from omnisight.report.section import Guide, Section
from omnisight.report.sections.residuals import residual_map

# Largest number of labels on the axis of the bar charts.
MAX_BAR_LABELS = 30
# Images with the largest residuals that are named below a bar chart.
WORST_IMAGES = 3


def rig_residuals(data: RigReportData) -> Section:
    """Draw for each camera the rms of its images, and the mean residuals over its image area."""
    top = max(MIN_SCALE_PX, *(view.rms_px for view in data.views)) * 1.12
    blocks = [_camera(data, name, top) for name in data.rig.names]
    return Section(
        "residuals",
        "Residuals",
        join(*blocks),
        Guide(
            "Bars are the rms of each image without outliers; simultaneous images have the same number in all"
            " cameras, and in the 3-D drawing. Red bars are images that contradict the extrinsics and were not used for"
            " them. Arrows are the mean residuals in each part of the image of a camera, magnified.",
            "Bars of similar height, and arrows in random directions.",
            "One high bar in one camera: that image is blurred or has wrong corners. High or red bars of the same"
            " number in several cameras: the images are not of the same moment, or the board moved. Leave them out with"
            " --drop NAME. Arrows with a pattern are an error of the camera model.",
        ),
        wide=True,
    )


def _camera(data: RigReportData, name: str, top: float) -> Markup:
    camera = data.rig.cameras[data.rig.index(name)]
    views = [view for view in data.views if view.camera == name]
    drawing, scale = residual_map(*data.inliers_of(name), camera.size)
    worst = sorted(views, key=lambda view: -view.rms_px)[:WORST_IMAGES]
    listed = ", ".join(f"{view.image} ({view.number}) {view.rms_px:.2f} px" for view in worst)
    outliers = sum(view.outliers for view in views)
    corners = sum(view.corners for view in views)
    return element(
        "div",
        element("h3", name),
        element("div", _bars(data, name, views, top), class_="scroll bars"),
        element(
            "p",
            f"{corners} corners, {outliers} of them outliers. Largest: ",
            element("bdi", listed),
            *_contradicting(views),
            class_="note",
        ),
        element("div", drawing, class_="alone"),
        element("p", f"Mean residuals of {name}, magnified {scale:g} times.", class_="note middle"),
        class_="camera-residuals",
    )


def _contradicting(views: Sequence[RigView]) -> list[Markup | str]:
    """Return the names of the images that contradict the extrinsics."""
    names = [f"{view.image} ({view.number})" for view in views if not view.agrees]
    return [". Contradict the extrinsics: ", element("bdi", ", ".join(names))] if names else []


def _bars(data: RigReportData, name: str, views: Sequence[RigView], top: float) -> Markup:
    count, rms = data.frames, data.inlier_rms(name)
    step = max(1, int(np.ceil(count / MAX_BAR_LABELS)))
    ticks = tuple((float(n), str(n)) for n in range(1, count + 1, step))
    axes = Axes((0.5, count + 0.5), (0.0, top), "simultaneous images", "rms, px", (52.0, 10.0, 908.0, 100.0), ticks)
    bars = list[Markup]()
    for view in views:
        (left, upper), (right, lower) = axes.positions([view.number - 0.36, view.number + 0.36], [view.rms_px, 0.0])
        note = "" if view.agrees else ", contradicts the extrinsics"
        title = element("title", f"{view.number} {view.image}: {view.rms_px:.3f} px{note}")
        area = {"x": float(left), "y": float(upper), "width": float(right - left), "height": float(lower - upper)}
        bars.append(element("rect", title, **area, class_="bar" if view.agrees else "bar contradicting"))
    return chart(
        axes.frame(),
        *bars,
        axes.line(axes.x_range, [rms] * 2, "mean"),
        label=f"Rms of the residuals of each image of {name}, px. The line is the rms of all inliers, {rms:.3f} px.",
        width=920,
        height=142,
    )
