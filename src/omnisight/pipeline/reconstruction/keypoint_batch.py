"""Keypoints of many images: the first stage of `omnisight reconstruct` with workers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.features import FeatureOptions, Keypoints
from omnisight.images import UnreadableImage, decode_image
from omnisight.pipeline.batch.batch import Batch
from omnisight.pipeline.batch.storage import file_versions, read_each_below
from omnisight.pipeline.batch.task import Item, Process, describe
from omnisight.pipeline.inputs.image_set import ImageSet
from omnisight.pipeline.inputs.work_folder import WorkFolder, digest, from_bytes, to_bytes
from omnisight.pipeline.reconstruction.image_cameras import ImageCameras
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.stored_stages import detected_arrays, from_detected_arrays
from omnisight.progress import Progress

# Array of an image that cannot be read, in place of its keypoints.
REASON = "reason"


@dataclass(frozen=True, eq=False)
class KeypointTask:
    """Keypoints of each image and their colours; see `omnisight.pipeline.batch.task.Task`.

    Attributes
    ----------
    cameras
        The cameras of the groups.
    options
        How keypoints are detected.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    cameras: ImageCameras
    options: FeatureOptions
    apply_exif: bool

    @property
    def description(self) -> dict[str, Any]:
        """What determines the keypoints."""
        cameras = digest(self.cameras.cameras, self.cameras.masks)
        return describe("keypoints", cameras=cameras, options=self.options, apply_exif=self.apply_exif)

    def prepare(self) -> Process:
        """Return the function from an image file to the file of its keypoints, or of why it cannot be read."""

        def detect(item: Item, data: Sequence[bytes]) -> list[bytes]:
            try:
                image = decode_image(data[0], item.names[0], apply_exif=self.apply_exif)
            except UnreadableImage as error:
                return [to_bytes({REASON: np.array(str(error))})]
            self.cameras.check_size(image, item.inputs[0], item.group)
            camera, mask = self.cameras.cameras[item.group], self.cameras.masks[item.group]
            return [to_bytes(detected_arrays(image, camera, self.options, mask))]

        return detect


def detect_by_workers(
    files: ImageSet,
    cameras: ImageCameras,
    options: ReconstructOptions,
    progress: Progress,
    work: WorkFolder,
) -> Iterator[tuple[Keypoints, NDArray[np.uint8]] | UnreadableImage]:
    """Yield the keypoints of each image and their colours (K, 3), which workers detect and the work folder keeps.

    Of an image that cannot be read, the reason is yielded.

    Raises
    ------
    ValueError
        If there is no work folder, or an image cannot be used.
    """
    if work.folder is None:
        raise ValueError("workers need a folder in which they store keypoints: specify work")
    task = KeypointTask(cameras, FeatureOptions(max_keypoints=options.max_keypoints), options.apply_exif)
    outputs = [f"{i:07}.npz" for i in range(len(files))]
    paths = [path.absolute().as_posix() for path in files.paths]
    versions = file_versions(paths[0], paths)
    items = [
        Item((path,), (output,), camera, versions[path])
        for path, output, camera in zip(paths, outputs, files.camera.tolist(), strict=True)
    ]
    folder = str(work.batch_folder)
    result = Batch(folder, options, progress).run(task, items, paths[0])
    if result.failed:
        path, reason = result.failed[0]
        raise ValueError(
            f"{len(result.failed)} of {len(files)} images cannot be used, the first is {path}: {reason}; replace them,"
            f" and the same command continues; or leave them out, and delete {folder}"
        )
    for data in read_each_below(folder, outputs):
        arrays = from_bytes(data)
        yield UnreadableImage(str(arrays[REASON])) if REASON in arrays else from_detected_arrays(arrays)
