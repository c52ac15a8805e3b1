"""The camera in every format that can hold it, inside the page."""

import base64
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnisight.camera import Camera
from omnisight.conversion import Conversion, convert_model
from omnisight.formats import Format, FormatError, format_named, format_names, save
from omnisight.report.markup import Markup, element, together
from omnisight.report.material import Figure, Material

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
    nearest = _Nearest(m.camera, {})
    held, refused = list[Markup](), list[Markup]()
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted(format_names(), key=lambda name: (name != "native", name)):
            chosen = format_named(name)
            file = Path(folder) / f"camera-{name}{chosen.SUFFIX}"
            try:
                held.append(_download(m.camera, name, chosen, file, nearest))
            except FormatError as error:
                why = str(error).removeprefix(f"{file}: {chosen.TITLE}: ")
                refused.append(element("li", element("b", chosen.TITLE), f": {why}"))
    return Figure(
        "downloads",
        "The camera as a file",
        together(
            element("ul", *held, class_="downloads"),
            element(
                "details",
                element("summary", f"{len(refused)} formats cannot hold this camera"),
                element("ul", *refused, class_="refused"),
            )
            if refused
            else None,
        ),
        (
            "Every format that holds this camera. The files are inside this page: nothing is fetched.",
            "Files of the same model are off by rounding. Where a format lacks it, another model was fitted,"
            f" {NEAR:g} px off at most within the calibrated cone; how much is said.",
            "Keep the omnisight JSON, which loses nothing: covariance, calibrated cone and figures are in it. Take the"
            " others for the programs that read them.",
        ),
        "Files",
    )


def _download(camera: Camera, name: str, chosen: Format, file: Path, nearest: _Nearest) -> Markup:
    """Give a link that holds the file, or raise `FormatError` if the format can hold nothing near enough."""
    notes, label = list[str](), None
    if camera.model.name not in chosen.MODELS:
        conversion = nearest.of(chosen.MODELS)
        if conversion is None or not conversion.max_px <= NEAR:
            raise FormatError(_too_far(chosen, conversion))
        camera = conversion.camera
        label = element("span", "fitted")
        notes.append(f"{camera.model.name}, fitted to this camera: {conversion.max_px:.2g} px off at most")
    written = save(camera, file, format=name)
    notes += [f"reads back {written.error_px:.1g} px off at most", *written.notes]
    address = "data:application/octet-stream;base64," + base64.b64encode(file.read_bytes()).decode()
    link = element("a", chosen.TITLE, href=address, download=file.name, data_format=name)
    return element("li", link, label, element("small", file.name), element("p", "; ".join(notes)))


def _too_far(chosen: Format, conversion: Conversion | None) -> str:
    has = f"has {', '.join(chosen.MODELS)}"
    if conversion is None:
        return f"{has}, which cannot be fitted to this camera"
    name = conversion.camera.model.name
    if not np.isfinite(conversion.max_px):
        return f"{has}: {name}, the nearest, does not reach as far from the axis"
    return f"{has}: {name}, the nearest, is {conversion.max_px:.2g} px off"
