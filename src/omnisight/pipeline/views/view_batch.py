"""Views of many images: the counterpart of `omnisight view` with workers or URLs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from omnisight.camera import Camera
from omnisight.formats.native import to_json
from omnisight.images.read import decode_image
from omnisight.images.view_tags import view_tags
from omnisight.pipeline.batch.batch import Batch, BatchResult
from omnisight.pipeline.batch.manifest import items_of_images
from omnisight.pipeline.batch.storage import list_images
from omnisight.pipeline.batch.task import Item, Process, describe
from omnisight.pipeline.inputs.central_camera import AnyCameraSource, central_camera
from omnisight.pipeline.inputs.work_folder import digest
from omnisight.pipeline.views.view_encoding import encode_view
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_renderer import ViewRenderer


@dataclass(frozen=True)
class ViewTask:
    """The view of each image of a camera; see `omnisight.pipeline.batch.task.Task`.

    Attributes
    ----------
    camera
        The camera of the images.
    options
        The view.
    """

    camera: Camera
    options: ViewOptions

    @property
    def description(self) -> dict[str, Any]:
        """What determines the views."""
        return describe("view", camera=digest(to_json(self.camera))[:12], options=self.options)

    def prepare(self) -> Process:
        """Return the function from an image file to the file of its view; it computes the map once."""
        render = ViewRenderer(self.camera, self.options)

        def view(item: Item, data: Sequence[bytes]) -> list[bytes]:
            (name,), (content,) = item.names, data
            image = decode_image(content, name, apply_exif=self.options.apply_exif)
            return [encode_view(render(image, name), item.outputs[0], render.target, view_tags(content))]

        return view


def view_batch(
    images: str,
    camera: AnyCameraSource,
    batch: Batch,
    options: ViewOptions | None = None,
) -> BatchResult:
    """Turn all images of a folder into views, by the workers of this machine or of a cluster; see `Batch`.

    Raises
    ------
    ValueError
        If an option is not usable, there are no images, the output holds another run, or the cluster cannot be used.
    """
    options = options or ViewOptions()
    if options.scale_camera:
        raise ValueError("--scale-camera applies to images of one size: convert the camera first, or view them apart")
    central = central_camera(camera, name=options.name, distance=options.distance)
    items = items_of_images(list_images(images, batch.output), ".png")
    return batch.run(ViewTask(central, options), items, images)
