"""omnisight design."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._text_options import parse_size, text_parameter
from omnisight.pipeline.calibration.design_options import DesignOptions

GROUP = "Cameras"


def _parse_length(text: str, option: str) -> float:
    """Parse a length with its unit, to metres."""
    from omnisight.targets.length import parse_length  # imports numpy

    return parse_length(text, option)


def _show_length(metres: float) -> str:
    return f"{metres * 1e3:g}mm" if metres < 1 else f"{metres:g}m"


_LENGTH = text_parameter(_parse_length, _show_length)


@dataclass(frozen=True)
class _DesignOptions(DesignOptions):
    """Options of a design.

    Attributes
    ----------
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
    """

    sensor: Annotated[tuple[int, int], text_parameter(parse_size, "{0[0]}x{0[1]}".format)] = DesignOptions.sensor
    pixel: Annotated[float, text_parameter(_parse_length, lambda metres: f"{metres * 1e6:g}um")] = DesignOptions.pixel
    focal: Annotated[float | None, _LENGTH] = None
    diameter: Annotated[float | None, _LENGTH] = None
    distance: Annotated[float | None, _LENGTH] = None
    body: Annotated[float, _LENGTH] = DesignOptions.body
    working_distance: Annotated[float, _LENGTH] = DesignOptions.working_distance


def design(
    what: Literal["mirror"],
    /,
    *,
    hfov: float = 360.0,
    options: Annotated[_DesignOptions, Parameter(name="*")] = _DesignOptions(),
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
    hfov
        Horizontal field of view, degrees. Mirrors of revolution always show 360.
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
    from omnisight.pipeline.calibration.design import design as design_camera

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
