"""Report of `omnisight stitch`."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cli._output import warn, write_json
from omnisight.display import rounded
from omnisight.geometry.rotation import quaternions
from omnisight.pipeline.stitching.stitch import StitchResult
from omnisight.sfm.head_problem import ROTATION
from omnisight.sfm.head_result import HeadCalibration


def print_json(result: StitchResult) -> None:
    """Print the result as one JSON object."""
    worst = _worst(result)
    data: dict[str, Any] = {
        "size": list(result.camera.size),
        "frames": result.frames,
        "overlap_rms": _number(worst.overlap_rms),
        "seam_disparity_px": _number(worst.disparity_px),
        "seam_disparity_deg": _number(worst.disparity_deg),
        "seam_disparity_before_warp_deg": _number(worst.unwarped_deg),
        "photometric_step": _number(worst.photometric_step),
        "overlap_deg": _number(worst.overlap_deg),
        "rotation_xyzw": [quaternions(pose.rotation).tolist() for pose in result.rig.sensor_from_rig],
        "rotation_sigma_deg": None if result.head is None else _number(result.head.rotation_sigma_deg),
        "lenses": [camera.model.to_dict() for camera in result.rig.cameras],
        "lens_sigmas": [] if result.head is None else _lens_sigmas(result.head),
        "agreement": [] if result.head is None else [vars(frame) for frame in result.head.frames],
        "distance": None if math.isinf(result.distance) else result.distance,
        "vertical_tilt_deg": None if result.vertical is None else _number(result.vertical.tilt_deg),
        "vertical_sigma_deg": None if result.vertical is None else _number(result.vertical.sigma_deg),
        "covered": round(result.covered, 4),
        "seconds": round(result.seconds, 3),
        "frame_seconds": round(result.frame_seconds, 4),
        "warning": result.warning,
    }
    write_json(data)


def print_report(result: StitchResult, output: str, save_rig: Path | None) -> None:
    """Print lenses, rotation, seams and the files written."""
    head, worst = result.head, _worst(result)
    lenses = [""] * len(result.rig) if head is None else [_focal_length(head, k) for k in range(2)]
    for name, camera, focal in zip(result.rig.names, result.rig.cameras, lenses, strict=True):
        width, height = camera.size
        print(f"lens       {name}: {camera.model.name}, {width}x{height}{focal}")
    if head is not None:
        print(
            f"rotation   {_angle(head.rotation):.2f}° ± {head.rotation_sigma_deg:.2f}°"
            f" ({head.matches} matches in the overlap, {head.sigma_deg:.2f}° each)"
        )
        if head.frames:
            within = sum(frame.rotation_deg <= 2 * frame.rotation_sigma_deg for frame in head.frames)
            largest = max(frame.rotation_deg for frame in head.frames)
            print(f"frames     {within} of {len(head.frames)} agree within 2σ alone, largest difference {largest:.2f}°")
    if not math.isinf(result.distance):
        print(f"distance   {rounded(result.distance, 3)} {result.rig.unit}")
    if result.vertical is not None:
        vertical = result.vertical
        state = vertical.reason or f"{vertical.tilt_deg:.2f}° ± {vertical.sigma_deg:.2f}° from the guess"
        print(f"vertical   {'unknown: ' if vertical.reason else ''}{state}")
    print(f"overlap    {worst.overlap_deg:.1f}° wide, differences of {worst.overlap_rms:.1f} of 255 (rms)")
    print(
        f"seam       disparity {worst.disparity_px:.2f} px, {worst.disparity_deg:.3f}°"
        f" ({worst.unwarped_deg:.3f}° before the local warp), step {worst.photometric_step:.1f} of 255"
    )
    width, height = result.camera.size
    estimates = result.seconds - result.frames * result.frame_seconds
    frames = f"{result.frames} frames, {result.frame_seconds:.2f} s each after {estimates:.1f} s for the estimates"
    took = frames if result.frames > 1 else f"{result.seconds:.1f} s"
    print(f"sphere     {width}x{height}, {result.covered:.1%} covered, {took}")
    print(f"written    {', '.join(str(path) for path in (output, save_rig) if path is not None)}")
    if result.warning:
        warn(result.warning)


def _worst(result: StitchResult) -> Any:
    return max(result.seams, key=lambda seam: np.nan_to_num(seam.disparity_deg, nan=np.inf))


def _number(value: float) -> float | None:
    return round(float(value), 5) if math.isfinite(value) else None


def _angle(rotation: Any) -> float:
    return math.degrees(math.acos(max(-1.0, min(1.0, (float(np.trace(rotation)) - 1) / 2))))


def _focal_length(head: HeadCalibration, lens: int) -> str:
    """Return the estimated focal length of a lens, for the report; empty if the cameras were given."""
    sigmas = _lens_sigmas(head)
    if not sigmas:
        return ""
    return f", focal length {head.cameras[lens].model.to_dict()['fx']:.0f} ± {rounded(sigmas[lens]['fx'] or 0)} px"


def _lens_sigmas(head: HeadCalibration) -> list[dict[str, float | None]]:
    """Return the standard deviations of the focal length (px), k1 and k2 of both lenses, if they were estimated."""
    sigmas = np.sqrt(np.diagonal(head.covariance))
    if not sigmas[: ROTATION.start].any():
        return []
    found = list[dict[str, float | None]]()
    for k, camera in enumerate(head.cameras):
        focal, k1, k2 = sigmas[5 * k : 5 * k + 3]
        found.append({"fx": _number(focal * camera.model.to_dict()["fx"]), "k1": _number(k1), "k2": _number(k2)})
    return found
