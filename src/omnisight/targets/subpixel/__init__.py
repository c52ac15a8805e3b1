"""Subpixel measurement of corners and ellipses, and the local board-to-image map that places the windows."""
