"""Files in which boards are detected, one by one."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from omnisight.images import UnreadableImage, read_bytes, read_image
from omnisight.progress import StageProgress, no_progress
from omnisight.targets.boards import Board
from omnisight.targets.raw_detections import RawDetections, detect_in_file
from omnisight.targets.set_field import sample_indices


class BoardImages(Protocol):
    """Images in which boards are detected, wherever they are and whatever detects in them.

    Attributes
    ----------
    paths
        The files.
    apply_exif
        Whether they are rotated by their EXIF orientation.
    cache
        Whether results of earlier runs are used.
    """

    @property
    def paths(self) -> Sequence[Path]: ...

    @property
    def apply_exif(self) -> bool: ...

    @property
    def cache(self) -> bool: ...

    def detect(self, board: Board | None) -> list[RawDetections | UnreadableImage]:
        """Return the detections in all images, or the error of those that cannot be read."""
        ...

    def read(self, path: Path) -> NDArray[Any]:
        """Return an image."""
        ...


@dataclass(frozen=True)
class ImageFiles:
    """Image files on this machine, in which threads detect; see `BoardImages`."""

    paths: Sequence[Path]
    apply_exif: bool
    cache: bool
    progress: StageProgress = no_progress

    def detect(self, board: Board | None) -> list[RawDetections | UnreadableImage]:
        """Detect in all files, in threads."""
        samples = set(sample_indices(len(self.paths)).tolist())

        def detect_in(index: int) -> RawDetections | UnreadableImage:
            path, keep = self.paths[index], index in samples
            try:
                data = read_bytes(path)
                return detect_in_file(
                    data, path.name, board, apply_exif=self.apply_exif, cache=self.cache, keep_thumbnail=keep
                )
            except UnreadableImage as error:
                return error

        results = list[RawDetections | UnreadableImage]()
        with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
            for result in pool.map(detect_in, range(len(self.paths))):
                results.append(result)
                self.progress(len(results), len(self.paths))
        return results

    def read(self, path: Path) -> NDArray[Any]:
        """Read an image file."""
        return read_image(path, apply_exif=self.apply_exif)
