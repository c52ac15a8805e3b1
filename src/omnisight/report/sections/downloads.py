"""The camera file in every supported format, embedded in the page."""

import base64
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from omnisight.camera import Camera
from omnisight.conversion import Conversion, convert_model
from omnisight.display import rounded
from omnisight.formats import Format, FormatError, SaveResult, format_names, get_format, save
from omnisight.ray_camera import RayCamera
from omnisight.report.html import Markup, element, join
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section

# A format without the camera's model gets another model that was fitted to it, up to this error.
MAX_CONVERSION_ERROR_PX = 1.0
CONTENT = "The camera in every format that {}. The files are embedded in this page; nothing is downloaded."


def downloads(data: ReportData) -> Section:
    """Return links to the camera in every format."""
    camera = data.camera
    body, guide = _ray_files(camera) if isinstance(camera, RayCamera) else _central_files(camera)
    return Section("downloads", "Downloads", body, guide)


@dataclass(frozen=True)
class ModelConversions:
    """Conversions of a camera to other models, each fitted once."""

    camera: Camera
    by_model: dict[str, Conversion | None] = field(default_factory=dict[str, Conversion | None])

    def best_of(self, models: Sequence[str]) -> Conversion | None:
        """Return the conversion with the smallest error; None if none of the models can be fitted."""
        for model in models:
            if model not in self.by_model:
                self.by_model[model] = self._fit(model)
        conversions = [conversion for model in models if (conversion := self.by_model[model]) is not None]
        return min(conversions, key=lambda conversion: conversion.max_px, default=None)

    def _fit(self, model: str) -> Conversion | None:
        try:
            return convert_model(self.camera, model)
        except (ValueError, np.linalg.LinAlgError):
            return None


def _central_files(camera: Camera) -> tuple[Markup, Guide]:
    """Return a central camera in every format, with the reason for each format that cannot represent it."""
    conversions = ModelConversions(camera)
    links, refused = list[Markup](), list[Markup]()
    with tempfile.TemporaryDirectory() as folder:
        for name, file_format, file in _files(Path(folder)):
            try:
                links.append(_download(camera, name, file_format, file, conversions))
            except FormatError as error:
                reason = str(error).removeprefix(f"{file}: {file_format.TITLE}: ")
                refused.append(element("li", element("b", file_format.TITLE), f": {reason}"))
    details = element(
        "details",
        element("summary", f"Formats that cannot represent this camera: {len(refused)}"),
        element("ul", *refused, class_="refused"),
    )
    guide = Guide(
        CONTENT.format("supports it"),
        "Files with the same model differ by rounding only. For formats without the model, another model was fitted,"
        f" with an error of at most {MAX_CONVERSION_ERROR_PX:g} px within the calibrated field of view.",
        "Keep the omnisight JSON file: only it has the covariance, the calibrated field of view and the quality"
        " figures. Use the others for the programs that read them.",
    )
    return join(element("ul", *links, class_="downloads"), details if refused else None), guide


def _ray_files(camera: RayCamera) -> tuple[Markup, Guide]:
    """Return a non-central camera in every format that supports rays, and the command for the others."""
    links, others = list[Markup](), 0
    with tempfile.TemporaryDirectory() as folder:
        for name, file_format, file in _files(Path(folder)):
            try:
                links.append(link(save(camera, file, format=name), name, file_format))
            except FormatError:
                others += 1
    note = f"{others} other formats support central cameras only. Export the camera that fits best at a distance:"
    command = element("code", "omnisight convert camera.json --to opencv --distance 2m")
    guide = Guide(
        CONTENT.format("supports rays with different origins"),
        "The omnisight JSON file is complete: it has the covariance, the calibrated field of view and the quality"
        " figures.",
        "Keep it, and export a central camera for the working distance of each program. See Non-central test for its"
        " error at other distances.",
    )
    return join(element("ul", *links, class_="downloads"), element("p", f"{note} ", command, class_="note")), guide


def _files(folder: Path) -> Iterator[tuple[str, Format, Path]]:
    """Yield name, format and file to write of every format, the native one first."""
    for name in sorted(format_names(), key=lambda name: (name != "native", name)):
        file_format = get_format(name)
        yield name, file_format, folder / f"camera-{name}{file_format.SUFFIX}"


def _download(camera: Camera, name: str, file_format: Format, file: Path, conversions: ModelConversions) -> Markup:
    """Return a link to the camera in one format; raise `FormatError` if no model of the format is accurate enough."""
    if camera.model.name in file_format.MODELS:
        return link(save(camera, file, format=name), name, file_format)
    conversion = conversions.best_of(file_format.MODELS)
    if conversion is None or not conversion.max_px <= MAX_CONVERSION_ERROR_PX:
        raise FormatError(refusal(file_format, conversion))
    converted = conversion.camera
    note = f"{converted.model.name} fitted to this camera, max error {rounded(conversion.max_px)} px"
    return link(save(converted, file, format=name), name, file_format, element("span", "fitted"), note)


def link(written: SaveResult, name: str, file_format: Format, badge: Markup | None = None, *notes: str) -> Markup:
    """Return a link with the content of a written file."""
    address = "data:application/octet-stream;base64," + base64.b64encode(written.path.read_bytes()).decode()
    link = element("a", file_format.TITLE, href=address, download=written.path.name, data_format=name)
    text = "; ".join([*notes, f"round-trip error at most {written.error_px:.1g} px", *written.notes])
    return element("li", link, badge, element("small", written.path.name), element("p", text))


def refusal(file_format: Format, conversion: Conversion | None) -> str:
    """Return why a format cannot hold a camera, given the best fit of one of its models."""
    supported = f"supports {', '.join(file_format.MODELS)}"
    if conversion is None:
        return f"{supported}; none of them can be fitted to this camera"
    name = conversion.camera.model.name
    if not np.isfinite(conversion.max_px):
        return f"{supported}; the best fit, {name}, does not cover the field of view"
    return f"{supported}; the best fit, {name}, has an error of {rounded(conversion.max_px)} px"
