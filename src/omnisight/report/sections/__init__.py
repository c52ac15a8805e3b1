"""The sections of the calibration report, one file each."""
