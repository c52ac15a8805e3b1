"""What `omnisight evaluate` says."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omnisight.calibration.evaluation import Evaluation, Ring
from omnisight.cli._console import console
from omnisight.report.drawings.detections import rows_of_pictures
from omnisight.targets import Detections

WORST = 8  # images that are listed
FIGURES = ("rms", "mean", "median", "wrms", "worst")


def picture_rows(search: Detections, names: Sequence[str], found: Evaluation) -> list[dict[str, Any]]:
    """Give one row per image: name, figures (px) of the corners that the camera shows, and how many it does not."""
    groups = iter(rows_of_pictures(search))
    table: list[dict[str, Any]] = []
    for picture, name in zip(search.images, names, strict=True):
        which = np.zeros(len(found.lengths), bool)
        if picture.boards:
            which[next(groups)] = True
        lost = int((which & ~found.shown).sum())
        table.append({"name": name, **found.figures(which).as_dict(), "without_pixel": lost, "note": picture.note})
    return table


def as_json(search: Detections, names: Sequence[str], found: Mapping[str, Evaluation]) -> None:
    """Print one object on stdout, and nothing else; `found` by the name of the camera, the judged one first."""
    judged, *others = found.items()
    common = common_corners(found)
    said = {
        **_camera(*judged),
        "images": picture_rows(search, names, judged[1]),
        "notes": _notes(search),
        "common_corners": int(common.sum()),
        "compared": [
            {**_camera(*other), "common": other[1].figures(common).as_dict()} for other in (judged, *others) if others
        ],
    }
    print(json.dumps(said, indent=2, allow_nan=False))


def _camera(name: str, found: Evaluation) -> dict[str, Any]:
    return {
        "camera": name,
        "model": found.camera.model.name,
        "threshold": found.threshold,
        "board_warp": [float(bend) for bend in found.state.warp],
        "all": found.figures().as_dict(),
        "without_pixel": int((~found.shown).sum()),
        "calibrated_deg": None if found.camera.theta_max is None else float(np.degrees(found.camera.theta_max)),
        "calibrated": found.figures(found.calibrated).as_dict(),
        "beyond": found.figures(~found.calibrated).as_dict(),
        "rings": [
            {
                "from_deg": float(np.degrees(ring.start)),
                "to_deg": float(np.degrees(ring.stop)),
                **ring.figures.as_dict(),
            }
            for ring in found.rings()
        ],
    }


def print_report(search: Detections, names: Sequence[str], found: Mapping[str, Evaluation]) -> None:
    """Print the tables and what to make of them."""
    (name, judged), *others = found.items()
    out = console()
    rows = [row for row in picture_rows(search, names, judged) if row["corners"] or row["without_pixel"]]
    worst = sorted(rows, key=lambda row: -(row["rms"] if row["rms"] is not None else np.inf))[:WORST]
    table = _table("image" if len(worst) == len(rows) else f"worst of {len(rows)} images", "note")
    for row in worst:
        table.add_row(row["name"], *_figures(row), row["note"])
    out.print(table)
    out.print()
    rings = _table("angle from the axis", "")
    for ring in judged.rings():
        rings.add_row(_angles(ring), *_figures(ring.figures.as_dict()), _beyond(ring, judged))
    out.print(rings)
    out.print()
    if others:
        _print_compared(out, found)
    shown = judged.figures()
    out.print(
        f"{name} ({judged.camera.model.name}) as it is, {len(judged.views)} poses free: {shown.corners} corners,"
        f" rms {_px(shown.rms)}, mean {_px(shown.mean)}, median {_px(shown.median)}, wRMS {_px(shown.wrms)}",
        soft_wrap=True,
    )
    for sentence in (*_told_apart(judged), *_notes(search)):
        out.print(sentence, soft_wrap=True)
    out.print(
        f"wRMS: a residual longer than {judged.threshold:g} px weighs sqrt({judged.threshold:g} px / its length), as in"
        " BabelCalib (Lochman et al., ICCV 2021)",
        soft_wrap=True,
    )


def common_corners(found: Mapping[str, Evaluation]) -> Any:
    """Say which corners (N,) all cameras show: what they are compared on."""
    return np.all([one.shown for one in found.values()], axis=0)


def _print_compared(out: Any, found: Mapping[str, Evaluation]) -> None:
    common = common_corners(found)
    table = _table("camera", "model", "beyond its cone", "without a pixel")
    for name, one in found.items():
        beyond, lost = int((one.shown & ~one.calibrated).sum()), int((~one.shown).sum())
        figures = _figures(one.figures(common).as_dict())
        table.add_row(name, *figures, one.camera.model.name, str(beyond or ""), str(lost or ""))
    out.print(table)
    if not common.all():
        out.print(f"compared on the {common.sum()} of {len(common)} corners that all of them show", soft_wrap=True)
    out.print()


def _told_apart(found: Evaluation) -> list[str]:
    """Say how it does beyond the calibrated cone, and which corners it does not show."""
    said: list[str] = []
    reach = found.camera.theta_max
    beyond = found.figures(~found.calibrated)
    if reach is not None and beyond.corners:
        inner = f"{np.degrees(found.camera.theta_min):.0f} to " if found.camera.theta_min else ""
        said.append(
            f"beyond the cone it was calibrated in ({inner}{np.degrees(reach):.0f} degrees): {beyond.corners} corners,"
            f" rms {_px(beyond.rms)}; within: rms {_px(found.figures(found.calibrated).rms)}"
        )
    if lost := int((~found.shown).sum()):
        said.append(
            f"{lost} corners lie where the model has no pixel (it ends {np.degrees(found.camera.model.theta_max):.0f}"
            " degrees from the axis): they are in none of the figures"
        )
    if found.state.warp.any():
        across, down = found.state.warp
        said.append(f"the board is bent: by {across:+.3g} across and {down:+.3g} down, in its unit")
    return said


def _notes(search: Detections) -> list[str]:
    return [f"note: {note}" for note in (search.hint, *search.notes) if note]


def _table(first: str, *last: str) -> Any:
    from rich.table import Table

    heads = [f"{name} px".replace("wrms", "wRMS") for name in FIGURES]
    table = Table(first, "corners", *heads, *last, box=None, pad_edge=False)
    for column in table.columns[1 : 2 + len(heads)]:
        column.justify = "right"
    return table


def _figures(figures: Mapping[str, Any]) -> list[str]:
    shown = ["" if figures[name] is None else f"{figures[name]:.3f}" for name in FIGURES]
    return [str(figures["corners"]), *shown]


def _angles(ring: Ring) -> str:
    return f"{np.degrees(ring.start):.0f} to {np.degrees(ring.stop):.0f} degrees"


def _beyond(ring: Ring, found: Evaluation) -> str:
    reach = found.camera.theta_max
    if reach is None or (ring.stop <= reach and ring.start >= found.camera.theta_min):
        return ""
    return "not calibrated" if ring.start >= reach or ring.stop <= found.camera.theta_min else "calibrated in part"


def _px(value: float) -> str:
    return f"{value:.3f} px"
