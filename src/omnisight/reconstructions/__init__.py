"""Files of reconstructions: each file of this folder without a leading underscore writes one format.

Formats are discovered by these files.
"""

from omnisight.reconstructions._poses import marker_size, up_direction
from omnisight.reconstructions._protocol import ExportOptions, ReconstructionError, ReconstructionFormat
from omnisight.reconstructions._registry import (
    export_reconstruction,
    get_reconstruction_format,
    read_reconstruction,
    reconstruction_format_names,
    refuse_other_files,
    remove_reconstruction,
    write_reconstruction,
)

__all__ = [
    "ExportOptions",
    "ReconstructionError",
    "ReconstructionFormat",
    "export_reconstruction",
    "get_reconstruction_format",
    "marker_size",
    "read_reconstruction",
    "reconstruction_format_names",
    "refuse_other_files",
    "remove_reconstruction",
    "up_direction",
    "write_reconstruction",
]
