"""Views of image files: the counterpart of `omnisight view`."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats import save
from omnisight.images import collect_images, decode_image, read_bytes, write_bytes, write_image
from omnisight.images.output_paths import check_output_folder, output_paths, refuse_overwrite
from omnisight.images.view_tags import view_tags
from omnisight.pipeline.inputs.central_camera import AnyCameraSource, camera_of_image, central_camera
from omnisight.pipeline.views.view_encoding import encode_view
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_renderer import ViewRenderer
from omnisight.progress import Progress, no_progress
from omnisight.views.maps import extrapolated_fraction, visible_fraction
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
        Share of the view, or of all faces of a cube, that the image covers.
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
        *,
        errors: Sequence[str] = (),
    ) -> Self:
        """Return the measures of views that a source and a target camera determine, with their mask (H, W)."""
        source, target = cameras
        return cls(
            options,
            tuple(files),
            source,
            target,
            tuple(rotations),
            image_fraction=sum(visible_fraction(source, target, rotation) for rotation in rotations),
            view_fraction=float(covered.sum() / (target.width * target.height * len(rotations))),  # not of the cross
            extrapolated_fraction=extrapolated_fraction(source, target, rotations),
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
    views = [(output, options or ViewOptions())]
    return view_images(images, camera, views, mask=mask, view_camera=view_camera, progress=progress)[0]


def view_images(
    images: str | PathLike[str] | Sequence[str | PathLike[str]],
    camera: AnyCameraSource | None,
    views: Sequence[tuple[str | PathLike[str], ViewOptions]],
    *,
    mask: str | PathLike[str] | None = None,
    view_camera: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
) -> tuple[ViewResult, ...]:
    """Turn image files into one or several views and write them; each image is read once.

    Parameters
    ----------
    images, camera, progress
        As of `view`.
    views
        Output and options of each view. Options that concern the images are those of the first.
    mask, view_camera
        As of `view`, of the first view.

    Raises
    ------
    ValueError, OSError
        As of `view`; or if two views have the same file.
    """
    first = views[0][1]
    central = None if camera is None else central_camera(camera, name=first.name, distance=first.distance)
    items = [images] if isinstance(images, str | PathLike) else list(images)
    paths = collect_images(items)
    has_folder = any(Path(item).is_dir() for item in items)
    files = [_output_files(paths, Path(output), has_folder=has_folder) for output, _ in views]
    read = [*paths, *([Path(camera)] if isinstance(camera, str | PathLike) else [])]
    _check_outputs(files, [Path(each) for each in (mask, view_camera) if each], read)
    written = [_ImageView(central, options, own) for (_, options), own in zip(views, files, strict=True)]
    for i, path in enumerate(paths):
        progress("view", i, len(paths))
        try:
            data = read_bytes(path)
            image = decode_image(data, path.name, apply_exif=first.apply_exif)
        except ValueError as error:  # one unusable image does not stop the others
            if len(paths) == 1:
                raise
            for each in written:
                each.errors.append(str(error))
            continue
        tags = view_tags(data)
        for each in written:
            each.write(image, i, path.name, tags)
    progress("view", len(paths), len(paths))
    results = tuple(each.result() for each in written)
    render = written[0].renderer
    if mask is not None:
        write_image(Path(mask), render.covered.astype(np.uint8) * 255)
    if view_camera is not None:
        provenance = {"view": True, "target_from_source": render.rotations[0].tolist()}
        save(dataclasses.replace(render.target, provenance=provenance), Path(view_camera))
    return results


def skipped_message(errors: Sequence[str], total: int) -> str:
    """Return the message for images that could not be used."""
    return f"{len(errors)} of {total} images were skipped:\n  " + "\n  ".join(errors)


class _ImageView:
    """One of the views of images.

    Attributes
    ----------
    files
        File of the view of each image.
    errors
        Messages of the images that were skipped.
    """

    def __init__(self, camera: Camera | None, options: ViewOptions, files: Sequence[Path]) -> None:
        self.files, self.errors = files, list[str]()
        self._options, self._written = options, list[Path]()
        self._renderer = None if camera is None else ViewRenderer(camera, options)

    @property
    def renderer(self) -> ViewRenderer:
        """The renderer; raises `ValueError` if no image could be used."""
        if self._renderer is None or not self._written:
            raise ValueError(skipped_message(self.errors, len(self.files)))
        return self._renderer

    def write(self, image: NDArray[Any], index: int, name: str, tags: bytes) -> None:
        """Write the view of an image, with its tags; raise `ValueError` only if it is the only one."""
        file = self.files[index]
        try:
            if self._renderer is None:
                size = image.shape[1], image.shape[0]
                self._renderer = ViewRenderer(camera_of_image(None, size, name, name=None, scale=False), self._options)
            view = self._renderer(image, name)
            if len(self.files) > 1:
                file.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(file, encode_view(view, file.name, self._renderer.target, tags))
            self._written.append(file)
        except ValueError as error:
            if len(self.files) == 1:
                raise
            self.errors.append(str(error))

    def result(self) -> ViewResult:
        """Return the measures of the view."""
        own = self.renderer
        cameras = own.source, own.target
        return ViewResult.of(own.options, self._written, cameras, own.rotations, own.covered, errors=self.errors)


def _output_files(images: Sequence[Path], output: Path, *, has_folder: bool) -> list[Path]:
    """Return the file of the view of each image; raise if an output folder cannot be used.

    The view of the only image may be next to it, unless the image was found in a folder.
    """
    several = len(images) > 1
    if several and output.is_file():
        raise ValueError(f"{output}: is a file; choose a folder for {len(images)} images")
    if not several and not output.is_dir():
        return [output]
    files = output_paths(images, output)
    check_output_folder(output, [path.parent for path in images] if several or has_folder else ())
    return files


def _check_outputs(views: Sequence[Sequence[Path]], others: Sequence[Path], read: Sequence[Path]) -> None:
    """Check that no file that is read or another output is overwritten."""
    files = [file for view in views for file in view]
    refuse_overwrite([*files, *others], read)
    counts = Counter(file.resolve() for file in files)
    if doubled := [file for file in files if counts[file.resolve()] > 1]:
        raise ValueError(f"{doubled[0]}: two views have the same file; specify one for each")
    if len({*counts, *(file.resolve() for file in others)}) < len(files) + len(others):
        raise ValueError(f"{others[0]}: the view, its mask and its camera have the same file; specify one for each")
