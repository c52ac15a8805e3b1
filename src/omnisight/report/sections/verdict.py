"""The head of a report: whether to use the camera, why, and the figures that say so."""

import numpy as np

from omnisight.optics.models.axial import Axial
from omnisight.quality.evidence import Level
from omnisight.report.html import Markup, element, together
from omnisight.report.report_data import Material
from omnisight.report.number_format import with_sigma

SIGNS = {Level.GOOD: "✓", Level.USABLE: "!", Level.DO_NOT_USE: "✕"}
WORDS = {Level.GOOD: "Good", Level.USABLE: "Usable", Level.DO_NOT_USE: "Do not use"}
MEANS = {
    Level.GOOD: "This calibration can be used as it is.",
    Level.USABLE: "This calibration can be used. What is said below would make it better.",
    Level.DO_NOT_USE: "This calibration is not to be relied on. What is said below has to be mended first.",
}


def verdict(m: Material) -> Markup:
    """Draw it."""
    judged = m.calibration.verdict
    reasons = sorted((check for check in judged.checks if check.sentence), key=lambda check: -check.level)
    return element(
        "section",
        element("p", SIGNS[judged.level], class_="sign", aria_hidden="true"),
        element("h2", WORDS[judged.level]),
        element("p", MEANS[judged.level], class_="means"),
        element(
            "ul",
            *(
                element("li", element("b", SIGNS[check.level], class_=_class(check.level)), " ", check.sentence)
                for check in reasons
            ),
            class_="reasons",
        )
        if reasons
        else None,
        element(
            "ul",
            *(
                element("li", f"{SIGNS[c.level]} {c.name.replace('_', ' ')}", class_=_class(c.level))
                for c in judged.checks
            ),
            class_="checks",
            aria_label="What was looked at",
        ),
        id="verdict",
        class_=f"verdict {_class(judged.level)}",
    )


def key_figures(m: Material) -> Markup:
    """Draw the figures that a reader asks for first."""
    c, found = m.calibration, sum(bool(picture.views) for picture in m.images)
    middle, middle_angle = c.trust.uncertainty.median()
    pixels, angle, theta, _ = c.trust.uncertainty.worst()
    tiles = [
        (
            "Error on images held out",
            _px(c.held_out_rms),
            "rms over images it was not calibrated on, without the corners that no model explains",
        ),
        ("Error on its own images", _px(c.rms), f"rms; the mean is {c.mean:.3f} px"),
        (
            "Uncertainty",
            _px(middle, "± "),
            f"and {np.degrees(middle_angle):.2g}° in most places; at worst {pixels:.2g} px and"
            f" {np.degrees(angle):.2g}°, {np.degrees(theta):.0f}° from the axis"
            if np.isfinite(pixels)
            else "so few images do not tell it",
        ),
        ("Calibrated to", f"{np.degrees(m.reach):.0f}°", "from the axis: so far out corners were seen"),
        ("Covered", f"{c.trust.coverage.share:.0%}", "of what the image shows had corners in it"),
        *_viewpoint(m),
        (
            "Images",
            f"{found} of {len(m.images)}",
            f"with {len(c.views.pixels)} corners, {int(c.outliers.sum())} of them doubtful",
        ),
    ]
    return element(
        "dl",
        *(
            element("div", element("dt", name), element("dd", value, class_="figure"), element("dd", said))
            for name, value, said in tiles
        ),
        class_="tiles",
    )


def _viewpoint(m: Material) -> list[tuple[str, str, str]]:
    """Give how far the viewpoint moves, if that is what it does."""
    if m.travel is None:
        return []
    scale, unit = m.drawn_length
    length, sigma = with_sigma(scale * m.travel.length, scale * m.travel.length_sigma)
    said = f"± {sigma} {unit} along the axis, between the first corner and the last"
    return [("Viewpoint moves by", f"{length} {unit}", said)]


def title(m: Material) -> Markup:
    """Name the camera."""
    camera = m.camera
    lens = f", its lens {camera.model.lens.name}" if isinstance(camera.model, Axial) else ""
    made = ", ".join(str(camera.provenance[key]) for key in ("tool", "date") if camera.provenance.get(key))
    board = m.search.board
    return together(
        element("h1", f"Camera calibration: {camera.model.name}{lens}"),
        element(
            "p",
            f"Images of {camera.width} × {camera.height} px",
            f" · {board.kind} {board}" if board is not None else None,
            f" · {made}" if made else None,
            class_="about",
        ),
    )


def _class(level: Level) -> str:
    return level.name.lower().replace("_", "-")


def _px(value: float | None, before: str = "") -> str:
    return "unknown" if value is None or not np.isfinite(value) else f"{before}{value:.2g} px"
