"""The output of `omnisight design mirror`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cli._output import write_json
from omnisight.optics.design.description import (
    describe_blind_spot,
    describe_field,
    describe_lens,
    describe_shape,
    describe_tolerances,
    format_length,
    surface_equation,
)
from omnisight.optics.design.performance import Resolution
from omnisight.optics.design.shapes import KINDS
from omnisight.optics.design.tolerances import compute_tolerances
from omnisight.pipeline.calibration.design import DesignResult

# Spacing of the elevations in the resolution table.
ELEVATION_STEP_DEG = 10.0


def print_report(result: DesignResult, written: Sequence[Path]) -> None:
    """Print the resolution, the sensitivity to misalignment, the parts, and the files written."""
    from rich.table import Table

    from omnisight.cli._console import console

    out = console()
    table = Table("elevation", "radius px", "px/degree up", "px/degree around", box=None, pad_edge=False)
    at = resolution_table(result)
    for theta, radius, up, around in zip(at.theta, at.radius, np.radians(at.up), np.radians(at.around), strict=True):
        table.add_row(f"{np.degrees(theta) - 90:.0f}°", f"{radius:.1f}", f"{up:.2f}", f"{around:.2f}")
    for column in table.columns:
        column.justify = "right"
    out.print(table)
    print()
    distance = format_length(result.mirror_design.specification.working_distance)
    columns = ("mirror", "viewpoint error, rms", "max", f"parallax px at {distance}, rms", "max", "image shift px")
    table = Table(*columns, box=None, pad_edge=False)
    for row in result.performance.misalignments:
        px = (f"{v:.3f}" for v in (row.rms_px, row.worst_px))
        table.add_row(row.description, format_length(row.rms), format_length(row.worst), *px, f"{row.moved_px:.1f}")
    for column in table.columns[1:]:
        column.justify = "right"
    out.print(table)
    print("Calibration removes the image shift. The parallax is the remaining error of a central camera model.\n")
    for name, text in summary_rows(result):
        print(f"{name:<11}{text}")
    central = result.mirror_design.central
    for file in written:
        use = (
            f"omnisight view IMAGE --camera {file} --up back" if central else f"omnisight simulate room --camera {file}"
        )
        print(f"{'written':<11}{file}" + (f" (try: {use})" if file.suffix == ".json" else ""))


def summary_rows(result: DesignResult) -> list[tuple[str, str]]:
    """Return the parts and the field of view as rows of name and text."""
    design, performance = result.mirror_design, result.performance
    specification, mirror = design.specification, design.mirror
    middle, depth = (1e3 * float(mirror.sag(rho)) for rho in (mirror.rim / 2, mirror.rim))
    z = performance.viewpoint.point[2] - design.distance
    position = f"{format_length(abs(z))} {'above' if z >= 0 else 'below'} the vertex"
    error = f"rays miss it by {format_length(performance.viewpoint.rms)} rms"
    width, height = specification.size
    share = 200 * design.circle / min(specification.size)
    sensor = f"sensor {width}x{height} px of {specification.pixel * 1e6:.4g} um"
    rows = [
        ("mirror", KINDS[specification.kind].description),
        ("shape", describe_shape(design)),
        ("surface", surface_equation(design).replace("ρ", "rho") + " mm"),
        ("rim", f"diameter {format_length(2 * mirror.rim)}, sag {depth:.6g} mm, at half the radius {middle:.6g} mm"),
        ("hole", f"diameter {format_length(2 * mirror.hole)}" if mirror.hole else "none"),
        ("lens", describe_lens(design)),
        ("viewpoint", f"{position}, single" if design.central else f"none; the best point is {position}, {error}"),
        ("field", f"{describe_field(design, performance)}, 360 around"),
        ("blind spot", describe_blind_spot(design, performance)),
        ("image", f"{2 * design.circle:.0f} px across, {share:.0f} % of the shorter side; {sensor}"),
    ]
    limits = describe_tolerances(design, compute_tolerances(design, performance))
    rows.append(("tolerances", ", ".join(f"{name} {text}" for name, text in limits)))
    if design.central:
        model = design.model()
        rows.append(("model", f"unified, xi {model.xi:.6g}, gamma {model.fy:.2f} px"))
    return rows


def resolution_table(result: DesignResult) -> Resolution:
    """Return the resolution at the limits of the field of view and at round elevations between them."""
    performance = result.performance
    low = np.degrees(performance.blind.theta) - 90
    high = np.degrees(result.mirror_design.specification.up)
    first, last = np.ceil((low + 1) / ELEVATION_STEP_DEG), np.floor((high - 1) / ELEVATION_STEP_DEG)
    between = ELEVATION_STEP_DEG * np.arange(last, first - 1, -1)
    return performance.resolution.at(np.radians(np.concatenate([[high], between, [low]]) + 90))


def print_json(result: DesignResult) -> None:
    """Print the result as one JSON object; lengths in metres."""
    design, performance = result.mirror_design, result.performance
    specification, blind = design.specification, performance.blind
    at = resolution_table(result)
    figures: dict[str, Any] = {
        "kind": specification.kind,
        "mirror": design.mirror.to_dict(),
        "distance": design.distance,
        "focal": design.focal,
        "magnification": design.magnification,
        "circle_px": design.circle,
        "up_deg": float(np.degrees(specification.up)),
        "down_deg": float(90 - np.degrees(blind.theta)),
        "blind": {"theta_deg": float(np.degrees(blind.theta)), "radius_px": blind.radius},
        "viewpoint": {
            "single": design.central,
            "lens_from_viewpoint": performance.viewpoint.point.tolist(),
            "rms": performance.viewpoint.rms,
            "worst": performance.viewpoint.worst,
        },
        "model": {"name": "unified", **design.model().to_dict()} if design.central else None,
        "resolution": [
            {
                "elevation_deg": float(np.degrees(theta) - 90),
                "radius_px": float(radius),
                "px_per_degree_up": float(np.radians(up)),
                "px_per_degree_around": float(np.radians(around)),
            }
            for theta, radius, up, around in zip(at.theta, at.radius, at.up, at.around, strict=True)
        ],
        "tolerances": {
            name: value if np.isfinite(value) else None
            for name, value in vars(compute_tolerances(design, performance)).items()
        },
        "working_distance": specification.working_distance,
        "misalignments": [vars(row) for row in performance.misalignments],
    }
    write_json(figures)
