"""Plots of a calibration: residuals and coverage."""

from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.plots._figure import new_axes, new_figure
from omnisight.plots._sources import central_camera

# Residuals are drawn so that a typical arrow has this length relative to the image width.
ARROW_FRACTION = 0.03


def plot_residuals(calibration: Calibration) -> Any:
    """Plot the residuals as arrows over the image, and their components against each other; outliers are red.

    Parameters
    ----------
    calibration
        The calibration.

    Returns
    -------
    A figure of matplotlib.
    """
    pixels = calibration.observations.pixels
    residuals, outliers = calibration.state.residuals(calibration.observations), calibration.outliers
    figure = new_figure(width=10.0)
    image, plane = figure.subplots(1, 2, width_ratios=(1.5, 1))
    factor = ARROW_FRACTION * calibration.camera.width / max(calibration.rms, 1e-9)
    for use, color in ((~outliers, "C0"), (outliers, "C3")):
        shift = factor * residuals[use]
        image.quiver(*pixels[use].T, *shift.T, angles="xy", scale_units="xy", scale=1, width=0.002, color=color)
        plane.plot(*residuals[use].T, ".", markersize=2, color=color)
    _image_axes(image, calibration.camera.size)
    image.set_title(f"residuals, enlarged {factor:.0f} times")
    limit = 5 * calibration.rms
    plane.set(xlim=(-limit, limit), ylim=(limit, -limit), aspect="equal", xlabel="u, px", ylabel="v, px")
    plane.set_title(f"rms {calibration.rms:.3f} px, {int(outliers.sum())} outliers")
    plane.grid(alpha=0.3)
    return figure


def plot_coverage(calibration: Calibration) -> Any:
    """Plot the corners of all images over the image, in one colour per image, with circles of equal off-axis angle.

    Parameters
    ----------
    calibration
        The calibration.

    Returns
    -------
    A figure of matplotlib.
    """
    observations, camera = calibration.observations, calibration.camera
    figure, axes = new_axes()
    for rows in observations.groups:
        axes.plot(*observations.pixels[rows].T, ".", markersize=3)
    _angle_circles(axes, central_camera(camera))
    _image_axes(axes, camera.size)
    covered = calibration.quality.coverage.share
    axes.set_title(f"{len(observations.pixels)} corners of {len(observations)} images cover {covered:.0%}")
    return figure


def _angle_circles(axes: Any, camera: Camera) -> None:
    """Draw the pixels at multiples of 30 degrees from the axis."""
    phi = np.linspace(0, 2 * np.pi, 181)
    for degrees in range(30, 180, 30):
        s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
        pixels, valid = camera.project(np.stack([s * np.cos(phi), s * np.sin(phi), np.full_like(phi, c)], -1))
        inside = valid & camera.in_image(pixels)
        if inside.any():
            axes.plot(*np.where(inside[:, None], pixels, np.nan).T, color="0.6", linewidth=0.8)
            axes.annotate(f"{degrees}°", pixels[inside][0], color="0.4", fontsize=8)


def _image_axes(axes: Any, size: tuple[int, int]) -> None:
    """Set the limits to those of the image, with rows downwards."""
    axes.set(xlim=(-0.5, size[0] - 0.5), ylim=(size[1] - 0.5, -0.5), aspect="equal", xlabel="u, px", ylabel="v, px")
