"""Table of the pairs of cameras: what connects them, and what to add."""

import numpy as np

from omnisight.quality.rig_checks import MIN_GOOD_SHARED_VIEWS, PairEvidence
from omnisight.report.html import Markup, element, join, table
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section

RULES = {
    "name": "have the same file name",
    "number": "have the same number in the file name",
    "order": "have the same place in the order of the files",
    "time": "were taken at the same time",
    "timestamp": "were taken at the same time, by the timestamps in their names",
}
BY_MOTION = (
    "By motion: no common board connects these cameras. Each saw a board of its own, and their relative pose follows"
    " from the motion of the rig between the boards, which were at rest."
)


def pairs(data: RigReportData) -> Section:
    """List the pairs of cameras that share images, and those that should."""
    calibration = data.calibration
    links = [pair for pair in calibration.pairs if pair.is_link]
    weakest = min(links, key=lambda pair: pair.agreeing, default=None)
    rows = [_row(data, pair, is_weakest=pair is weakest and len(data.rig) > 2) for pair in calibration.pairs]
    columns = ("pair", "common images", "agree", "rms px", "connects", "to do")
    by_motion = any(pair.is_link and _is_by_motion(data, pair) for pair in calibration.pairs)
    note = element("p", BY_MOTION, class_="note") if by_motion else None
    return Section(
        "pairs",
        "Pairs of cameras",
        join(table(columns, rows, class_="numbers"), note, _boards(data)),
        Guide(
            f"Simultaneous images {RULES[calibration.rule]}. Of each pair of cameras: simultaneous images in which both"
            " see a board, how many of them agree with the extrinsics, and the rms of their residuals, with outliers."
            " Links connect parts of the rig that no other pair connects as well.",
            f"At least {MIN_GOOD_SHARED_VIEWS} images that agree in every link, and nearly all images agree.",
            "Images that do not agree were not used for the extrinsics: the board or a camera moved between the"
            " exposures, or they are not of the same moment. See Residuals for their numbers.",
        ),
        wide=True,
    )


def _boards(data: RigReportData) -> Markup | None:
    """Return which of several boards are rigidly connected."""
    sets = data.calibration.board_sets
    if sum(map(len, sets)) == 1:
        return None
    fixed = [f"{', '.join(names)} are fixed to each other" for names in sets if len(names) > 1]
    alone = [names[0] for names in sets if len(names) == 1]
    moving = [f"{', '.join(alone)} {'move' if len(alone) > 1 else 'moves'} independently"] if alone else []
    return element("p", "Boards: ", element("bdi", "; ".join([*fixed, *moving])), ".", class_="note")


def _row(data: RigReportData, pair: PairEvidence, *, is_weakest: bool) -> Markup:
    link = "weakest link" if is_weakest else "link" if pair.is_link else ""
    if pair.is_link and _is_by_motion(data, pair):
        link += " by motion"
    return element(
        "tr",
        element("th", f"{pair.a} – {pair.b}", scope="row"),
        element("td", str(pair.shared), class_="number"),
        element("td", str(pair.agreeing), class_="number"),
        element("td", f"{pair.rms:.3f}" if np.isfinite(pair.rms) else "", class_="number"),
        element("td", link),
        element("td", _advice(pair)),
    )


def _is_by_motion(data: RigReportData, pair: PairEvidence) -> bool:
    """Return whether two cameras have no board in common."""
    return data.boards_of(pair.a).isdisjoint(data.boards_of(pair.b))


def _advice(pair: PairEvidence) -> str:
    """Return what images to take."""
    if pair.is_link and pair.agreeing < MIN_GOOD_SHARED_VIEWS:
        return "take about 10 more images with the board where both cameras see it, at different angles"
    if pair.agreeing < pair.shared:
        return f"check the {pair.shared - pair.agreeing} images that contradict the extrinsics"
    return "nothing"
