"""The head of the report: title, verdict with its reasons, and key figures."""

from collections.abc import Sequence

import numpy as np

from omnisight.display import rounded
from omnisight.optics.models.axial import Axial
from omnisight.quality.evidence import Check, Level
from omnisight.quality.verdict import Verdict
from omnisight.report.html import Markup, element, join
from omnisight.report.number_format import format_with_sigma
from omnisight.report.report_data import ReportData

SYMBOLS = {Level.GOOD: "✓", Level.USABLE: "!", Level.DO_NOT_USE: "✕"}
# A passed check with a remark is neither a warning nor an approval.
REMARK_SYMBOL = "i"
LABELS = {Level.GOOD: "Good", Level.USABLE: "Usable", Level.DO_NOT_USE: "Do not use"}
MEANINGS = {
    Level.GOOD: "The calibration can be used as it is.",
    Level.USABLE: "The calibration can be used. Fixing the points below would improve it.",
    Level.DO_NOT_USE: "The calibration is not reliable. Fix the points below first.",
}


def title(data: ReportData) -> Markup:
    """Return the heading with camera model, image size, board, software and date."""
    camera, detections = data.camera, data.detections
    lens = f" with lens model {camera.model.lens.name}" if isinstance(camera.model, Axial) else ""
    created = ", ".join(str(camera.provenance[key]) for key in ("tool", "date") if camera.provenance.get(key))
    board = None if detections is None else detections.board
    return join(
        element("h1", f"Camera calibration: {camera.model.name}{lens}"),
        element(
            "p",
            f"Images of {camera.width} × {camera.height} px",
            f" · {board.kind} {board}" if board is not None else None,
            f" · {created}" if created else None,
            class_="about",
        ),
    )


def verdict(result: Verdict) -> Markup:
    """Return the verdict with its reasons, the most severe first, and the result of each check."""
    findings = sorted((check for check in result.checks if check.sentence), key=lambda check: -check.level)
    reasons = [
        element("li", element("b", _symbol(check), class_=_check_class(check)), " ", check.sentence)
        for check in findings
    ]
    checks = [
        element("li", f"{_symbol(check)} {check.name.replace('_', ' ')}", class_=_check_class(check))
        for check in result.checks
    ]
    return element(
        "section",
        element("p", SYMBOLS[result.level], class_="symbol", aria_hidden="true"),
        element("h2", LABELS[result.level]),
        element("p", MEANINGS[result.level], class_="meaning"),
        element("ul", *reasons, class_="reasons") if reasons else None,
        element("ul", *checks, class_="checks", aria_label="Checks"),
        id="verdict",
        class_=f"verdict {_level_class(result.level)}",
    )


def key_figures(data: ReportData) -> Markup:
    """Return the key figures as tiles."""
    used = sum(bool(image.views) for image in data.images)
    figures = [
        ("Held-out error", _px(data.selected.held_out_rms), "rms over images left out of the fit, without outliers"),
        ("Reprojection error", _px(data.rms_px), f"rms; mean {data.selected.mean:.3f} px"),
        _uncertainty_tile(data),
        ("Calibrated field of view", f"{np.degrees(data.max_theta):.0f}°", "off-axis, up to the outermost corner"),
        ("Coverage", f"{data.coverage.share:.0%}", "of the field of view has corners"),
        *_pupil_shift_tiles(data),
        (
            "Images",
            f"{used} of {len(data.images)}",
            f"with {len(data.outliers)} corners; outliers: {int(data.outliers.sum())}",
        ),
    ]
    return tiles(figures)


def tiles(figures: Sequence[tuple[str, str, str]]) -> Markup:
    """Return key figures (name, value, detail) as tiles."""
    return element(
        "dl",
        *(
            element("div", element("dt", name), element("dd", value, class_="figure"), element("dd", detail))
            for name, value, detail in figures
        ),
        class_="tiles",
    )


def _uncertainty_tile(data: ReportData) -> tuple[str, str, str]:
    rms_px, rms_rad = data.uncertainty.rms(), data.uncertainty.rms_angle()
    max_px, max_rad, theta, _ = data.uncertainty.worst()
    if not np.isfinite(max_px):
        return "Projection uncertainty", _px(rms_px, "± "), "unknown: not enough images"
    detail = (
        f"and {rounded(np.degrees(rms_rad))}° (rms, 1σ); at most {rounded(max_px)} px and"
        f" {rounded(np.degrees(max_rad))}°,"
        f" {np.degrees(theta):.0f}° off-axis"
    )
    return "Projection uncertainty", _px(rms_px, "± "), detail


def _pupil_shift_tiles(data: ReportData) -> list[tuple[str, str, str]]:
    """Return a tile for the entrance pupil shift of an axial camera."""
    if data.pupil_shift is None:
        return []
    scale, unit = data.display_unit
    length, sigma = format_with_sigma(scale * data.pupil_shift.length, scale * data.pupil_shift.length_sigma)
    return [("Entrance pupil shift", f"{length} {unit}", f"± {sigma} {unit} along the axis, over the field of view")]


def _symbol(check: Check) -> str:
    return REMARK_SYMBOL if _is_remark(check) else SYMBOLS[check.level]


def _check_class(check: Check) -> str:
    return "remark" if _is_remark(check) else _level_class(check.level)


def _is_remark(check: Check) -> bool:
    return check.level == Level.GOOD and bool(check.sentence)


def _level_class(level: Level) -> str:
    return level.name.lower().replace("_", "-")


def _px(value: float | None, prefix: str = "") -> str:
    return "unknown" if value is None or not np.isfinite(value) else f"{prefix}{rounded(value)} px"
