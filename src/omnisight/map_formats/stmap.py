"""STMaps of compositing programs: Nuke's STMap, Fusion's Texture, Blender's Map UV."""

from pathlib import Path

import numpy as np

from omnisight.map_formats._exr import encode_exr
from omnisight.map_formats._protocol import MapFiles
from omnisight.map_formats._table import RemapTable, with_suffix

TITLE = "STMap"
PROGRAMS = ("blender", "fusion", "nuke")
CONVENTION = (
    "32-bit float EXR: R = (u + 1/2) / width, G = 1 - (v + 1/2) / height, so the origin is the lower left corner of the"
    " image; B and A are 1 where it is covered, else R and G are -1"
)
OUTSIDE = -1.0


def convert(table: RemapTable, output: Path) -> MapFiles:
    """Return an EXR image of the source position of each pixel, in units of the image size."""
    file = with_suffix(output, (".exr",))
    width, height = table.source.size
    covered = table.covered.astype(np.float32)
    channels = {
        "R": table.filled((table.u + 0.5) / width, OUTSIDE),
        "G": table.filled(1 - (table.v + 0.5) / height, OUTSIDE),
        "B": covered,
        "A": covered,
    }
    usage = (
        f"Nuke: Read {file.name} with raw data, then STMap with uv = rgb; Fusion: Texture node; Blender: Map UV node, "
        "Non-Color"
    )
    return MapFiles(((file, encode_exr(channels)),), usage)
