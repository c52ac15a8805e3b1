"""Stitching of the images of a rig to one sphere: exposure, seams, local warps, blending."""
