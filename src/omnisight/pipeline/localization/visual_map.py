"""Maps for localization: a reconstruction with the descriptors of its observations, in a folder."""

import io
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from omnisight.images import write_bytes
from omnisight.localization.visual_map import VisualMap
from omnisight.pipeline.inputs.camera_sources import AnyCameraSource, CameraSources, RigSource
from omnisight.pipeline.inputs.image_set import image_set
from omnisight.pipeline.inputs.work_folder import WorkFolder
from omnisight.pipeline.reconstruction.detected_images import detect_images
from omnisight.pipeline.reconstruction.reconstruct import reconstruct
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
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) if work is None else Path(work)
        result = reconstruct(images, camera, rig, options, progress, folder)
        if not result:
            return None, result
        model = result.models[0]
        sources = CameraSources.of(camera, rig, options.extrinsics, options.name)
        files = image_set(images, sources.names, is_rig=sources.is_rigid)
        # The keypoints are those that the reconstruction has left in the work folder.
        detected = detect_images(files, sources, options, progress, WorkFolder(folder))
        descriptors = np.zeros((len(model.observations), detected.keypoints[0].descriptors.shape[1]), np.float32)
        number = {name: k for k, name in enumerate(files.names)}
        for image, name in enumerate(model.names):
            rows = np.flatnonzero(model.observations.image == image)
            keypoints = detected.keypoints[number[name]]
            assert model.observations.keypoint is not None
            descriptors[rows] = keypoints.descriptors[model.observations.keypoint[rows]]
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
    model = read_reconstruction(Path(folder))
    if not path.is_file():
        raise ValueError(f"{folder}: a reconstruction without descriptors: make the map by omnisight map")
    try:
        stored: NDArray[np.uint8] = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{path}: damaged: {error}") from error
    count = len(model.observations)
    if stored.dtype != np.uint8 or stored.ndim != 2 or len(stored) != count or stored.shape[1] > MAX_DESCRIPTOR_LENGTH:
        raise ValueError(f"{path}: {stored.dtype} {stored.shape}, expected uint8 ({count}, D): make the map anew")
    descriptors = stored.astype(np.float32)
    descriptors /= np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1.0)
    return VisualMap(model, descriptors)
