"""Views of the images of a reconstruction: the counterpart of `omnisight export --to splat` with workers or URLs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from omnisight.images import decode_image
from omnisight.pipeline.batch.batch import Batch, BatchResult
from omnisight.pipeline.batch.storage import is_below, list_images, path_below, read_file, write_file
from omnisight.pipeline.batch.task import Item, Process, describe
from omnisight.pipeline.inputs.work_folder import digest
from omnisight.reconstructions import read_reconstruction
from omnisight.reconstructions.splat import IMAGE_FOLDER, IN_IMAGE_FOLDER, CameraViews, plan_splat


@dataclass(frozen=True, eq=False)
class ExportTask:
    """The views and masks of each image; see `omnisight.pipeline.batch.task.Task`.

    Attributes
    ----------
    cameras
        Views of the images of each group.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    cameras: tuple[CameraViews | None, ...]
    apply_exif: bool

    @property
    def description(self) -> dict[str, Any]:
        """What determines the views."""
        return describe("export", cameras=digest(self.cameras), apply_exif=self.apply_exif)

    def prepare(self) -> Process:
        """Return the function from an image file to the files of its views; it computes the maps of a camera once."""
        renderers = dict[int, Callable[[NDArray[Any], str, Sequence[str]], list[bytes]]]()

        def export(item: Item, data: Sequence[bytes]) -> list[bytes]:
            (name,), (content,), camera = item.names, data, self.cameras[item.group]
            if item.group not in renderers and camera is not None:
                renderers[item.group] = camera.renderer()
            views = [output.rsplit("/", 1)[-1] for output in item.outputs[::2]]
            return renderers[item.group](decode_image(content, name, apply_exif=self.apply_exif), name, views)

        return export


def export_batch(
    model: str | Path, images: str, batch: Batch, size: int | None = None, *, apply_exif: bool = False
) -> BatchResult:
    """Write perspective views of the images of a reconstruction by workers, and then its model; see `Batch`.

    The files are those of `omnisight.export` with the format splat.

    Parameters
    ----------
    model
        A folder that `omnisight reconstruct` wrote.
    images
        Folder of the images, to which their names in the reconstruction are relative.
    batch
        Its output receives the views, masks and the model.
    size
        Width of a view of 90 degrees, px; by default the resolution of the image is kept.
    apply_exif
        Rotate images by their EXIF orientation.

    Raises
    ------
    ValueError
        If an image is missing, the output holds another run or the views would be among the images, or the cluster
        cannot be used.
    """
    views = f"{batch.output.rstrip('/')}/{IMAGE_FOLDER}"
    if is_below(views, images) and is_below(images, views):
        raise ValueError(f"{views}: {IN_IMAGE_FOLDER}")
    reconstruction = read_reconstruction(model)
    paths = [path_below(images, name) for name in reconstruction.names]
    versions = list_images(images, batch.output)
    if missing := sorted(set(paths).difference(versions)):
        raise ValueError(
            f"{missing[0]}: no such file or folder; {len(missing)} of {len(paths)} images are not in {images}: specify"
            " the folder that was reconstructed with --images"
        )

    def read(image: int) -> NDArray[Any]:
        return decode_image(read_file(images, paths[image]), paths[image], apply_exif=apply_exif)

    plan = plan_splat(reconstruction, size, read)
    sensors = zip(paths, reconstruction.sensor.tolist(), strict=True)
    items = [
        Item((path,), tuple(plan.outputs(image)), sensor, versions[path])
        for image, (path, sensor) in enumerate(sensors)
    ]
    result = batch.run(ExportTask(plan.cameras, apply_exif), items, images)
    for name, data in plan.model:
        write_file(batch.output, name, data)
    return result
