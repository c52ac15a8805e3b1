"""omnisight design."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from omnisight.cli._output import is_json

GROUP = "Cameras"


def design(
    what: Literal["mirror"],
    /,
    *,
    kind: str = "hyperbolic",
    hfov: float = 360.0,
    up: float = 20.0,
    down: float = 60.0,
    sensor: str = "1280x960",
    pixel: str = "3.75um",
    focal: str | None = None,
    diameter: str | None = None,
    distance: str | None = None,
    body: str = "30mm",
    working_distance: str = "1m",
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    camera: Path | None = None,
) -> None:
    """Design a camera that looks into a mirror above it and sees all around.

    Specify the field of view, the sensor, and any sizes that are fixed:

        omnisight design mirror --up 20 --down 60
        omnisight design mirror --up 10 --down 50 --sensor 1920x1080 --pixel 3um --focal 8mm --diameter 50mm
        omnisight design mirror --kind parabolic --up 15 --diameter 40mm -o mirror.svg --camera camera.json

    Two of focal length, diameter and distance determine the third. Without them, the lens sees the mirror within 40
    degrees, and the mirror is 60 mm wide.

    Parameters
    ----------
    what
        mirror.
    kind
        hyperbolic, parabolic (needs a telecentric lens), spherical or conical (both without a single viewpoint).
    hfov
        Horizontal field of view, degrees. Mirrors of revolution always show 360.
    up
        Field of view above the horizon, degrees.
    down
        Field of view below the horizon, degrees: the mirror gets a hole where it would show more. Straight down is the
        camera itself.
    sensor
        WIDTHxHEIGHT, px.
    pixel
        Pixel pitch with its unit: 3.75um.
    focal
        Focal length of the lens with its unit: 8mm.
    diameter
        Diameter of the mirror's rim: 60mm.
    distance
        From the entrance pupil of the lens to the mirror's vertex: 80mm.
    body
        Diameter of the camera body as the mirror sees it. A telecentric lens is at least as wide as its mirror.
    working_distance
        Scene distance for the parallax of a misaligned mirror.
    output
        Write a drawing: mirror.svg with dimensions, sag table, tolerances and resolution at a standard scale on A4, or
        mirror.dxf with the profile in millimetres.
    camera
        Write the camera file of the design: the unified model if it has a single viewpoint, otherwise the lens and its
        mirror.
    """
    del what
    from omnisight.cli._design_report import print_json, print_report
    from omnisight.cli._files import must_be_writable
    from omnisight.cli._text_options import parse_size
    from omnisight.pipeline.design import DesignOptions
    from omnisight.pipeline.design import design as design_camera
    from omnisight.targets.length import parse_length

    if hfov != 360:
        raise ValueError(
            f"--hfov is {hfov:g}, but a mirror of revolution shows 360 degrees: leave it out, and crop the panorama by"
            " omnisight view --to cylinder --azimuth -90:90"
        )
    for file, suffixes in ((output, (".svg", ".dxf")), (camera, (".json",))):
        if file is not None:
            must_be_writable(file)
            if file.suffix.lower() not in suffixes:
                names = " or ".join(file.stem + suffix for suffix in suffixes)
                raise ValueError(f"{file}: is written as {' or '.join(suffixes)}; name it {names}")
    options = DesignOptions(
        kind,
        up,
        down,
        parse_size(sensor, "--sensor"),
        parse_length(pixel, "--pixel"),
        focal=None if focal is None else parse_length(focal, "--focal"),
        diameter=None if diameter is None else parse_length(diameter, "--diameter"),
        distance=None if distance is None else parse_length(distance, "--distance"),
        body=parse_length(body, "--body"),
        working_distance=parse_length(working_distance, "--working-distance"),
    )
    result = design_camera(options)
    written: list[Path] = []
    if output is not None:
        from omnisight.images import write_bytes
        from omnisight.report.drawings.mirror_design import draw_design
        from omnisight.report.drawings.mirror_dxf import mirror_dxf

        draw = mirror_dxf if output.suffix.lower() == ".dxf" else draw_design
        write_bytes(output, draw(result.mirror_design, result.performance).encode())
        written.append(output)
    if camera is not None:
        from omnisight.formats import save

        save(result.camera, camera, format="native")
        written.append(camera)
    if is_json():
        print_json(result)
    else:
        print_report(result, written)
