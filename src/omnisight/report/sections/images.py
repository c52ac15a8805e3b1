"""Every image, with the residuals of its corners drawn over it."""

import base64
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from omnisight.geometry.sphere import polar
from omnisight.images import UnreadableImage, read_image, to_gray8
from omnisight.report.axes import Axes, chart, dots_of, path_of, round_down
from omnisight.report.html import Markup, element, short, together
from omnisight.report.report_data import LEAST, Figure, Material, Picture, name_of

# Images are embedded this wide at most, px, and narrower where there are many: together they have so many pixels, of
# which JPEG takes about a fifth of a byte each.
WIDEST, NARROWEST, TOGETHER = 700, 240, 9_000_000
QUALITY = 72
# Of more images than this only those with the largest residuals are shown.
MOST = 120
# A residual as long as the rms is drawn about this long, parts of the image's width.
LONG = 0.035
CONE_STEPS = 180


def pictures(m: Material) -> Figure:
    """Draw all images."""
    shown = _chosen(m.images)
    times = exaggeration(m)
    width = embedded_width(m.camera.size, len(shown))
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        files = list(pool.map(lambda picture: _embedded(picture, width, m.apply_exif), shown))
    cards = [_card(m, picture, file, times) for picture, file in zip(shown, files, strict=True)]
    left_out = len(m.images) - len(shown)
    others = f" The {left_out} with the smallest residuals are not shown." if left_out else ""
    return Figure(
        "images",
        "What every image says",
        together(
            _beyond(m),
            element("div", _bars(m), class_="scroll bars"),
            element("p", f"Residuals are drawn {times:g} times as long as they are.{others}", class_="note"),
            element("ol", *cards, class_="cards"),
        ),
        (
            "Each line runs from where a corner was seen towards where the calibrated camera puts it, "
            f"{times:g} times as long as it is. Red lines are doubtful corners, which counted for little. "
            "The hatched part lies past the calibrated cone: no corner was seen there in any image.",
            "Short lines that point everywhere, and bars of about the same height.",
            "An image whose lines are long, or all point one way, is blurred, was taken while something moved, or has"
            " corners in the wrong place. Click it to drop it: the command that calibrates without it appears at the"
            " top.",
        ),
        "Images",
        wide=True,
    )


def exaggeration(m: Material) -> float:
    """Give how many times longer than they are residuals are drawn: a round number, the same for all images."""
    return max(1.0, round_down(LONG * m.camera.width / max(m.calibration.rms, LEAST)))


def embedded_width(size: tuple[int, int], count: int) -> int:
    """Give how wide, px, each of so many images of a size is embedded."""
    width, height = size
    fair = float(np.sqrt(TOGETHER / max(count, 1) * width / max(height, 1)))
    return max(1, round(min(width, WIDEST, max(fair, NARROWEST))))


def _chosen(given: Sequence[Picture]) -> list[Picture]:
    if len(given) <= MOST:
        return list(given)
    worst = sorted(given, key=lambda picture: -np.nan_to_num(picture.rms, nan=-1.0))[:MOST]
    return sorted(worst, key=lambda picture: picture.number)


def _embedded(picture: Picture, width: int, apply_exif: bool) -> str | None:
    """Give the image as a data: address; None if it cannot be read (any more)."""
    import cv2

    if picture.detection.size is None:
        return None
    try:
        image = read_image(picture.detection.path, apply_exif=apply_exif)
    except UnreadableImage:
        return None
    small: Any = image[..., 2::-1] if image.ndim == 3 and image.dtype == np.uint8 else to_gray8(image)
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    if width < image.shape[1]:
        small = cv2.resize(np.ascontiguousarray(small), (width, height), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(small), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode() if done else None


def _card(m: Material, picture: Picture, file: str | None, times: float) -> Markup:
    found = bool(picture.views)
    figures = f"{picture.corners} corners, rms {picture.rms:.2f}, worst {picture.worst:.2f} px"
    drawing = _drawing(m, picture, file, times) if picture.detection.size is not None else None
    said = f"Drop image {picture.number}, {picture.name}: {figures}"
    return element(
        "li",
        element("button", drawing, type="button", class_="drop", aria_pressed="false", aria_label=said)
        if found
        else element("div", drawing, class_="no-board"),
        element("p", element("b", picture.number), " ", name_of(picture.name), class_="name"),
        element("p", figures if found else "not used", class_="figures"),
        element("p", picture.detection.note, class_="note") if picture.detection.note else None,
        element("button", "Enlarge", type="button", class_="enlarge", aria_label=f"Enlarge image {picture.number}")
        if drawing is not None
        else None,
        id=f"image-{picture.number}",
        class_="card" if found else "card unused",
        data_number=picture.number,
        data_drop=m.dropping(picture) if found else None,
    )


def _drawing(m: Material, picture: Picture, file: str | None, times: float) -> Markup:
    width, height = m.camera.size
    # The pixel (0, 0) is a square around that place.
    place = {"x": -0.5, "y": -0.5, "width": float(width), "height": float(height)}
    parts = [element("image", href=file, preserveAspectRatio="none", **place)] if file is not None else []
    parts.append(element("use", href="#beyond"))
    if picture.views:
        pixels, residuals = m.calibration.views.pixels[picture.rows], m.residuals[picture.rows]
        doubtful = m.calibration.outliers[picture.rows]
        for rows, class_ in ((~doubtful, "sure"), (doubtful, "doubtful")):
            if rows.any():
                path = _lines(pixels[rows], residuals[rows] * times)
                parts.append(element("path", d=path, class_="under"))
                parts.append(element("path", d=path, class_=f"residual {class_}"))
        size = width / 26
        parts.append(
            element(
                "text", f"residuals × {times:g}", x=size / 2, y=height - size / 2, font_size=size, class_="exaggeration"
            )
        )
    what = "with its residuals" if picture.views else "without a board"
    said = f"Image {picture.number}, {picture.name}, {what}"
    return element("svg", *parts, viewBox=f"-0.5 -0.5 {width} {height}", role="img", aria_label=said, class_="image")


def _lines(pixels: Any, drawn: Any) -> str:
    """Give a path with a dot at every corner and a line along its residual."""
    known = np.isfinite(drawn).all(1)
    ends = zip(pixels[known], drawn[known], strict=True)
    lines = "".join(f"M{short(u)} {short(v)}l{short(a)} {short(b)}" for (u, v), (a, b) in ends)
    return lines + dots_of(pixels[~known])


def _beyond(m: Material) -> Markup:
    """Define the part of every image that lies past the calibrated cone."""
    width, height = m.camera.size
    azimuth = np.linspace(0, 2 * np.pi, CONE_STEPS, endpoint=False)
    rim, valid = m.far.model.project_numpy(polar(np.full(CONE_STEPS, m.reach * (1 - 1e-9)), azimuth))
    cone = path_of(rim[valid]) + "Z" if valid.any() else ""
    around = f"M-0.5 -0.5H{width - 0.5}V{height - 0.5}H-0.5Z"
    # Hatched in px of the image: a pattern of its own, as coarse as the image is large.
    step = width / 60
    pattern = element(
        "pattern",
        element("path", d=f"M0 0V{short(step)}", class_="hatching", stroke_width=step / 5),
        id="hatch-image",
        width=step,
        height=step,
        patternUnits="userSpaceOnUse",
        patternTransform="rotate(45)",
    )
    area = element("path", d=around + cone, fill="url(#hatch-image)", fill_rule="evenodd")
    rim_line = element("path", d=cone, class_="cone")
    return element(
        "svg",
        element("defs", pattern, element("g", area, rim_line, id="beyond")),
        class_="defs",
        width=0,
        height=0,
        aria_hidden="true",
    )


def _bars(m: Material) -> Markup:
    """Draw the rms of every image, each bar a link to its image."""
    found = [picture for picture in m.images if picture.views]
    top = max(LEAST, *(picture.rms for picture in found)) * 1.12
    count = len(m.images)
    step = max(1, int(np.ceil(count / 30)))
    axes = Axes(
        (0.5, count + 0.5),
        (0.0, top),
        "image",
        "rms, px",
        box=(52.0, 10.0, 908.0, 120.0),
        x_ticks=tuple((float(n), str(n)) for n in range(1, count + 1, step)),
    )
    shown = {picture.number for picture in _chosen(m.images)}
    bars = list[Markup]()
    for picture in found:
        (left, up), (right, down) = axes.at([picture.number - 0.36, picture.number + 0.36], [picture.rms, 0.0])
        bar = element(
            "rect",
            element("title", f"{picture.number} {picture.name}: {picture.rms:.3f} px"),
            x=float(left),
            y=float(up),
            width=float(right - left),
            height=float(down - up),
            class_="bar",
            data_number=picture.number,
        )
        said = f"Image {picture.number}: rms {picture.rms:.3f} px"
        bars.append(
            element("a", bar, href=f"#image-{picture.number}", aria_label=said) if picture.number in shown else bar
        )
    rms = m.calibration.rms
    return chart(
        axes.frame(),
        *bars,
        axes.line([0.5, count + 0.5], [rms, rms], "mean"),
        said=f"Bars: rms of the residuals of each image, px. The line is that of all images, {rms:.3f} px.",
        width=920,
        height=162,
        role="group",
    )
