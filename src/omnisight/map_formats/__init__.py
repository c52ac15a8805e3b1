"""Remap tables of views for other programs: each file of this folder without a leading underscore is one format.

Formats are discovered by these files.
"""

from omnisight.map_formats._protocol import MapFiles, MapFormat
from omnisight.map_formats._registry import format_of_program, get_map_format, map_format_names
from omnisight.map_formats._table import RemapTable

__all__ = ["MapFiles", "MapFormat", "RemapTable", "format_of_program", "get_map_format", "map_format_names"]
