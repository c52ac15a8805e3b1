"""Maps of FFmpeg's filter `remap`, which takes whole source pixels."""

import shlex
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images.write import encode_image
from omnisight.map_formats._protocol import MapFiles
from omnisight.map_formats._table import RemapTable

TITLE = "FFmpeg's remap filter"
PROGRAMS = ()
CONVENTION = "two 16-bit PGM files with the source column and row of each pixel, from 0; 65535 if not covered"
OUTSIDE = 65535
# The filter does not interpolate. The source is enlarged by swscale, whose interpolation then applies, and the map has
# the resolution of 1/4 px.
ENLARGEMENT = 4
SCALER = {"bilinear": "bilinear", "bicubic": "bicubic", "lanczos": "lanczos"}


def convert(table: RemapTable, output: Path) -> MapFiles:
    """Return the maps of columns and rows, and the command that applies them to an image or a clip."""
    if output.suffix:
        raise ValueError(f"{output}: two files are written, such as {output.stem}_x.pgm: leave out {output.suffix}")
    factor = 1 if table.interpolation == "nearest" else ENLARGEMENT
    if factor * max(table.source.size) >= OUTSIDE:
        factor = 1
    width, height = table.source.size
    columns, rows = _whole(table, table.u, factor, width), _whole(table, table.v, factor, height)
    files = [output.with_name(f"{output.name}_{axis}.pgm") for axis in "xy"]
    scaler = SCALER.get(table.interpolation)
    enlarge = f"[0:v]scale={factor * width}:{factor * height}:flags={scaler}[image];" if factor > 1 else ""
    chain = f"{enlarge}[{'image' if enlarge else '0:v'}][1:v][2:v]remap=fill=black[view]"
    # The filter outputs 4:4:4, and many players cannot decode it in H.264. FFmpeg ignores the option where the encoder
    # lacks the format, such as for PNG. The encoder refuses 4:2:0 for odd sizes.
    pixels = "" if any(side % 2 for side in table.u.shape) else " -pix_fmt yuv420p"
    inputs = f"-i INPUT -i {shlex.quote(str(files[0]))} -i {shlex.quote(str(files[1]))}"
    usage = f"ffmpeg {inputs} -filter_complex '{chain}' -map '[view]' -map '0:a?'{pixels} OUTPUT"
    data = tuple((file, encode_image(values, file.name)) for file, values in zip(files, (columns, rows), strict=True))
    return MapFiles(data, usage)


def _whole(table: RemapTable, values: NDArray[np.float32], factor: int, count: int) -> NDArray[np.uint16]:
    """Return the nearest column or row (H, W) of an enlarged source of `count` columns or rows."""
    with np.errstate(invalid="ignore"):
        nearest = np.rint((values.astype(float) + 0.5) * factor - 0.5)
    inside = np.clip(np.where(table.covered, nearest, 0), 0, factor * count - 1)
    return np.where(table.covered, inside, OUTSIDE).astype(np.uint16)
