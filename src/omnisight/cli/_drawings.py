"""Drawings of corners and residuals that several commands write."""

from pathlib import Path
from typing import Any

from omnisight.calibration.evaluation import Evaluation
from omnisight.pipeline.calibration import Calibration
from omnisight.targets.observations import Observations


def draw_calibration(calibration: Calibration, folder: Path, *, apply_exif: bool, quiet: bool) -> None:
    """Draw the residuals of a calibration over its images."""
    observations = calibration.observations
    residuals = calibration.state.residuals(observations)
    _draw(observations, residuals, calibration.outliers, folder, apply_exif, quiet)


def draw_evaluation(evaluation: Evaluation, folder: Path, *, apply_exif: bool, quiet: bool) -> None:
    """Draw the residuals of an evaluation over its images."""
    _draw(evaluation.observations, evaluation.residuals, evaluation.outliers, folder, apply_exif, quiet)


def _draw(
    observations: Observations, residuals: Any, outliers: Any, folder: Path, apply_exif: bool, quiet: bool
) -> None:
    from omnisight.report.drawings.residuals import draw_residuals

    blank = draw_residuals(observations, residuals, outliers, folder, apply_exif=apply_exif)
    if not quiet:
        note = f" ({blank} images on a blank background: their files are missing)" if blank else ""
        print(f"drawn     {folder}{note}")
