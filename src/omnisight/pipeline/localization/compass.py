"""Headings of images from their appearance: the counterpart of `omnisight compass`."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from omnisight.choices import check_options
from omnisight.display import Displayed
from omnisight.images import reason_without_name
from omnisight.pipeline.inputs.central_camera import CameraSource
from omnisight.pipeline.localization.compass_images import CompassImage, NamedImage, PanoramaReader, named_images
from omnisight.pipeline.localization.compass_options import CompassOptions
from omnisight.places.panorama_rotation import CompassRotation, estimate_rotation
from omnisight.places.panorama_signature import PanoramaSignature
from omnisight.places.visual_compass import VisualCompass
from omnisight.progress import Progress, no_progress


@dataclass(frozen=True)
class Heading(Displayed):
    """Heading of an image.

    Attributes
    ----------
    name
        Name of the image.
    nearest
        Name of the most similar reference.
    heading_deg
        Heading of the image minus that of the reference, within -180 to 180; positive is clockwise from above.
    sigma_deg
        Its standard deviation.
    similarity
        Correlation coefficient of image and reference after the rotation, at most 1.
    is_reference
        Whether the image is the reference itself, and its heading 0 by definition.
    """

    name: str
    nearest: str
    heading_deg: float
    sigma_deg: float
    similarity: float
    is_reference: bool = False


@dataclass(frozen=True)
class CompassResult(Displayed):
    """Headings of images; false if there are none.

    Attributes
    ----------
    headings
        Headings, in the order of the images.
    references
        Number of references.
    failed
        Reasons of images without a heading and of references that are not used, by their names, or by their paths
        where names repeat.
    reason
        Why there are no headings; empty otherwise.
    """

    headings: tuple[Heading, ...] = field(repr=False)
    references: int
    failed: dict[str, str]
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether there are headings."""
        return not self.reason


def compass(
    images: CompassImage | Sequence[CompassImage],
    reference: CompassImage | Sequence[CompassImage] | None = None,
    options: CompassOptions = CompassOptions(),
    *,
    camera: CameraSource | None = None,
    progress: Progress = no_progress,
) -> CompassResult:
    """Estimate the heading of images relative to the most similar of several references.

    Parameters
    ----------
    images
        A folder, files, or arrays: panoramas whose columns cover 360 degrees clockwise from left to right, of any size,
        or images of a camera.
    reference
        The same for the references, such as the images of a route; by default the first image.
    options
        Options of the command.
    camera
        The camera of the images and the references, or its file; None for panoramas.
    progress
        Called with the stage, the work done and the total.

    Returns
    -------
    The result, which is false with a reason if no image has a heading.

    Raises
    ------
    ValueError
        If there are no images or the camera file cannot be read.
    """
    check_options(options, CompassOptions)
    queries = named_images(images)
    sources = queries[:1] if reference is None else named_images(reference)
    read, failed = PanoramaReader(camera, options), list[tuple[NamedImage, str]]()
    references = _read_references(sources, read, failed, progress)
    if not references:
        return CompassResult((), 0, _by_name(failed), f"no reference can be used: {failed[0][0].name}: {failed[0][1]}")
    files = [source.source for source, _ in references]
    visual_compass = VisualCompass([signature for _, signature in references])
    headings: list[Heading] = []
    for done, query in enumerate(queries):
        own = _index_of(query, files) if reference is not None else None
        try:
            if own is not None and len(references) == 1:
                raise ValueError(f"{query.name}: is the only reference: specify other references")
            nearest, rotation = visual_compass.locate(read(query), own)
            source = references[nearest][0]
            headings.append(Heading(query.name, source.name, *rotation, is_reference=source is query))
        except ValueError as error:
            failed.append((query, reason_without_name(error, str(query.source))))
        progress("headings", done + 1, len(queries))
    reason = "" if headings else f"no image has a heading: {failed[0][0].name}: {failed[0][1]}"
    return CompassResult(tuple(headings), len(references), _by_name(failed), reason)


def compass_rotation(
    image_a: CompassImage,
    image_b: CompassImage,
    camera: CameraSource | None = None,
    options: CompassOptions = CompassOptions(),
) -> CompassRotation:
    """Estimate the rotation between two images about the vertical axis from their appearance.

    It does not depend on keypoints and can therefore check a relative pose: `CompassRotation.deviation` compares it
    with the rotation of visual odometry.

    Parameters
    ----------
    image_a, image_b
        The images, or their files.
    camera
        Their camera, or its file; None for panoramas whose columns cover 360 degrees clockwise.
    options
        Options of `compass`.

    Returns
    -------
    The heading of the second image minus that of the first.

    Raises
    ------
    ValueError
        If an image cannot be read or is uniform, or both have different shapes.
    """
    check_options(options, CompassOptions)
    read = PanoramaReader(camera, options)
    a, b = (_one_image(image, f"image {name}") for image, name in ((image_a, "a"), (image_b, "b")))
    first = read(a)
    return estimate_rotation(read(b), first)


def _one_image(image: CompassImage, label: str) -> NamedImage:
    """Return one image with its name."""
    found = named_images(image)
    if len(found) != 1:
        raise ValueError(f"{image}: has {len(found)} images; specify one")
    return found[0] if isinstance(found[0].source, Path) else NamedImage(label, found[0].source)


def _read_references(
    sources: Sequence[NamedImage], read: PanoramaReader, failed: list[tuple[NamedImage, str]], progress: Progress
) -> list[tuple[NamedImage, PanoramaSignature]]:
    """Read the references that can be used, and add the reasons of the others."""
    references: list[tuple[NamedImage, PanoramaSignature]] = []
    for done, source in enumerate(sources):
        try:
            references.append((source, read(source)))
        except ValueError as error:
            failed.append((source, reason_without_name(error, str(source.source))))
        progress("references", done + 1, len(sources))
    return references


def _by_name(failed: Sequence[tuple[NamedImage, str]]) -> dict[str, str]:
    """Return reasons by the names of images, or by their paths where names repeat."""
    counts = Counter(image.name for image, _ in failed)
    repeats = [counts[image.name] > 1 and isinstance(image.source, Path) for image, _ in failed]
    names = [str(image.source) if path else image.name for path, (image, _) in zip(repeats, failed, strict=True)]
    return dict(zip(names, (reason for _, reason in failed), strict=True))


def _index_of(query: NamedImage, files: Sequence[object]) -> int | None:
    """Return the index of the reference that is the file of the query."""
    if not isinstance(query.source, Path):
        return None
    own = query.source.resolve()
    return next((i for i, file in enumerate(files) if isinstance(file, Path) and file.resolve() == own), None)
