"""The camera in every format that can hold it, inside the page."""

import base64
import shlex
import tempfile
from pathlib import Path

from omnisight.formats import FormatError, format_named, format_names, save
from omnisight.report.markup import Markup, element, together
from omnisight.report.material import Figure, Material


def downloads(m: Material) -> Figure:
    """Write them all."""
    held, refused = list[Markup](), list[Markup]()
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted(format_names(), key=lambda name: (name != "native", name)):
            chosen = format_named(name)
            file = Path(folder) / f"camera-{name}{chosen.SUFFIX}"
            try:
                written = save(m.camera, file, format=name)
            except FormatError as error:
                why = str(error).removeprefix(f"{file}: {chosen.TITLE}: ")
                refused.append(element("li", element("b", chosen.TITLE), f": {why}"))
                continue
            address = "data:application/octet-stream;base64," + base64.b64encode(file.read_bytes()).decode()
            notes = [f"reads back {written.error_px:.1g} px off at most", *written.notes]
            link = element("a", chosen.TITLE, href=address, download=file.name, data_format=name)
            held.append(element("li", link, element("small", file.name), element("p", "; ".join(notes))))
    convert = shlex.join(["omnisight", "convert", "camera.json", "--to", "FORMAT"])
    return Figure(
        "downloads",
        "The camera as a file",
        together(
            element("ul", *held, class_="downloads"),
            element(
                "details",
                element("summary", f"{len(refused)} formats cannot hold a {m.camera.model.name} camera"),
                element("p", "Where another model comes near enough, this writes it and says how near:"),
                element("p", element("code", convert)),
                element("ul", *refused, class_="refused"),
            )
            if refused
            else None,
        ),
        (
            "Every format that holds this camera as it is. The files are inside this page: nothing is fetched.",
            "Each file was read again after it was written, and the largest difference is given: rounding, mostly.",
            "Keep the omnisight JSON, which loses nothing: covariance, calibrated cone and figures are in it. Take the "
            "others for the programs that read them.",
        ),
        "Files",
    )
