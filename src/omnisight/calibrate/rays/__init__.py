"""Non-central cameras from pictures of plane boards, and whether pictures ask for one."""

from omnisight.calibrate.rays.ask import Asked, ask
from omnisight.calibrate.rays.calibration import RaysCalibration, calibrate_rays
from omnisight.calibrate.rays.far import far_camera
from omnisight.calibrate.rays.left import Left
from omnisight.calibrate.rays.travel import Travel

__all__ = ["Asked", "Left", "RaysCalibration", "Travel", "ask", "calibrate_rays", "far_camera"]
