"""Report of `omnisight stereo`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cli._output import warn, write_json
from omnisight.display import rounded
from omnisight.pipeline.two_views.stereo import StereoResult
from omnisight.pipeline.two_views.stereo_files import IMAGE_SUFFIXES, MAX_UINT16


def print_json(result: StereoResult, steps: float) -> None:
    """Print the result as one JSON object."""
    check, view = result.check, result.rectification.camera
    data: dict[str, Any] = {
        "unit": result.unit,
        "baseline": result.rectification.baseline,
        "rectified_size": list(view.size),
        "max_disparity": result.rectification.max_disparity,
        "min_distance": result.rectification.min_distance,
        "matches": check.matches,
        "inliers": check.inliers,
        "row_difference": {"px": check.row_px, "deg": check.row_deg} if check.inliers else None,
        "rotation_from_rig_deg": check.rotation_deg if check.inliers else None,
        "share": result.share if result else 0.0,
        "distance": None,
        "relative_sigma": None,
        "steps": steps,
        "seconds": round(result.seconds, 3),
        "warnings": list(result.warnings),
        "reason": result.reason,
    }
    if result:
        low, median, high = result.quantiles
        data["distance"] = {"low": low, "median": median, "high": high}
        data["relative_sigma"] = _relative_sigma(result)
    write_json(data)


def print_warnings(result: StereoResult, too_far: int, steps: float) -> None:
    """Print warnings to stderr."""
    for warning in result.warnings:
        warn(warning)
    if too_far:
        warn(
            f"{too_far} distances are larger than {MAX_UINT16 / steps:g} and are 0 in the 16-bit image: use fewer"
            f" --steps than {steps:g}, or -o with .npy"
        )


def print_report(result: StereoResult, written: Sequence[Path], distances: Path | None, steps: float) -> None:
    """Print the check of the rectification, the distances and the files written, among them that of distances."""
    check, rectification = result.check, result.rectification
    width, height = rectification.camera.size
    low, median, high = result.quantiles
    print(f"baseline   {rectification.baseline:.4g} {result.unit}, rectified to {width}x{height}")
    smallest = f"{rectification.min_distance:.3g} {result.unit}"
    print(f"disparity  up to {rectification.max_disparity} px, for distances from {smallest}")
    print(f"rows       {check.row_px:.2f} px, {check.row_deg:.3f}° (median difference of {check.inliers} matches)")
    sigma = "unknown" if check.rotation_sigma_deg >= 180 else f"{check.rotation_sigma_deg:.3f}°"
    print(f"rotation   {check.rotation_deg:.3f}° ± {sigma} from that of the rig")
    print(
        f"distance   {rounded(low, 3)} to {rounded(high, 3)} {result.unit}, median {rounded(median, 3)} ±"
        f" {_relative_sigma(result):.1%}"
    )
    print(f"share      {result.share:.1%} of the left image has a distance")
    print(f"written    {', '.join(str(path) for path in written) or 'nothing'}")
    if distances is not None and distances.suffix.lower() in IMAGE_SUFFIXES:
        unit = {"squares": "square"}.get(result.unit, result.unit)
        print(
            f"           {distances}: 16 bits, {steps:g} steps per {unit}, dark in viewers (--preview draws distances)"
        )


def _relative_sigma(result: StereoResult) -> float:
    """Return the median of the standard deviation relative to the distance."""
    return float(np.median(result.sigma[result.known] / result.distance[result.known]))
