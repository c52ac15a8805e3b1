"""The images of one or more cameras: which camera took which image, and which were taken at the same time."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images import collect_images
from omnisight.images.collect import folders_with_images, natural_sort_key

Indices = NDArray[np.intp]

# Folders of a data set: images, and images that show the depth.
IMAGES, DEPTH = "images", "depth"


@dataclass(frozen=True, eq=False)
class ImageSet:
    """Images of one or more cameras.

    Attributes
    ----------
    paths
        The files.
    names
        Their names relative to the folder, with "/".
    camera
        (I,) index of the camera of each.
    frame
        (I,) index of the time at which each was taken: images of different cameras can have the same.
    rule
        What simultaneous images have in common: "name", "number" or "order"; empty if each was taken alone.
    """

    paths: list[Path]
    names: list[str]
    camera: Indices
    frame: Indices
    rule: str = ""

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.paths)

    def of_camera(self, camera: int) -> list[Path]:
        """Return the files of a camera."""
        return [path for path, k in zip(self.paths, self.camera, strict=True) if k == camera]


def image_set(
    images: str | PathLike[str] | Iterable[str | PathLike[str]], cameras: Sequence[str] = (), *, is_rig: bool = False
) -> ImageSet:
    """List images, and assign them to cameras and, for a rig, to times.

    Parameters
    ----------
    images
        Folder, or image files. The sub-folders of a folder without images of its own are searched too. Of a data set,
        as `omnisight simulate` writes it, only the folder `images` is used, or that of each camera.
    cameras
        Names of the cameras; without any, all images are of one camera. The path of an image contains the name of its
        camera as a whole word: as a folder, or in the file name.
    is_rig
        Whether images of different cameras can have been taken at the same time.

    Raises
    ------
    ValueError
        If there are no images, one belongs to no camera, or none of a rig were taken at the same time.
    """
    inputs = [images] if isinstance(images, str | PathLike) else list(images)
    paths = collect_images([folder for item in inputs for folder in image_folders(Path(item), cameras)])
    absolute = [os.path.abspath(path) for path in paths]
    is_folder = len(inputs) == 1 and Path(inputs[0]).is_dir()
    parent = os.path.abspath(inputs[0]) if is_folder else os.path.commonpath([os.path.dirname(p) for p in absolute])
    names = [Path(path).relative_to(parent).as_posix() for path in absolute]
    return assign_images(paths, names, cameras, is_rig=is_rig)


def assign_images(paths: list[Path], names: list[str], cameras: Sequence[str], *, is_rig: bool) -> ImageSet:
    """Assign images to cameras and, for a rig, to times; see `image_set`."""
    alone = np.arange(len(paths))
    if not cameras:
        return ImageSet(paths, names, np.zeros(len(paths), np.intp), alone)
    camera = np.array([camera_of(path, cameras) for path in paths], np.intp)
    if not is_rig:
        return ImageSet(paths, names, camera, alone)
    keys = [_without(name, cameras[int(k)]) for name, k in zip(names, camera, strict=True)]
    frame, rule = simultaneous_images(keys, camera)
    return ImageSet(paths, names, camera, frame, rule)


def image_folders(item: Path, cameras: Sequence[str] = ()) -> list[Path]:
    """Return an input; for a data set its folders of images; for a folder of no images its sub-folders."""
    of_cameras = [item / name / IMAGES for name in cameras]
    if of_cameras and all(folder.is_dir() for folder in of_cameras):
        return of_cameras
    folders = [item] if _is_data_set(item) else folders_with_images(item) or [item]
    return [folder / IMAGES if _is_data_set(folder) else folder for folder in folders]


def _is_data_set(folder: Path) -> bool:
    """Return whether a folder is the data set of a camera, whose other images are no images of the scene."""
    return all((folder / name).is_dir() for name in (IMAGES, DEPTH))


def camera_of(path: Path, cameras: Sequence[str]) -> int:
    """Return the camera whose name is nearest to the end of a path, the longest of those that end there.

    Raises
    ------
    ValueError
        If the path contains the name of no camera as a whole word.
    """
    text = (path if path.is_dir() else path.with_suffix("")).as_posix()
    ends = [(max((match.end() for match in _words(text, name)), default=-1), len(name)) for name in cameras]
    last = max(ends)
    if last[0] < 0:
        example = f"{cameras[0]}/1.jpg or {cameras[0]}_1.jpg"
        raise ValueError(
            f"{path}: belongs to none of the cameras {', '.join(cameras)}: name it like {example}, or leave it out"
        )
    return ends.index(last)


def _words(text: str, name: str) -> Iterable[re.Match[str]]:
    return re.finditer(rf"(?<![a-z0-9]){re.escape(name)}(?![a-z0-9])", text, re.IGNORECASE)


def _without(name: str, camera: str) -> str:
    """Return the name of an image without its extension and the last occurrence of the name of its camera."""
    stem = str(Path(name).with_suffix("").as_posix())
    last = list(_words(stem, camera))
    return f"{stem[: last[-1].start()]}/{stem[last[-1].end() :]}" if last else stem


def simultaneous_images(keys: Sequence[str], camera: Indices) -> tuple[Indices, str]:
    """Return the frame of each image, and the rule that assigns them: "name", "number" or "order".

    Parameters
    ----------
    keys
        Name of each image without the name of its camera.
    camera
        (I,) index of the camera of each.

    Raises
    ------
    ValueError
        If no rule finds simultaneous images.
    """
    for rule, values in (("name", keys), ("number", [_number(key) for key in keys]), ("order", _order(keys, camera))):
        counts = Counter(zip(values, camera.tolist(), strict=True))
        times = Counter(value for value, _ in counts)
        if None not in values and max(counts.values()) == 1 and max(times.values()) > 1:
            ordered = sorted(times, key=lambda value: natural_sort_key(str(value)))
            number = {value: i for i, value in enumerate(ordered)}
            return np.array([number[value] for value in values], np.intp), rule
    raise ValueError(
        "no images of two cameras were taken at the same time: give simultaneous images the same name or number, such"
        " as front/1.jpg and back/1.jpg"
    )


def _number(key: str) -> int | None:
    """Return the last number of a name."""
    numbers = re.findall(r"[0-9]+", key)
    return int(numbers[-1]) if numbers else None


def _order(keys: Sequence[str], camera: Indices) -> list[int | None]:
    """Return the position of each image among those of its camera; None if the cameras have not as many images."""
    position: list[int | None] = [None] * len(keys)
    if len(set(Counter(camera.tolist()).values())) == 1:
        for k in np.unique(camera):
            taken = sorted(np.flatnonzero(camera == k).tolist(), key=lambda image: natural_sort_key(keys[image]))
            for i, image in enumerate(taken):
                position[image] = i
    return position
