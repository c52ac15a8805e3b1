"""Capture of images, calibration and evaluation of one camera, and the design of cameras."""
