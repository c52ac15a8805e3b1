"""Joint calibration of the cameras of a rig: intrinsics, extrinsics, board poses and board warps."""
