"""Views of image files: the counterpart of `omnisight view`."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats import save
from omnisight.images import collect_images, read_image, write_image
from omnisight.images.output_paths import output_paths, refuse_overwrite
from omnisight.pipeline.inputs.central_camera import AnyCameraSource, camera_of_image, central_camera
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_renderer import ViewRenderer
from omnisight.progress import Progress, no_progress
from omnisight.views.maps import visible_fraction
from omnisight.views.remapper import magnification

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ViewResult(Displayed):
    """Views that were written.

    Attributes
    ----------
    options
        The options with the defaults for the camera.
    files
        The views that were written.
    source, target
        The camera of the images, scaled to them, and the camera of the view (of one face of a cube).
    rotations
        target_from_source (3, 3) of the view, or of each face of a cube.
    image_fraction
        Share of the image that the view shows.
    view_fraction
        Share of the view that the image covers.
    extrapolated_fraction
        Share of the covered view that is outside the calibrated field of view.
    magnification
        Size of an image pixel in the view, px, in the centre and at the edge.
    errors
        Messages of the images that were skipped.
    """

    options: ViewOptions
    files: tuple[Path, ...]
    source: Camera
    target: Camera
    rotations: tuple[Array, ...]
    image_fraction: float
    view_fraction: float
    extrapolated_fraction: float
    magnification: tuple[float, float]
    errors: tuple[str, ...]

    @classmethod
    def of(
        cls,
        options: ViewOptions,
        files: Sequence[Path],
        cameras: tuple[Camera, Camera],
        rotations: Sequence[Array],
        covered: Mask,
        extrapolated: Mask,
        *,
        errors: Sequence[str] = (),
    ) -> Self:
        """Return the measures of views that a source and a target camera determine, with masks (H, W) of the view."""
        source, target = cameras
        return cls(
            options,
            tuple(files),
            source,
            target,
            tuple(rotations),
            image_fraction=sum(visible_fraction(source, target, rotation) for rotation in rotations),
            view_fraction=float(covered.mean()),
            extrapolated_fraction=float((extrapolated & covered).sum() / max(covered.sum(), 1)),
            magnification=magnification(source, target, rotations[0]),
            errors=tuple(errors),
        )


def view(
    images: str | PathLike[str] | Sequence[str | PathLike[str]],
    camera: AnyCameraSource | None,
    output: str | PathLike[str],
    options: ViewOptions | None = None,
    *,
    mask: str | PathLike[str] | None = None,
    view_camera: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
) -> ViewResult:
    """Turn image files into views and write them.

    Parameters
    ----------
    images
        Image files, folders or patterns, one or several; all images are of the same size.
    camera
        The camera of the images, or its calibration file of any format; None for equirectangular images of 360° x 180°,
        which are twice as wide as high.
    output
        File of the view, or a folder; several images need a folder, which is created.
    options
        The view.
    mask
        Write the mask of covered pixels as a PNG: 255 where the image covers the view.
    view_camera
        Write the camera of the view; its provenance has the rotation.
    progress
        Called with a stage, the images done and the total.

    Raises
    ------
    ValueError
        If an option is not usable, the only image is not, or no image is.
    OSError
        If a file cannot be written.
    """
    options = options or ViewOptions()
    central = None if camera is None else central_camera(camera, name=options.name, distance=options.distance)
    paths = collect_images(images)
    read = [*paths, *([Path(camera)] if isinstance(camera, str | PathLike) else [])]
    files = _prepare_output(paths, Path(output), [Path(each) for each in (mask, view_camera) if each], read)
    render = None if central is None else ViewRenderer(central, options)
    written: list[Path] = []
    errors: list[str] = []
    for i, (path, file) in enumerate(zip(paths, files, strict=True)):
        progress("view", i, len(paths))
        try:
            image = read_image(path, apply_exif=options.apply_exif)
            if render is None:
                size = image.shape[1], image.shape[0]
                render = ViewRenderer(camera_of_image(None, size, path.name, name=None, scale=False), options)
            write_image(file, render(image, path.name))
            written.append(file)
        except ValueError as error:  # one unusable image does not stop the others
            if len(paths) == 1:
                raise
            errors.append(str(error))
    progress("view", len(paths), len(paths))
    if render is None or not written:
        raise ValueError(skipped_message(errors, len(paths)))
    if mask is not None:
        write_image(Path(mask), render.covered.astype(np.uint8) * 255)
    if view_camera is not None:
        provenance = {"view": True, "target_from_source": render.rotations[0].tolist()}
        save(dataclasses.replace(render.target, provenance=provenance), Path(view_camera))
    cameras, masks = (render.source, render.target), (render.covered, render.extrapolated)
    return ViewResult.of(render.options, written, cameras, render.rotations, *masks, errors=errors)


def skipped_message(errors: Sequence[str], total: int) -> str:
    """Return the message for images that could not be used."""
    return f"{len(errors)} of {total} images were skipped:\n  " + "\n  ".join(errors)


def _prepare_output(images: Sequence[Path], output: Path, others: Sequence[Path], read: Sequence[Path]) -> list[Path]:
    """Return the file of each view; check that no file that is read or another output is overwritten."""
    several = len(images) > 1
    if several and output.is_file():
        raise ValueError(f"{output}: is a file; choose a folder for {len(images)} images")
    files = output_paths(images, output) if several or output.is_dir() else [output]
    refuse_overwrite([*files, *others], read)
    if len({file.resolve() for file in (*files, *others)}) < len(files) + len(others):
        raise ValueError(f"{others[0]}: the view, its mask and its camera have the same file; specify one for each")
    if several:
        output.mkdir(parents=True, exist_ok=True)
    return files
