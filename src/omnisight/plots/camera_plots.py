"""Plots of one camera: its radial profile and its projection uncertainty."""

from typing import Any

import numpy as np

from omnisight.pipeline.conversion.inspect import model_title, radial_profile
from omnisight.plots._figure import new_axes, new_figure
from omnisight.plots._sources import CameraSource, central_camera
from omnisight.quality.uncertainty import UncertaintyMap


def plot_profile(camera: CameraSource) -> Any:
    """Plot the distance from the principal point (px) over the angle from the axis (degrees).

    The part outside the calibrated field of view is dashed. The equidistant lens of the same focal length is gray.

    Parameters
    ----------
    camera
        The camera, or its calibration file. A non-central camera is plotted for a distant scene.

    Returns
    -------
    A figure of matplotlib.
    """
    central = central_camera(camera)
    profile = radial_profile(central)
    figure, axes = new_axes()
    known = profile.calibrated_deg is not None
    calibrated = profile.is_calibrated(profile.theta_deg)
    axes.plot(profile.theta_deg, profile.focal * np.radians(profile.theta_deg), color="0.6", label="equidistant")
    if known:
        axes.plot(profile.theta_deg, profile.radius, "--", color="C0", label="extrapolated")
    label = "calibrated" if known else "camera"
    axes.plot(profile.theta_deg[calibrated], profile.radius[calibrated], color="C0", label=label)
    axes.set(xlabel="angle off-axis, degrees", ylabel="radius, px", title=model_title(central))
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def plot_uncertainty(camera: CameraSource) -> Any:
    """Plot the projection uncertainty (1 sigma) over the field of view, in px and in degrees.

    The radius is the angle from the axis in degrees, and the azimuth that of the image. The dashed circle is the end of
    the calibrated field of view.

    Parameters
    ----------
    camera
        A camera with a covariance, or its calibration file. A non-central camera is plotted for a distant scene.

    Returns
    -------
    A figure of matplotlib.

    Raises
    ------
    ValueError
        If the camera has no covariance or no image size.
    """
    central = central_camera(camera)
    if not all(central.size):
        raise ValueError(
            "the camera has no image size, and its uncertainty is plotted over the image: add the size to the file, or"
            " use dataclasses.replace(camera, size=(width, height))"
        )
    result = UncertaintyMap.of(central)
    figure = new_figure(width=9.0)
    phi = np.append(result.phi, 2 * np.pi)
    inside = result.visible & np.isfinite(result.pixels)
    for k, (values, unit) in enumerate(((result.pixels, "px"), (np.degrees(result.angles), "degrees"))):
        axes = figure.add_subplot(1, 2, k + 1, projection="polar")
        axes.set_theta_direction(-1)  # the azimuth increases downwards, like rows
        shown = np.where(inside, values, np.nan)
        limit = np.nanmax(np.where(result.calibrated[:, None], shown, np.nan))
        closed = np.column_stack([shown, shown[:, :1]])
        mesh = axes.pcolormesh(phi, np.degrees(result.theta), closed, shading="gouraud", vmin=0, vmax=limit)
        if central.theta_max is not None:
            axes.plot(np.linspace(0, 2 * np.pi, 100), np.full(100, np.degrees(central.theta_max)), "w--", linewidth=1)
        axes.set_title(f"projection uncertainty, {unit} (1σ)")
        axes.set_xticks(np.radians([0, 90, 180, 270]), ["right", "bottom", "left", "top"])
        figure.colorbar(mesh, ax=axes, shrink=0.8, extend="max")
    return figure
