"""Stitching of the images of a rig or head."""
