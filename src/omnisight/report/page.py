"""The page: verdict first, then every figure with how to read it beside it."""

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from omnisight.camera import Camera
from omnisight.images import write_bytes
from omnisight.pipeline.central import Calibration
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.ray_camera import RayCamera
from omnisight.report.sections.coverage import coverage
from omnisight.report.json_data import embedded
from omnisight.report.sections.downloads import downloads
from omnisight.report.html import Markup, element
from omnisight.report.report_data import Figure, Material
from omnisight.report.sections.model_comparison import models
from omnisight.report.sections.parameters import parameters
from omnisight.report.sections.images import pictures
from omnisight.report.sections.radial_profile import profile
from omnisight.report.sections.residuals import residuals
from omnisight.report.sections.board_poses import scene
from omnisight.report.sections.pupil_shift import travel
from omnisight.report.sections.projection_uncertainty import uncertainty
from omnisight.report.sections.verdict import key_figures, title, verdict
from omnisight.report.sections.noncentral_test import viewpoint
from omnisight.targets import Detections

# In the order of the page.
FIGURES = (
    pictures,
    coverage,
    profile,
    travel,
    uncertainty,
    residuals,
    models,
    viewpoint,
    scene,
    parameters,
    downloads,
)


def write_report(
    calibration: Calibration | RaysCalibration,
    search: Detections,
    camera: Camera | RayCamera,
    path: str | Path,
    *,
    names: Sequence[str],
    command: Sequence[str],
    apply_exif: bool = False,
    asked: NonCentralityTest | None = None,
) -> None:
    """Write a calibration as one HTML file that fetches nothing.

    The images are read again and embedded small: together 9 megapixels at most, which makes a file of some MB.

    Parameters
    ----------
    calibration
        The calibration, of a central camera or of one whose rays need not meet in a point.
    search
        The boards of its views, image by image.
    camera
        Its camera, as it was written: with its provenance.
    path
        The file, which appears whole or not at all; its folder must exist.
    names
        One for each image of `search`: what `--drop` knows it by.
    command
        The words of the command that made the calibration: the page adds `--drop` to it.
    apply_exif
        As the images were read.
    asked
        Whether the viewpoint moves: the page has a part on it where that was asked.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = page(Material(calibration, search, camera, names, command, apply_exif, asked))
    # A file name that is no text in this encoding has stray surrogates.
    write_bytes(path, text.encode("utf-8", "replace"))


def page(m: Material) -> str:
    """Give the text of the page."""
    style, script = (files("omnisight.report").joinpath(name).read_text("utf-8") for name in ("style.css", "script.js"))
    # Nothing from anywhere: neither fetched nor, should a name have slipped through, run.
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}';"
        " base-uri 'none'; form-action 'none'"
    )
    figures = [shown for figure in FIGURES if (shown := figure(m)) is not None]
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", f"Calibration: {m.calibration.verdict}, {m.camera.model.name}"),
        element("style", Markup(style)),
    )
    links = [element("a", figure.short, href=f"#{figure.name}") for figure in figures]
    body = element(
        "body",
        _patterns(),
        _dropped(m),
        element("header", title(m)),
        element(
            "main",
            verdict(m),
            key_figures(m),
            element("nav", *links, aria_label="Parts of this report"),
            *map(_section, figures),
        ),
        element("footer", element("p", "Made by: ", element("code", m.quoted(m.command)))),
        element("dialog", element("div"), element("button", "Close", type="button"), aria_label="Image, enlarged"),
        embedded(m),
        element("script", Markup(script)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _section(figure: Figure) -> Markup:
    said = zip(("What it shows", "What is good", "What to do"), figure.how, strict=True)
    how = element(
        "aside",
        element("h3", "How to read this"),
        *(element("p", element("b", what), " ", paragraph) for what, paragraph in said),
        class_="how",
    )
    return element(
        "section",
        element("h2", figure.title),
        element("div", element("div", figure.body, class_="body"), how, class_="wide" if figure.wide else "beside"),
        id=figure.name,
        class_="figure",
    )


def _dropped(m: Material) -> Markup:
    """Give the bar that says the command without the images that were dropped; scripts show it."""
    return element(
        "div",
        element("p", element("b", "", id="dropped-count"), " This calibrates without them:", id="dropped-said"),
        element("code", "", id="dropped-command", tabindex=0),
        element(
            "p",
            element("button", "Copy the command", type="button", id="dropped-copy"),
            element("button", "Take them all back", type="button", id="dropped-none"),
        ),
        id="dropped",
        hidden=True,
        role="status",
        data_command=m.quoted(m.command),
    )


def _patterns() -> Markup:
    """Define the hatching that figures share."""
    lines = element("path", d="M0 0V6", class_="hatching", stroke_width=1.4)
    orange = element("path", d="M0 0V6", class_="hatching missing-line", stroke_width=2)
    common = {"width": 6, "height": 6, "patternUnits": "userSpaceOnUse", "patternTransform": "rotate(45)"}
    return element(
        "svg",
        element(
            "defs",
            element("pattern", lines, id="hatch", **common),
            element("pattern", orange, id="hatch-missing", **common),
        ),
        class_="defs",
        width=0,
        height=0,
        aria_hidden="true",
    )


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
