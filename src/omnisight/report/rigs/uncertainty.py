"""Uncertainty of the pose of each camera of a rig."""

import numpy as np

from omnisight.report.html import Markup, element, join, table
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section


def uncertainty(data: RigReportData) -> Section:
    """List the standard deviations of the poses by axis."""
    _, unit = data.display_unit
    columns = (
        "camera",
        *(f"rotation about {axis}" for axis in "xyz"),
        *(f"position {axis}, {unit}" for axis in "xyz"),
        f"ellipsoid axes, {unit}",
        "longest axis along",
    )
    rows = [_row(data, name) for name in data.rig.names]
    return Section(
        "pose-uncertainty",
        "Uncertainty of the poses",
        join(table(columns, rows, class_="numbers"), _motion(data)),
        Guide(
            "Standard deviations (1σ): of the rotation about the x, y and z axis of each camera, and of its position"
            f" along the x, y and z axis of the rig frame, relative to {data.reference}. The ellipsoid of the position"
            " has the three semi-axes given; about 20 % of the true positions are inside (1σ in three dimensions).",
            "Positions certain to about a hundredth of the baseline for stereo, rotations to a pixel or less. The"
            " figures contain corner noise, the scatter between images, the choice of the camera models, and the motion"
            " of the board if it was estimated.",
            "Lower them with more images with the board where two cameras see it: near for the position, on all sides"
            " of the common field of view and tilted for the rotation.",
        ),
        wide=True,
    )


def _row(data: RigReportData, name: str) -> Markup:
    if name == data.reference:
        text = "defines the rig frame" if data.rig.reference else "reference"
        return element("tr", element("th", name, scope="row"), element("td", text, colspan=8))
    scale, _ = data.display_unit
    covariance = scale**2 * data.centre_covariance(name)
    variances, vectors = np.linalg.eigh(covariance)
    lengths = np.sqrt(np.clip(variances[::-1], 0.0, None))
    longest = vectors[:, -1] * np.sign(vectors[np.argmax(np.abs(vectors[:, -1])), -1])
    cells = (
        *(f"{np.degrees(sigma):.2g}°" for sigma in data.rotation_sigmas(name)),
        *(f"{sigma:.2g}" for sigma in np.sqrt(np.diagonal(covariance))),
        " × ".join(f"{length:.2g}" for length in lengths),
        "(" + ", ".join(f"{value:.2f}" for value in longest + 0.0).replace("-", "−") + ")",
    )
    return element("tr", element("th", name, scope="row"), *(element("td", cell, class_="number") for cell in cells))


def _motion(data: RigReportData) -> Markup:
    """Return what was estimated of the motion of the board and of the time offsets."""
    estimate, rig = data.calibration.estimate, data.rig
    motion, (scale, unit) = estimate.problem.motion, data.display_unit
    if motion is None:
        text = "The board was at rest: the residuals do not exceed corner noise."
    elif data.calibration.model_error is not None:
        text = (
            "The poses of the board differ between the cameras, but not with spline cameras: the camera models are not"
            " exact. The standard deviations above include the change of the poses."
        )
    else:
        text = (
            f"The board moved between the exposures by about {scale * motion.translation:.2g} {unit} and"
            f" {np.degrees(motion.rotation):.2g}° (1σ of each component). The calibration has a motion of the board in"
            " each image, and the standard deviations above include it."
        )
    parts = [element("p", element("b", "Board motion. "), text)]
    if estimate.problem.free_parameters.time_offsets:
        sigmas = dict(zip(estimate.observations.names, estimate.time_offset_sigmas, strict=True))
        values = dict(zip(estimate.observations.names, estimate.state.time_offsets, strict=True))
        listed = ", ".join(
            f"{name} {1e3 * values[name]:+.1f} ± {1e3 * sigmas[name]:.1f} ms".replace("-", "−")
            for name in rig.names
            if name != data.reference
        )
        used = "" if rig.time_offsets else " They are not significant (3σ), and the rig file has none."
        parts.append(
            element(
                "p", element("b", "Time offsets "), f"of the images after those of {data.reference}: {listed}.{used}"
            )
        )
    return join(*parts)
