"""Drawings of corners and residuals that several commands write."""

from pathlib import Path
from typing import Any

from omnisight.calibration.evaluation import Evaluation
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration
from omnisight.targets.observations import Observations


def draw_calibration(calibration: Calibration, folder: Path, *, apply_exif: bool) -> None:
    """Draw the residuals of a calibration over its images."""
    observations = calibration.observations
    residuals = calibration.state.residuals(observations)
    _draw(observations, residuals, calibration.outliers, folder, apply_exif)


def draw_evaluation(evaluation: Evaluation, folder: Path, *, apply_exif: bool) -> None:
    """Draw the residuals of an evaluation over its images."""
    _draw(evaluation.observations, evaluation.residuals, evaluation.outliers, folder, apply_exif)


def draw_rig_calibration(calibration: RigCalibration, folder: Path, *, apply_exif: bool) -> None:
    """Draw the residuals of the cameras of a rig over their images, in a folder for each camera."""
    from omnisight.report.rigs.rig_report_data import RigReportData

    data = RigReportData(calibration)
    for name in calibration.rig.names:
        for k in calibration.parts_of(name):
            part = data.parts[k]
            observations = calibration.estimate.observations.parts[k].observations
            _draw(observations, part.residuals, part.outliers, folder / name, apply_exif)


def _draw(observations: Observations, residuals: Any, outliers: Any, folder: Path, apply_exif: bool) -> None:
    from omnisight.report.drawings.residuals import draw_residuals

    blank = draw_residuals(observations, residuals, outliers, folder, apply_exif=apply_exif)
    note = f" ({blank} images on a blank background: their files are missing)" if blank else ""
    print(f"drawn     {folder}{note}")
