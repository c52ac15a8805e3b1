"""Maps for localization: a reconstruction with the descriptors of its observations, in a folder."""

import io
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images import write_bytes
from omnisight.localization.visual_map import VisualMap
from omnisight.pipeline.inputs.camera_sources import AnyCameraSource, RigSource
from omnisight.pipeline.reconstruction.reconstruct import reconstruct_with_keypoints
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult
from omnisight.progress import Progress, no_progress
from omnisight.reconstructions import read_reconstruction, write_reconstruction

FILE = "descriptors.npy"
# Steps of one component of a unit SIFT descriptor: its entries are at most about 0.5, and 8 bits lose 0.1 % of it.
STEPS = 512.0
# Longer descriptors are those of a damaged file: SIFT has 128 elements.
MAX_DESCRIPTOR_LENGTH = 1024


def build_map(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    camera: AnyCameraSource | Mapping[str, AnyCameraSource] | None = None,
    rig: RigSource | None = None,
    options: ReconstructOptions = ReconstructOptions(),
    progress: Progress = no_progress,
    work: str | PathLike[str] | None = None,
) -> tuple[VisualMap | None, ReconstructionResult]:
    """Reconstruct images, and return the largest model as a map in which images of other cameras can be localized.

    The parameters and errors are those of `reconstruct`.

    Returns
    -------
    The map, None if there is no model, and the result of the reconstruction.
    """
    result, keypoints = reconstruct_with_keypoints(images, camera, rig, options, progress, work)
    if not result:
        return None, result
    model = result.models[0]
    assert model.observations.keypoint is not None
    length = keypoints[model.names[0]].descriptors.shape[1]
    descriptors = np.zeros((len(model.observations), length), np.float32)
    for image, name in enumerate(model.names):
        rows = np.flatnonzero(model.observations.image == image)
        descriptors[rows] = keypoints[name].descriptors[model.observations.keypoint[rows]]
    return VisualMap(model, descriptors), result


def write_map(folder: str | PathLike[str], visual_map: VisualMap) -> None:
    """Write a map to a folder: the files of a reconstruction, and the descriptors."""
    write_reconstruction(Path(folder), visual_map.reconstruction)
    scaled = np.clip(np.rint(visual_map.descriptors * STEPS), 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    np.save(stream, scaled, allow_pickle=False)
    write_bytes(Path(folder) / FILE, stream.getvalue())


def read_map(folder: str | PathLike[str]) -> VisualMap:
    """Read a map.

    Raises
    ------
    ValueError
        If the folder is not that of a map, or it is damaged.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        found = f"the folder has no {FILE}" if Path(folder).is_dir() else "no such folder"
        raise ValueError(f"{folder}: no map ({found}): specify a folder that omnisight map wrote")
    model = read_reconstruction(Path(folder))
    try:
        stored: NDArray[np.uint8] = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{path}: damaged: make the map anew ({error})") from error
    count = len(model.observations)
    if stored.dtype != np.uint8 or stored.ndim != 2 or len(stored) != count or stored.shape[1] > MAX_DESCRIPTOR_LENGTH:
        raise ValueError(f"{path}: {stored.dtype} {stored.shape}, expected uint8 ({count}, D): make the map anew")
    descriptors = stored.astype(np.float32)
    descriptors /= np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1.0)
    return VisualMap(model, descriptors)
