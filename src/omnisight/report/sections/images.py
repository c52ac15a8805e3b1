"""All images with the residuals of their corners."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from omnisight.camera import Camera
from omnisight.geometry.sphere import polar
from omnisight.images import UnreadableImage, read_image
from omnisight.report.axes import Axes, chart, dot_path_data, nice_floor, path_data, segment_path_data
from omnisight.report.html import Markup, element, format_coordinate, join
from omnisight.report.jpeg_url import encode_jpeg_url
from omnisight.report.report_data import MIN_SCALE_PX, ReportData, ReportImage
from omnisight.report.section import Guide, Section
from omnisight.report.undistorted import Undistortion

# Limits of the width of embedded images, and of their pixels in all: JPEG takes about a fifth of a byte per pixel.
MAX_IMAGE_WIDTH_PX, MIN_IMAGE_WIDTH_PX, MAX_TOTAL_PIXELS = 700, 240, 9_000_000
# Width of the undistorted images over that of the images.
UNDISTORTED_SCALE = 0.7
# Of more images, only those with the largest residuals are shown.
MAX_IMAGES = 120
# Length of a residual of the size of the rms, as a fraction of the image width.
RMS_LENGTH_FRACTION = 0.035
# Points along the boundary of the calibrated field of view.
BOUNDARY_POINTS = 180
# Largest number of labels on the axis of the bar chart.
MAX_BAR_LABELS = 30


class Copies(NamedTuple):
    """Reduced copies of an image as data: URLs, None if it cannot be read: as it is, and undistorted."""

    image: str | None = None
    undistorted: str | None = None


def images(data: ReportData) -> Section:
    """Draw the images, each with its residuals and undistorted."""
    shown = _shown_images(data.images)
    scale = residual_scale(data)
    width = embedded_width(data.camera.size, len(shown))
    camera = data.camera if isinstance(data.camera, Camera) else data.camera.central(np.inf)[0]
    undistortion = Undistortion(camera, round(UNDISTORTED_SCALE * width))
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        copies = list(pool.map(lambda image: _copies(image, width, undistortion, data.options.apply_exif), shown))
    cards = [_card(data, *pair, scale) for pair in zip(shown, copies, strict=True)]
    hidden = len(data.images) - len(shown)
    others = f"The {hidden} images with the smallest residuals are not shown. " if hidden else ""
    return Section(
        "images",
        "Images",
        join(
            _extrapolated_area(data),
            element("div", _rms_chart(data), class_="scroll bars"),
            element(
                "p",
                element(
                    "span", f"Residuals are magnified {scale:g} times; point at one for its value. ", id="residual-note"
                ),
                others,
                element("button", "Show undistorted", type="button", id="undistort", aria_pressed="false")
                if any(copy.undistorted for copy in copies)
                else None,
                class_="note",
            ),
            element("ol", *cards, class_="cards"),
            element("p", "", id="residual-value", role="status", hidden=True),
        ),
        Guide(
            f"Lines are residuals from the detected to the projected corner, magnified {scale:g} times. Red lines are "
            "outliers, which have a low weight. The hatched area is outside the calibrated field of view: it has no "
            f"corners in any image. Undistorted images are {undistortion.description}.",
            "Short lines in random directions, and bars of similar height.",
            "If the lines of an image are long or parallel, it is blurred, was taken in motion, or has wrong corners. "
            "Click it to drop it: the command that calibrates without it appears at the top of the page.",
        ),
        wide=True,
    )


def residual_scale(data: ReportData) -> float:
    """Return the magnification of the residuals: a round number, the same for all images."""
    return max(1.0, nice_floor(RMS_LENGTH_FRACTION * data.camera.width / max(data.rms_px, MIN_SCALE_PX)))


def embedded_width(size: tuple[int, int], count: int) -> int:
    """Return the width (px) at which each of `count` images of a size is embedded."""
    width, height = size
    fair = float(np.sqrt(MAX_TOTAL_PIXELS / max(count, 1) * width / max(height, 1)))
    return max(1, round(min(width, MAX_IMAGE_WIDTH_PX, max(fair, MIN_IMAGE_WIDTH_PX))))


def _shown_images(images: Sequence[ReportImage]) -> list[ReportImage]:
    if len(images) <= MAX_IMAGES:
        return list(images)
    worst = sorted(images, key=lambda image: -np.nan_to_num(image.rms_px, nan=-1.0))[:MAX_IMAGES]
    return sorted(worst, key=lambda image: image.number)


def _copies(image: ReportImage, width: int, undistortion: Undistortion, apply_exif: bool) -> Copies:
    """Return the copies of an image; those of an image of another size than the camera's are not undistorted."""
    if image.path is None or image.size is None:
        return Copies()
    try:
        pixels = read_image(image.path, apply_exif=apply_exif)
    except UnreadableImage:
        return Copies()
    url = encode_jpeg_url(pixels, width)
    if pixels.shape[1::-1] != undistortion.source_size:
        return Copies(url)
    return Copies(url, encode_jpeg_url(undistortion(pixels), width))


def _card(data: ReportData, image: ReportImage, copies: Copies, scale: float) -> Markup:
    used = bool(image.views)
    figures = f"{image.corners} corners, rms {image.rms_px:.2f}, max {image.max_px:.2f} px" if used else "not used"
    drawing = _drawing(data, image, copies.image, scale) if image.size is not None else None
    if copies.undistorted is not None:
        name = f"Image {image.number}, {image.name}, undistorted"
        # The size gives the image its place on the page before it is decoded.
        width, height = data.camera.size
        source = {"src": copies.undistorted, "alt": name, "width": width, "height": height, "loading": "lazy"}
        drawing = join(drawing, element("img", **source, class_="undistorted"))
    label = f"Drop image {image.number}, {image.name}: {figures}"
    enlarge = element("button", "Enlarge", type="button", class_="enlarge", aria_label=f"Enlarge image {image.number}")
    return element(
        "li",
        element("button", drawing, type="button", class_="drop", aria_pressed="false", aria_label=label)
        if used
        else element("div", drawing, class_="no-board"),
        # The isolation element keeps the writing direction of a file name inside it.
        element("p", element("b", image.number), " ", element("bdi", image.name), class_="name"),
        element("p", figures, class_="figures"),
        element("p", image.note, class_="note") if image.note else None,
        enlarge if drawing is not None else None,
        id=f"image-{image.number}",
        class_="card" if used else "card unused",
        data_number=image.number,
        data_drop=data.drop_option(image) if used else None,
    )


def _drawing(data: ReportData, image: ReportImage, url: str | None, scale: float) -> Markup:
    width, height = data.camera.size
    # The pixel (0, 0) is a square with its centre at (0, 0).
    area = {"x": -0.5, "y": -0.5, "width": float(width), "height": float(height)}
    parts = [element("image", href=url, preserveAspectRatio="none", **area)] if url is not None else []
    parts.append(element("use", href="#extrapolated-image"))
    if image.views:
        pixels, vectors = data.observations.pixels[image.rows], scale * data.residuals[image.rows]
        outliers = data.outliers[image.rows]
        for rows, class_ in ((~outliers, "inlier"), (outliers, "outlier")):
            if rows.any():
                path = _residual_path(pixels[rows], vectors[rows])
                parts.append(element("path", d=path, class_="under"))
                parts.append(element("path", d=path, class_=f"residual {class_}"))
        size = width / 26
        text = {"x": size / 2, "y": height - size / 2, "font_size": size, "class_": "magnification"}
        parts.append(element("text", f"residuals × {scale:g}", **text))
    label = f"Image {image.number}, {image.name}, {'with residuals' if image.views else 'without board'}"
    view = f"-0.5 -0.5 {width} {height}"
    return element("svg", *parts, viewBox=view, role="img", aria_label=label, class_="image", data_scale=scale)


def _residual_path(pixels: Any, vectors: Any) -> str:
    """Return SVG path data with a line per residual, and a dot if the residual is not finite."""
    finite = np.isfinite(vectors).all(1)
    return segment_path_data(pixels[finite], vectors[finite]) + dot_path_data(pixels[~finite])


def _extrapolated_area(data: ReportData) -> Markup:
    """Define the area of the images outside the calibrated field of view, for use in all images."""
    width, height = data.camera.size
    calibrated = _boundary(data, data.max_theta * (1 - 1e-9))
    if data.central_limit.theta_min > 0:  # the blind spot of a mirror
        calibrated += _boundary(data, data.central_limit.theta_min)
    image_area = f"M-0.5 -0.5H{width - 0.5}V{height - 0.5}H-0.5Z"
    # The hatching is in pixels of the image, so it needs a pattern of its own.
    step = width / 60
    pattern = element(
        "pattern",
        element("path", d=f"M0 0V{format_coordinate(step)}", class_="hatching", stroke_width=step / 5),
        id="hatch-image",
        width=step,
        height=step,
        patternUnits="userSpaceOnUse",
        patternTransform="rotate(45)",
    )
    area = element("path", d=image_area + calibrated, fill="url(#hatch-image)", fill_rule="evenodd")
    edge = element("path", d=calibrated, class_="calibrated-edge")
    return definitions(pattern, element("g", area, edge, id="extrapolated-image"))


def _boundary(data: ReportData, theta: float) -> str:
    """Return SVG path data of the pixels at an angle from the axis (radians)."""
    azimuth = np.linspace(0, 2 * np.pi, BOUNDARY_POINTS, endpoint=False)
    pixels, valid = data.central_limit.model.project_numpy(polar(np.full(BOUNDARY_POINTS, theta), azimuth))
    return path_data(pixels[valid]) + "Z" if valid.any() else ""


def definitions(*content: Markup) -> Markup:
    """Return an invisible SVG element with definitions that other drawings refer to."""
    return element("svg", element("defs", *content), class_="defs", width=0, height=0, aria_hidden="true")


def _rms_chart(data: ReportData) -> Markup:
    """Draw the rms of each image as a bar that links to the image."""
    used = [image for image in data.images if image.views]
    top = max(MIN_SCALE_PX, *(image.rms_px for image in used)) * 1.12
    count = len(data.images)
    step = max(1, int(np.ceil(count / MAX_BAR_LABELS)))
    ticks = tuple((float(n), str(n)) for n in range(1, count + 1, step))
    axes = Axes((0.5, count + 0.5), (0.0, top), "image", "rms, px", (52.0, 10.0, 908.0, 120.0), ticks)
    shown = {image.number for image in _shown_images(data.images)}
    bars = list[Markup]()
    for image in used:
        (left, upper), (right, lower) = axes.positions([image.number - 0.36, image.number + 0.36], [image.rms_px, 0.0])
        title = element("title", f"{image.number} {image.name}: {image.rms_px:.3f} px")
        area = {"x": float(left), "y": float(upper), "width": float(right - left), "height": float(lower - upper)}
        bar = element("rect", title, **area, class_="bar", data_number=image.number)
        label = f"Image {image.number}: rms {image.rms_px:.3f} px"
        bars.append(
            element("a", bar, href=f"#image-{image.number}", aria_label=label) if image.number in shown else bar
        )
    return chart(
        axes.frame(),
        *bars,
        axes.line(axes.x_range, [data.rms_px] * 2, "mean"),
        label=f"Rms of the residuals of each image, px. The line is the rms of all images, {data.rms_px:.3f} px.",
        width=920,
        height=162,
        role="group",
    )
