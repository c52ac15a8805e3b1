"""Output of `omnisight evaluate`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.evaluation import Evaluation, Ring
from omnisight.cli._console import console
from omnisight.cli._output import write_json

# Images that are printed, those with the largest rms.
MAX_IMAGES = 8
STATISTICS = ("rms", "mean", "median", "wrms", "worst")


def image_rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    """Return one row per image: name, statistics (px) of the corners in the domain, number outside it, note."""
    rows: list[dict[str, Any]] = []
    for image in evaluation.observations.images:
        use = np.zeros(len(evaluation.lengths), bool)
        use[image.rows] = True
        outside = int((use & ~evaluation.in_domain).sum())
        note = "" if image.detection is None else image.detection.note
        rows.append(
            {"name": image.name, **evaluation.statistics(use).as_dict(), "outside_domain": outside, "note": note}
        )
    return rows


def _poses(evaluation: Evaluation) -> list[dict[str, Any]]:
    """Return cam_from_board of every view with its covariance."""
    state, names = evaluation.state, evaluation.observations.names
    return [
        {
            "image": name,
            "rotation": pose.rotation.tolist(),
            "translation": pose.translation.tolist(),
            "covariance": covariance.tolist(),
        }
        for name, pose, covariance in zip(names, state.cam_from_board, evaluation.pose_covariances, strict=True)
    ]


def common_corners(evaluations: Mapping[str, Evaluation]) -> NDArray[np.bool_]:
    """Return the corners (N,) in the domain of all cameras, on which they are compared."""
    return np.all([evaluation.in_domain for evaluation in evaluations.values()], axis=0)


def print_json(evaluations: Mapping[str, Evaluation]) -> None:
    """Print the evaluations as one JSON object; the first camera at top level."""
    first, *others = evaluations.items()
    common = common_corners(evaluations)
    result = {
        **_summary(*first),
        "images": image_rows(first[1]),
        "poses": _poses(first[1]),
        "notes": _notes(first[1]),
        "common_corners": int(common.sum()),
        "compared": [
            {**_summary(*item), "common": item[1].statistics(common).as_dict()} for item in (first, *others) if others
        ],
    }
    write_json(result)


def print_report(evaluations: Mapping[str, Evaluation]) -> None:
    """Print the worst images, rings of the field of view, the comparison of cameras and the result."""
    (name, evaluation), *others = evaluations.items()
    out = console()
    rows = [row for row in image_rows(evaluation) if row["corners"] or row["outside_domain"]]
    worst = sorted(rows, key=lambda row: -(row["rms"] if row["rms"] is not None else np.inf))[:MAX_IMAGES]
    title = "image" if len(worst) == len(rows) else f"worst of {len(rows)} images"
    table = _table(title, "note" if any(row["note"] for row in worst) else "")
    for row in worst:
        table.add_row(row["name"], *_cells(row), row["note"])
    out.print(table)
    out.print()
    rings = _table("off-axis angle", "")
    for ring in evaluation.rings():
        rings.add_row(_angles(ring), *_cells(ring.statistics.as_dict()), _calibrated(ring, evaluation))
    out.print(rings)
    out.print()
    if others:
        _print_comparison(out, evaluations)
    total = evaluation.statistics()
    poses = len(evaluation.observations)
    _print_row(out, "camera", f"{name} ({evaluation.camera.model.name}), unchanged; {poses} poses estimated")
    for sentence in _domain_sentences(evaluation):
        _print_row(out, "field", sentence)
    if evaluation.state.warp.any():
        across, down = evaluation.state.warp
        _print_row(out, "warp", f"{across:+.3g} (across) and {down:+.3g} (down) {evaluation.observations.unit}")
    for note in _notes(evaluation):
        _print_row(out, "note", note)
    _print_row(
        out,
        "residuals",
        f"{total.corners} corners: rms {_px(total.rms)}, mean {_px(total.mean)}, median {_px(total.median)}, wRMS"
        f" {_px(total.wrms)} (Huber threshold {evaluation.threshold:g} px, as BabelCalib)",
    )


def _summary(name: str, evaluation: Evaluation) -> dict[str, Any]:
    reach = evaluation.camera.theta_max
    return {
        "camera": name,
        "model": evaluation.camera.model.name,
        "threshold": evaluation.threshold,
        "board_warp": [float(value) for value in evaluation.state.warp],
        "all": evaluation.statistics().as_dict(),
        "outside_domain": int((~evaluation.in_domain).sum()),
        "calibrated_deg": None if reach is None else float(np.degrees(reach)),
        "calibrated": evaluation.statistics(evaluation.calibrated).as_dict(),
        "beyond": evaluation.statistics(~evaluation.calibrated).as_dict(),
        "rings": [
            {
                "from_deg": float(np.degrees(ring.start)),
                "to_deg": float(np.degrees(ring.stop)),
                **ring.statistics.as_dict(),
            }
            for ring in evaluation.rings()
        ],
    }


def _print_comparison(out: Any, evaluations: Mapping[str, Evaluation]) -> None:
    common = common_corners(evaluations)
    table = _table("camera", "model", "beyond calibrated field", "outside domain")
    for name, evaluation in evaluations.items():
        beyond = int((evaluation.in_domain & ~evaluation.calibrated).sum())
        outside = int((~evaluation.in_domain).sum())
        cells = _cells(evaluation.statistics(common).as_dict())
        table.add_row(name, *cells, evaluation.camera.model.name, str(beyond or ""), str(outside or ""))
    out.print(table)
    if not common.all():
        out.print(f"compared on {common.sum()} of {len(common)} corners, in the domain of all cameras", soft_wrap=True)
    out.print()


def _domain_sentences(evaluation: Evaluation) -> list[str]:
    """Return the errors beyond the calibrated field of view and the number of corners outside the domain."""
    sentences: list[str] = []
    camera = evaluation.camera
    beyond = evaluation.statistics(~evaluation.calibrated)
    if camera.theta_max is not None and beyond.corners:
        least = f"{np.degrees(camera.theta_min):.0f}° to " if camera.theta_min else ""
        inside = evaluation.statistics(evaluation.calibrated)
        sentences.append(
            f"beyond the calibrated field ({least}{np.degrees(camera.theta_max):.0f}°): {beyond.corners} corners, rms"
            f" {_px(beyond.rms)}; inside: rms {_px(inside.rms)}"
        )
    if outside := int((~evaluation.in_domain).sum()):
        sentences.append(
            f"{outside} corners are outside the domain of the model, which ends"
            f" {np.degrees(camera.model.theta_max):.0f}° off-axis; they are not part of the statistics"
        )
    return sentences


def _notes(evaluation: Evaluation) -> list[str]:
    detections = evaluation.observations.detections
    return [] if detections is None else [note for note in (detections.hint, *detections.notes) if note]


def _table(first: str, *last: str) -> Any:
    from rich.table import Table

    heads = [f"{name} px".replace("wrms", "wRMS").replace("worst", "max") for name in STATISTICS]
    table = Table(first, "corners", *heads, *last, box=None, pad_edge=False)
    for column in table.columns[1 : 2 + len(heads)]:
        column.justify = "right"
    return table


def _cells(statistics: Mapping[str, Any]) -> list[str]:
    values = ["" if statistics[name] is None else f"{statistics[name]:.3f}" for name in STATISTICS]
    return [str(statistics["corners"]), *values]


def _angles(ring: Ring) -> str:
    return f"{np.degrees(ring.start):.0f}° to {np.degrees(ring.stop):.0f}°"


def _calibrated(ring: Ring, evaluation: Evaluation) -> str:
    """Return whether a ring is outside the calibrated field of view, or partly."""
    least, reach = evaluation.camera.theta_min, evaluation.camera.theta_max
    if reach is None or (ring.stop <= reach and ring.start >= least):
        return ""
    return "not calibrated" if ring.start >= reach or ring.stop <= least else "partly calibrated"


def _print_row(out: Any, label: str, text: str) -> None:
    out.print(f"{label:<10}{text}", soft_wrap=True)


def _px(value: float) -> str:
    return f"{value:.3f} px"
