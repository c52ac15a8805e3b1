"""Calibrate any camera that sees more than a pinhole can, and turn its pictures into views."""

__version__ = "0.1.0"
