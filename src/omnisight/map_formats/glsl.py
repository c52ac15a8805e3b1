"""A lookup texture and GLSL code, for OpenGL, WebGL and game engines."""

from pathlib import Path

import numpy as np

from omnisight.map_formats._protocol import MapFiles
from omnisight.map_formats._table import RemapTable

TITLE = "GLSL"
PROGRAMS = ("opengl", "webgl")
CONVENTION = (
    "texture RG32F, rows from the top: source position in units of the image size, (0, 0) at its upper left corner;"
    " -1 if not covered"
)
OUTSIDE = -1.0
SNIPPET = """\
// Remap table {lookup}: {width} x {height} texels of two 32-bit floats (little-endian), from the upper left texel.
// Upload it as RG32F (GL_RG, GL_FLOAT) with GL_NEAREST. Upload the images, of {source_width} x {source_height} px,
// with their first row first, with GL_LINEAR and {wrap}. view_uv is (0, 0) at the upper left corner of the
// view and (1, 1) at the lower right one. Compiles as GLSL 1.30 and later, and as GLSL ES 3.00 (WebGL 2).
vec4 omnisight_view(sampler2D image, sampler2D lookup, vec2 view_uv) {{
    vec2 position = texture(lookup, view_uv).rg;
    // The level of detail follows from the view: derivatives of the position are undefined at its borders.
    return position.x < 0.0 ? vec4(0.0) : textureLod(image, position, 0.0);
}}
"""


def convert(table: RemapTable, output: Path) -> MapFiles:
    """Return the texture as raw floats, and the function that looks it up."""
    if output.suffix not in ("", ".glsl"):
        raise ValueError(f"{output}: the code is written as .glsl; change the name of the file")
    code, lookup = output.with_suffix(".glsl"), output.with_suffix(".rg32f")
    width, height = table.source.size
    positions = np.stack(
        [table.filled((table.u + 0.5) / width, OUTSIDE), table.filled((table.v + 0.5) / height, OUTSIDE)], -1
    )
    rows, columns = table.covered.shape
    wrap = "GL_REPEAT along s" if table.is_periodic else "GL_CLAMP_TO_EDGE"
    text = SNIPPET.format(
        lookup=lookup.name, width=columns, height=rows, wrap=wrap, source_width=width, source_height=height
    )
    usage = f"color = omnisight_view(image, lookup, view_uv);  // of {code.name}, with the texture {lookup.name}"
    return MapFiles(((code, text.encode()), (lookup, positions.astype("<f4").tobytes())), usage)
