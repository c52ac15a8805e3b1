"""Views of many images: the counterpart of `omnisight view` with workers or URLs."""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnisight
from omnisight.camera import Camera
from omnisight.images.read import decode_image
from omnisight.images.write import encode_image
from omnisight.pipeline.batch.batch import BatchResult, Progress, run_batch
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.central_camera import central_camera
from omnisight.pipeline.view_options import ViewOptions
from omnisight.pipeline.view_renderer import ViewRenderer


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
    suffix: str = ".png"

    @property
    def description(self) -> dict[str, Any]:
        """What determines the views."""
        model = json.dumps([self.camera.model.name, self.camera.model.to_dict(), self.camera.size], sort_keys=True)
        options = {name: value for name, value in dataclasses.asdict(self.options).items() if value is not None}
        return {
            "command": "view",
            "version": omnisight.__version__,
            "camera": hashlib.sha256(model.encode()).hexdigest()[:16],
            "options": json.loads(json.dumps(options)),
        }

    def prepare(self) -> Callable[[bytes, str], bytes]:
        """Return the function from an image file to the file of its view; it computes the map once."""
        render = ViewRenderer(self.camera, self.options)

        def view(data: bytes, name: str) -> bytes:
            image = decode_image(data, name, apply_exif=self.options.apply_exif)
            return encode_image(render(image, name), f"{name}{self.suffix}")

        return view


def view_batch(
    images: str,
    camera: Camera | Path,
    output: str,
    options: ViewOptions | None = None,
    batch: BatchOptions = BatchOptions(),
    progress: Progress | None = None,
) -> BatchResult:
    """Turn all images of a folder into views, by the workers of this machine or of a cluster; see `run_batch`.

    Raises
    ------
    ValueError
        If an option is not usable, there are no images, the output holds another run, or the cluster cannot be used.
    """
    options = options or ViewOptions()
    if options.scale_camera:
        raise ValueError("--scale-camera applies to images of one size: convert the camera first, or view them apart")
    if isinstance(camera, Path):
        camera = central_camera(camera, name=options.name, distance=options.distance)
    return run_batch(ViewTask(camera, options), images, output, batch, progress)
