"""Non-central cameras from pictures of plane boards, and whether pictures ask for one."""

from omnisight.calibrate.rays.ask import Asked, ask
from omnisight.calibrate.rays.calibration import RaysCalibration, calibrate_rays
from omnisight.calibrate.rays.left import Left

__all__ = ["Asked", "Left", "RaysCalibration", "ask", "calibrate_rays"]
