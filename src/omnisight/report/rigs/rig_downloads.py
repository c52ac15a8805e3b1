"""The rig file in every format that holds rigs, embedded in the page."""

import tempfile
from dataclasses import replace
from pathlib import Path

from omnisight.camera import Camera
from omnisight.formats import Format, FormatError, get_format, rig_format_names, save
from omnisight.models.ocam import Ocam
from omnisight.pipeline.conversion.ocam_roll import with_upright_ocam
from omnisight.report.html import Markup, element, join
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section
from omnisight.report.sections.downloads import MAX_CONVERSION_ERROR_PX, ModelConversions, link, refusal
from omnisight.rig import Rig, Sensor


def rig_downloads(data: RigReportData) -> Section:
    """Return links to the rig in every format, with the reason for each format that cannot hold it."""
    links, refused = list[Markup](), list[Markup]()
    exporter = RigExporter(data.rig)
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted(rig_format_names(), key=lambda name: (name != "native", name)):
            chosen = get_format(name)
            file = Path(folder) / f"rig-{name}{chosen.SUFFIX}"
            try:
                rig, notes = exporter.in_models_of(chosen)
                badge = element("span", "fitted") if notes else None
                links.append(link(save(rig, file, format=name), name, chosen, badge, *notes))
            except FormatError as error:
                reason = str(error).removeprefix(f"{file}: ").removeprefix(f"{chosen.TITLE} of a rig: ")
                refused.append(element("li", element("b", chosen.TITLE), f": {reason}"))
    details = element(
        "details",
        element("summary", f"Formats that cannot represent this rig: {len(refused)}"),
        element("ul", *refused, class_="refused"),
    )
    return Section(
        "downloads",
        "Downloads",
        join(element("ul", *links, class_="downloads"), details if refused else None),
        Guide(
            "The rig in every format that supports it. The files are embedded in this page; nothing is downloaded.",
            "Files with the same models differ by rounding only. For formats without the model of a camera, another"
            f" model was fitted, with an error of at most {MAX_CONVERSION_ERROR_PX:g} px within the calibrated field of"
            " view.",
            "Keep the omnisight JSON file: only it has the covariance of the poses, the calibrated fields of view and"
            " the quality figures. Use the others for the programs that read them.",
        ),
    )


class RigExporter:
    """A rig in the camera models of formats; each model is fitted to each camera once."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.upright = rig, with_upright_ocam(rig)
        self._fits: dict[int, ModelConversions] = {}

    def in_models_of(self, chosen: Format) -> tuple[Rig, list[str]]:
        """Return the rig with the models of a format, and a note on each camera that was fitted.

        Raises
        ------
        FormatError
            If no model of the format is accurate enough for a camera.
        """
        rig = self.rig if Ocam.name in chosen.MODELS else self.upright
        cameras, notes = list[Sensor](), list[str]()
        for name, camera in zip(rig.names, rig.cameras, strict=True):
            if not isinstance(camera, Camera) or camera.model.name in chosen.MODELS:
                cameras.append(camera)
                continue
            conversion = self._fits.setdefault(id(camera), ModelConversions(camera)).best_of(chosen.MODELS)
            if conversion is None or not conversion.max_px <= MAX_CONVERSION_ERROR_PX:
                raise FormatError(f"{name}: {refusal(chosen, conversion)}")
            cameras.append(conversion.camera)
            notes.append(f"{name}: {conversion.camera.model.name}, max error {conversion.max_px:.2g} px")
        return replace(rig, cameras=tuple(cameras)), notes
