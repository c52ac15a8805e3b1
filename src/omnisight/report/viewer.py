"""The viewer of a reconstruction: one HTML page with points, cameras and images that needs no network."""

import json
from importlib.resources import files
from pathlib import Path

from omnisight.reconstructions import read_reconstruction
from omnisight.report.html import Markup, element, write_html
from omnisight.report.security_policy import security_policy
from omnisight.report.viewer_data import viewer_data
from omnisight.sfm.reconstruction import Reconstruction

HELP = (
    ("Drag", "rotate"),
    ("Right button or Shift and drag", "move"),
    ("Wheel", "zoom"),
    ("W A S D, Q E", "fly"),
    ("Click a camera", "look around from it"),
    ("Click a point", "list its observations"),
    ("Escape", "back"),
)


def write_viewer(
    path: str | Path, reconstruction: Reconstruction, images: str | Path | None = None, *, apply_exif: bool = False
) -> None:
    """Write a viewer of a reconstruction as one HTML file that loads nothing from the network.

    The images are embedded at reduced size, at most 16 megapixels in all and 1 megapixel each, with at most 200,000
    points and 400,000 observations, those of the points with the most observations: the file has at most about 20 MB.

    Parameters
    ----------
    path
        The file, which is written atomically. Its folder must exist.
    reconstruction
        The reconstruction.
    images
        The folder of the images, to which their names are relative. Without it the cameras are drawn without images.
    apply_exif
        Rotate images by their EXIF orientation.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = render_viewer(reconstruction, None if images is None else Path(images), apply_exif)
    write_html(path, text)


def export_viewer(model: str | Path, output: str | Path, images: Path | None, *, apply_exif: bool = False) -> Path:
    """Write viewer.html of the reconstruction of a folder to another folder, which is created, and return the file.

    Raises
    ------
    ValueError
        If the folder has no reconstruction, or there is no folder of the images.
    OSError
        If the file cannot be written.
    """
    if images is not None and not images.is_dir():
        raise ValueError(f"{images}: no such folder; specify the folder that was reconstructed with --images")
    reconstruction, path = read_reconstruction(model), Path(output) / "viewer.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_viewer(path, reconstruction, images, apply_exif=apply_exif)
    return path


def render_viewer(reconstruction: Reconstruction, images: Path | None, apply_exif: bool) -> str:
    """Return the HTML text of the viewer."""
    style, script = (
        files("omnisight.report").joinpath(name).read_text("utf-8") for name in ("viewer.css", "viewer.js")
    )
    # A "<" could end the element or start a comment.
    data = json.dumps(viewer_data(reconstruction, images, apply_exif=apply_exif), allow_nan=False).replace(
        "<", "\\u003c"
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=security_policy(style, script)),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", f"Reconstruction: {len(reconstruction)} images, {len(reconstruction.points)} points"),
        element("style", Markup(style)),
    )
    body = element(
        "body",
        element("canvas", id="scene", tabindex=0, aria_label="Points and cameras of the reconstruction"),
        _panel(reconstruction),
        element("script", Markup(data), type="application/json", id="reconstruction"),
        element("script", Markup(script)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _panel(reconstruction: Reconstruction) -> Markup:
    """Return the panel with the figures, the controls, and what was clicked."""
    figures = [f"{len(reconstruction)} images", f"{len(reconstruction.points)} points"]
    if len(reconstruction.observations):
        figures += [
            f"{len(reconstruction.observations)} observations",
            f"rms {reconstruction.rms_px:.3g} px",
            f"{reconstruction.mean_track_length:.3g} images per point",
        ]
    return element(
        "aside",
        element("h1", "Reconstruction"),
        element("p", ", ".join(figures), id="figures"),
        element("label", "Look from ", element("select", element("option", "all around", value="-1"), id="camera")),
        element("label", "Points ", element("input", type="range", id="point-size", min="0", max="8", value="2")),
        element("label", "Cameras ", element("input", type="range", id="camera-size", min="0", max="30", value="10")),
        element(
            "p",
            element("button", "Measure a distance", type="button", id="measure", aria_pressed="false"),
            element("button", "Reset view", type="button", id="reset"),
        ),
        element("div", id="details", role="status"),
        element(
            "details",
            element("summary", "Controls"),
            element("dl", *(element(tag, text) for row in HELP for tag, text in zip(("dt", "dd"), row, strict=True))),
        ),
        id="panel",
    )
