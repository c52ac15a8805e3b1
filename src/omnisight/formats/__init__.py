"""Calibration files: each file of this folder without a leading underscore reads and writes one format.

Formats are discovered by these files. The content of a file determines its format, never the name.
"""

from omnisight.formats._joined_rig import load_joined_rig
from omnisight.formats._protocol import Format, FormatError, SaveResult
from omnisight.formats._registry import (
    format_names,
    format_of_suffix,
    get_format,
    is_rig_file,
    load,
    load_all,
    load_rig,
    rig_format_names,
    save,
)
from omnisight.formats._rigs import time_offset_notes

__all__ = [
    "Format",
    "FormatError",
    "SaveResult",
    "format_names",
    "format_of_suffix",
    "get_format",
    "is_rig_file",
    "load",
    "load_all",
    "load_joined_rig",
    "load_rig",
    "rig_format_names",
    "save",
    "time_offset_notes",
]
