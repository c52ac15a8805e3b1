"""Calibration files: each file of this folder that does not begin with an underscore reads and writes one format.

A format is found by its file. Reading goes by what a file holds, never by its name.
"""

from omnisight.formats._protocol import Format, FormatError, Written
from omnisight.formats._registry import format_named, format_names, load, load_all, load_rig, save, save_rig

__all__ = [
    "Format",
    "FormatError",
    "Written",
    "format_named",
    "format_names",
    "load",
    "load_all",
    "load_rig",
    "save",
    "save_rig",
]
