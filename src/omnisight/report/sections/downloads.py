"""The camera in every format that can hold it, inside the page."""

import base64
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnisight.camera import Camera
from omnisight.conversion import Conversion, convert_model
from omnisight.formats import Format, FormatError, Written, format_named, format_names, save
from omnisight.ray_camera import RayCamera
from omnisight.report.html import Markup, element, together
from omnisight.report.report_data import Figure, Material

# A format that lacks the camera's model gets another one that was fitted to it, if it is so near, px.
NEAR = 1.0


@dataclass(frozen=True)
class _Nearest:
    """The camera in terms of other models, each fitted once."""

    camera: Camera
    fitted: dict[str, Conversion | None]

    def of(self, models: Sequence[str]) -> Conversion | None:
        """Give the nearest of some models; None if none can be fitted."""
        for model in models:
            if model not in self.fitted:
                self.fitted[model] = self._fit(model)
        found = [conversion for model in models if (conversion := self.fitted[model]) is not None]
        return min(found, key=lambda conversion: conversion.max_px, default=None)

    def _fit(self, model: str) -> Conversion | None:
        try:
            return convert_model(self.camera, model)
        except (ValueError, np.linalg.LinAlgError):
            return None


def downloads(m: Material) -> Figure:
    """Write them all."""
    held, left_out, how = _of_rays(m.camera) if isinstance(m.camera, RayCamera) else _of_central(m.camera)
    return Figure(
        "downloads",
        "The camera as a file",
        together(element("ul", *held, class_="downloads"), left_out),
        how,
        "Files",
    )


def _of_central(camera: Camera) -> tuple[list[Markup], Markup | None, tuple[str, str, str]]:
    """Give a central camera in every format that holds it or one near it, why the others do not, and how to read it."""
    nearest = _Nearest(camera, {})
    held, refused = list[Markup](), list[Markup]()
    with tempfile.TemporaryDirectory() as folder:
        for name, chosen, file in _files(Path(folder)):
            try:
                held.append(_download(camera, name, chosen, file, nearest))
            except FormatError as error:
                why = str(error).removeprefix(f"{file}: {chosen.TITLE}: ")
                refused.append(element("li", element("b", chosen.TITLE), f": {why}"))
    left_out = element(
        "details",
        element("summary", f"{len(refused)} formats cannot hold this camera"),
        element("ul", *refused, class_="refused"),
    )
    how = (
        "Every format that holds this camera. The files are inside this page: nothing is fetched.",
        "Files of the same model are off by rounding. Where a format lacks it, another model was fitted,"
        f" {NEAR:g} px off at most within the calibrated cone; how much is said.",
        "Keep the omnisight JSON, which loses nothing: covariance, calibrated cone and figures are in it. Take the"
        " others for the programs that read them.",
    )
    return held, left_out if refused else None, how


def _of_rays(camera: RayCamera) -> tuple[list[Markup], Markup | None, tuple[str, str, str]]:
    """Give a camera of rays in every format that holds rays, what to do for the others, and how to read it."""
    held, others = list[Markup](), 0
    with tempfile.TemporaryDirectory() as folder:
        for name, chosen, file in _files(Path(folder)):
            try:
                held.append(_link(save(camera, file, format=name), name, chosen))
            except FormatError:
                others += 1
    how = (
        "Every format that has a place for where a ray starts. The files are inside this page: nothing is fetched.",
        "The omnisight JSON loses nothing: covariance, calibrated cone and figures are in it.",
        "Keep it, and make the central camera for a program from it, for the distance of what that looks at. How far"
        " off such a camera is at other distances, the part on the viewpoint says.",
    )
    said = f"{others} other formats hold cameras whose rays meet in a point. They get the one that fits at a distance:"
    command = element("code", "omnisight convert camera.json --to opencv --distance 2m")
    return held, element("p", f"{said} ", command, class_="note"), how


def _files(folder: Path) -> Iterator[tuple[str, Format, Path]]:
    """Give every format, our own first, with the file to write."""
    for name in sorted(format_names(), key=lambda name: (name != "native", name)):
        chosen = format_named(name)
        yield name, chosen, folder / f"camera-{name}{chosen.SUFFIX}"


def _download(camera: Camera, name: str, chosen: Format, file: Path, nearest: _Nearest) -> Markup:
    """Give a link that holds the file, or raise `FormatError` if the format can hold nothing near enough."""
    if camera.model.name in chosen.MODELS:
        return _link(save(camera, file, format=name), name, chosen)
    conversion = nearest.of(chosen.MODELS)
    if conversion is None or not conversion.max_px <= NEAR:
        raise FormatError(_too_far(chosen, conversion))
    other = conversion.camera
    note = f"{other.model.name}, fitted to this camera: {conversion.max_px:.2g} px off at most"
    return _link(save(other, file, format=name), name, chosen, element("span", "fitted"), note)


def _link(written: Written, name: str, chosen: Format, label: Markup | None = None, *notes: str) -> Markup:
    """Give a link that holds a file that was written."""
    address = "data:application/octet-stream;base64," + base64.b64encode(written.path.read_bytes()).decode()
    link = element("a", chosen.TITLE, href=address, download=written.path.name, data_format=name)
    said = "; ".join([*notes, f"reads back {written.error_px:.1g} px off at most", *written.notes])
    return element("li", link, label, element("small", written.path.name), element("p", said))


def _too_far(chosen: Format, conversion: Conversion | None) -> str:
    has = f"has {', '.join(chosen.MODELS)}"
    if conversion is None:
        return f"{has}, which cannot be fitted to this camera"
    name = conversion.camera.model.name
    if not np.isfinite(conversion.max_px):
        return f"{has}: {name}, the nearest, does not reach as far from the axis"
    return f"{has}: {name}, the nearest, is {conversion.max_px:.2g} px off"
