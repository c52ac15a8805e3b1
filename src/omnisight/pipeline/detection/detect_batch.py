"""Boards in many images: the counterpart of `omnisight detect` with workers or URLs."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from omnisight.corners.native import serialize
from omnisight.images import UnreadableImage, decode_image
from omnisight.pipeline.batch.batch import Batch, BatchResult
from omnisight.pipeline.batch.manifest import items_of_images
from omnisight.pipeline.batch.storage import FOLDER, list_images, read_each_below, read_file, write_file
from omnisight.pipeline.batch.task import Item, Process, describe
from omnisight.pipeline.detection.detect_options import DetectOptions
from omnisight.targets import Board, Checkerboard, Detections
from omnisight.targets.detection import detect_in_set
from omnisight.targets.raw_detections import RawDetections, detect_in_file

CORNERS = "corners.json"


@dataclass(frozen=True)
class DetectTask:
    """Boards in each image; see `omnisight.pipeline.batch.task.Task`.

    Attributes
    ----------
    board
        A board with markers or circles; None for checkerboards of any size.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    board: Board | None
    apply_exif: bool

    @property
    def description(self) -> dict[str, Any]:
        """What determines the detections."""
        board = "checkerboard" if self.board is None else self.board.to_dict()
        return describe("detect", board=board, apply_exif=self.apply_exif)

    def prepare(self) -> Process:
        """Return the function from an image file to the file of its detections."""

        def detect(item: Item, data: Sequence[bytes]) -> list[bytes]:
            raw = detect_in_file(data[0], item.names[0], self.board, apply_exif=self.apply_exif, cache=False)
            return [raw.to_json().encode()]

        return detect


@dataclass(eq=False)
class BatchImages:
    """Images in which the workers of a batch detect; see `omnisight.targets.image_files.BoardImages`.

    Attributes
    ----------
    source
        Folder of the images.
    versions
        Their paths in the file system of the source, and their versions.
    apply_exif
        Rotate images by their EXIF orientation.
    batch
        Where the results and the workers are.
    result
        Of the last detection.
    """

    source: str
    versions: dict[str, str]
    apply_exif: bool
    batch: Batch
    result: BatchResult = field(init=False)
    cache: bool = False

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return [Path(name) for name in self.versions]

    def detect(self, board: Board | None) -> list[RawDetections | UnreadableImage]:
        """Detect in all images by workers, whose results remain for the next run."""
        task = DetectTask(None if isinstance(board, Checkerboard) else board, self.apply_exif)
        kind = "checkerboard" if task.board is None else task.board.kind
        folder, items = f"{self.batch.output}/{FOLDER}/{kind}", items_of_images(self.versions, ".json")
        self.result = replace(self.batch, output=folder).run(task, items, self.source)
        failed = dict(self.result.failed)
        texts = read_each_below(folder, [item.outputs[0] for item in items if item.inputs[0] not in failed])
        return [
            UnreadableImage(failed[name]) if name in failed else RawDetections.from_json(next(texts))
            for name in self.versions
        ]

    def read(self, path: Path) -> NDArray[Any]:
        """Read an image."""
        return decode_image(read_file(self.source, path.as_posix()), path.name, apply_exif=self.apply_exif)


def detect_batch(images: str, batch: Batch, options: DetectOptions = DetectOptions()) -> tuple[Detections, BatchResult]:
    """Detect a board in all images of a folder, by the workers of this machine or of a cluster; see `Batch`.

    The detections are those of `omnisight.detect`. The output folder receives corners.json, which
    `omnisight.read_corners` reads.

    Raises
    ------
    ValueError
        If there are no images, the output holds another run, or the cluster cannot be used.
    """
    files = BatchImages(images, list_images(images, batch.output), options.apply_exif, batch)
    detections = detect_in_set(files, options.board, options.square_m)
    write_file(batch.output, CORNERS, f"{serialize(detections)}\n".encode())
    return detections, files.result
