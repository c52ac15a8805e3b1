"""Output of `omnisight compare`."""

from pathlib import Path
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.cli._output import write_json
from omnisight.display import rounded
from omnisight.geometry import rotation as so3
from omnisight.quality.camera_comparison import CameraComparison, DifferenceMap


def print_report(comparison: CameraComparison, output: Path | None) -> None:
    """Print both cameras, their difference and the verdict."""
    c = comparison
    for k, (camera, name) in enumerate(zip((c.a, c.b), c.names, strict=True)):
        sigma = _uncertainty_rms(c, k)
        known = (
            "no uncertainty in the file" if sigma is None else f"projection uncertainty {rounded(sigma)} px rms (1σ)"
        )
        print(f"camera      {name}: {camera.model.name}, {_field(camera)}, {known}")
    print(
        f"common      {c.common.mean():.0%} of the image, to {np.degrees(c.common_theta_max):.0f}° off-axis, at"
        f" {c.a.width}x{c.a.height}"
    )
    if c.is_mirrored:
        print("mirrored    compared after left and right are exchanged: one of the cameras looks into a mirror")
    angle = float(np.degrees(np.linalg.norm(so3.log(c.rotation))))
    print(f"rotation    {rounded(angle, 3)}° between the camera frames")
    print(f"difference  {_difference_text(c, c.aligned)}, after the rotation")
    print(f"            {_difference_text(c, c.fixed)}, without")
    print(f"worst       {c.worst_place}")
    print(f"verdict     {c.sentence}")
    if output is not None:
        print(f"written     {output}")


def print_json(comparison: CameraComparison, output: Path | None) -> None:
    """Print the comparison as one JSON object."""
    c = comparison
    row, column = c.worst
    data: dict[str, Any] = {
        "verdict": c.verdict,
        "sentence": c.sentence,
        "p_value": _number(c.test.p_value),
        "expected_rms_px": _number(c.test.expected_rms),
        "mirrored": c.is_mirrored,
        "difference": _figures(c, c.aligned),
        "difference_without_rotation": _figures(c, c.fixed),
        "worst": {
            "pixel": [float(c.u[column]), float(c.v[row])],
            "off_axis_deg": float(np.degrees(c.a.angle_of(np.array([c.u[column], c.v[row]])))),
            "place": c.worst_place,
        },
        "rotation_deg": np.degrees(so3.log(c.rotation)).tolist(),
        "size": list(c.a.size),
        "common": {"fraction": float(c.common.mean()), "off_axis_deg": float(np.degrees(c.common_theta_max))},
        "cameras": [
            {"name": name, "model": camera.model.name, "uncertainty_rms_px": _uncertainty_rms(c, k)}
            for k, (camera, name) in enumerate(zip((c.a, c.b), c.names, strict=True))
        ],
        "written": None if output is None else str(output),
    }
    write_json(data)


def _field(camera: Camera) -> str:
    if camera.theta_max is None:
        return "calibrated field of view unknown"
    return f"calibrated to {np.degrees(camera.theta_max):.0f}° off-axis"


def _difference_text(comparison: CameraComparison, difference: DifferenceMap) -> str:
    figures = _figures(comparison, difference)
    return (
        f"{rounded(figures['rms_px'])} px rms, at most {rounded(figures['max_px'])} px;"
        f" {rounded(figures['rms_deg'])}° rms, at most {rounded(figures['max_deg'])}°"
    )


def _figures(comparison: CameraComparison, difference: DifferenceMap) -> dict[str, float]:
    px, angles = (values[comparison.common] for values in (difference.pixels, np.degrees(difference.angles)))
    return {
        "rms_px": float(np.sqrt(np.nanmean(px**2))),
        "max_px": float(np.nanmax(px)),
        "rms_deg": float(np.sqrt(np.nanmean(angles**2))),
        "max_deg": float(np.nanmax(angles)),
    }


def _uncertainty_rms(comparison: CameraComparison, camera: int) -> float | None:
    sigma = comparison.uncertainties[camera]
    return None if sigma is None else float(np.sqrt(np.nanmean(sigma[comparison.common] ** 2)))


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
