"""Corner files of other programs: each file of this folder without a leading underscore reads one format.

Formats are discovered by these files. The content of a file determines its format, never the name.
"""

from omnisight.corners._protocol import CornerFile, CornerFormat, ImageCorners, ReadOptions
from omnisight.corners._registry import corner_format_names, get_corner_format, read_corners

__all__ = [
    "CornerFile",
    "CornerFormat",
    "ImageCorners",
    "ReadOptions",
    "corner_format_names",
    "get_corner_format",
    "read_corners",
]
