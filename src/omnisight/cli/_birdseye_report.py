"""Report of `omnisight birdseye`."""

import math
from typing import Any

from omnisight.cli._output import warn, write_json
from omnisight.pipeline.birdseye.birdseye import LengthErrors
from omnisight.pipeline.birdseye.birdseye_files import BirdseyeFiles

# Smallest part of the view that is printed if no camera sees it.
SHOWN_SHARE = 0.0005


def print_json(written: BirdseyeFiles) -> None:
    """Print the result as one JSON object."""
    result = written.result
    view, errors = result.renderer.view, result.length_errors()
    across = result.length_errors(across=True)
    data: dict[str, Any] = {
        "cameras": [_camera(written, k) for k in range(len(result.rig))],
        "meters_per_pixel": view.meters_per_pixel,
        "size": list(view.size),
        "unseen_share": round(float(result.renderer.unseen.mean()), 4),
        "frames": written.frames,
        "length_errors_cm": _lengths(errors) | {"across_seams": _lengths(across)} if errors.count else None,
        "seam_step": None if math.isnan(result.seam_step) else round(result.seam_step, 3),
        "warning": result.warning,
        "files": [str(path) for path in written.files],
        "seconds": round(written.seconds, 3),
    }
    write_json(data)


def print_report(written: BirdseyeFiles) -> None:
    """Print the cameras, the errors of known lengths, the view and the files written."""
    result = written.result
    view, errors = result.renderer.view, result.length_errors()
    is_calibrated = bool(result.renderer.calibration.fits)
    extra = f"{'marks':>8}{'rms px':>9}{'lengths cm, median':>21}{'max':>7}" if is_calibrated else ""
    print(f"{'camera':<14}{'ground':>8}{'height m':>19}{extra}")
    for k in range(len(result.rig)):
        data = _camera(written, k)
        sigma = f" ± {data['sigma_m']:.4f}" if data["sigma_m"] is not None else ""
        row = f"{data['name']:<14}{data['ground_share']:>8.1%}{data['height_m']:>10.3f}{sigma:<9}"
        if is_calibrated:
            own = result.length_errors(data["name"])
            row += f"{data['marks']:>8}{data['rms_px']:>9.2f}" if data["marks"] else ""
            row += f"{own.median:>21.2f}{own.maximum:>7.2f}" if own.count else ""
        print(row.rstrip())
    for label, lengths in (("lengths", errors), ("across seams", result.length_errors(across=True))):
        if lengths.count:
            print(
                f"{label:<14}{lengths.median:.2f} cm median error, {lengths.maximum:.2f} cm at most,"
                f" {lengths.count} lengths"
            )
    width, height = view.size
    unseen = result.renderer.unseen.mean()
    black = f", {unseen:.1%} of it seen by no camera and black" if unseen >= SHOWN_SHARE else ""
    print(f"view          {width}x{height} px, {100 * view.meters_per_pixel:g} cm per pixel{black}")
    if not math.isnan(result.seam_step):
        print(f"seams         {result.seam_step:.1f} gray levels between neighbouring images")
    if result.warning:
        warn(result.warning)
    frames = "" if written.frames == 1 else f" ({written.frames} frames)"
    print(f"written       {', '.join(str(path) for path in written.files)}{frames}")


def _camera(written: BirdseyeFiles, index: int) -> dict[str, Any]:
    """Return the results of one camera."""
    renderer = written.result.renderer
    rig = renderer.calibration.rig
    name = rig.names[index]
    fit = renderer.calibration.fits.get(name)
    return {
        "name": name,
        "ground_share": round(renderer.ground_share[index], 4),
        "marks": int(fit.inliers.sum()) if fit else 0,
        "outliers": int((~fit.inliers).sum()) if fit else 0,
        "rms_px": fit.rms_px if fit else None,
        "height_m": -float(rig.sensor_from_rig[index].inverse().translation[1]),
        "sigma_m": fit.sigma_height if fit else None,
    }


def _lengths(errors: LengthErrors) -> dict[str, Any]:
    if not errors.count:
        return {"median": None, "max": None, "count": 0}
    return {"median": errors.median, "max": errors.maximum, "count": errors.count}
