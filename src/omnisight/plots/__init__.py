"""Plots for notebooks, as figures of matplotlib (extra `plot`)."""

from omnisight.plots.calibration_plots import plot_coverage, plot_residuals
from omnisight.plots.camera_plots import plot_profile, plot_uncertainty
from omnisight.plots.comparison_plots import plot_difference
from omnisight.plots.scene_plots import plot_cameras

__all__ = ["plot_cameras", "plot_coverage", "plot_difference", "plot_profile", "plot_residuals", "plot_uncertainty"]
