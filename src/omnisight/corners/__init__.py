"""Corners that something else found: each file of this folder that does not begin with an underscore reads one format.

A format is found by its file. Reading goes by what a file holds, never by its name.
"""

from omnisight.corners._protocol import CornerFormat, Corners, Seen, Told
from omnisight.corners._registry import corner_format_named, corner_format_names, read_corners

__all__ = [
    "CornerFormat",
    "Corners",
    "Seen",
    "Told",
    "corner_format_named",
    "corner_format_names",
    "read_corners",
]
