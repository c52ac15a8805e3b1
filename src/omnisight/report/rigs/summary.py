"""The head of the report of a rig: title and key figures."""

import numpy as np

from omnisight.pipeline.rig_calibration.rig_calibration import root_mean_square
from omnisight.report.html import Markup, element, join
from omnisight.report.rigs.direction_map import share_of_sphere
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.sections.verdict import tiles


def title(data: RigReportData) -> Markup:
    """Return the heading with the cameras, software and date."""
    rig = data.rig
    created = ", ".join(str(rig.provenance[key]) for key in ("tool", "date") if rig.provenance.get(key))
    return join(
        element("h1", f"Calibration of a rig of {len(rig)} cameras"),
        element("p", ", ".join(rig.names), f" · {created}" if created else None, class_="about"),
    )


def key_figures(data: RigReportData) -> Markup:
    """Return the key figures as tiles."""
    calibration, (scale, unit) = data.calibration, data.display_unit
    others = [name for name in data.rig.names if name != data.reference]
    sigmas = {name: calibration.sigmas(name) for name in others}
    least_certain = max(others, key=lambda name: sigmas[name][0])
    farthest = max(others, key=lambda name: sigmas[name][1])
    held_out = np.concatenate([lengths[np.isfinite(lengths)] for lengths in calibration.held_out])
    inliers = [np.linalg.norm(data.inliers_of(name)[1], axis=1) for name in data.rig.names]
    common, agreeing = data.common_frames
    return tiles(
        [
            (
                "Held-out error",
                f"{root_mean_square(held_out):.2g} px" if len(held_out) else "unknown",
                "rms over simultaneous images left out of the calibration",
            ),
            (
                "Reprojection error",
                f"{root_mean_square(np.concatenate(inliers)):.2g} px",
                f"rms; {calibration.rms:.2g} px with the outliers",
            ),
            ("Rotation", f"± {np.degrees(sigmas[least_certain][0]):.2g}°", f"1σ of {least_certain}, the largest"),
            ("Translation", f"± {scale * sigmas[farthest][1]:.2g} {unit}", f"1σ of {farthest}, the largest"),
            (
                "Common images",
                f"{agreeing} of {common}",
                "in which several cameras see a board, agree with the extrinsics",
            ),
            (
                "Sphere",
                f"{share_of_sphere(data.visible_directions.any(0)):.0%}",
                "of all directions are in the calibrated field of view of a camera",
            ),
        ]
    )
