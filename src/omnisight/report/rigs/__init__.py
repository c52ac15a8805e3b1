"""The report of the calibration of a rig: one file per section."""
