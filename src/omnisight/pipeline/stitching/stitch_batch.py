"""Spheres of many frames: the counterpart of `omnisight stitch` with workers or URLs."""

import dataclasses
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats import load_rig
from omnisight.images import IMAGE_SUFFIXES, decode_image
from omnisight.images.view_tags import view_tags
from omnisight.pipeline.batch.batch import Batch, BatchResult
from omnisight.pipeline.batch.manifest import output_names
from omnisight.pipeline.batch.storage import file_system, list_images, read_file
from omnisight.pipeline.batch.task import Item, Process, describe
from omnisight.pipeline.inputs.camera_sources import RigSource
from omnisight.pipeline.inputs.image_set import assign_images
from omnisight.pipeline.inputs.work_folder import digest
from omnisight.pipeline.stitching.stitch import StitchResult, stitch_result
from omnisight.pipeline.stitching.stitch_files import StitchedFrames, check_sizes
from omnisight.pipeline.stitching.stitch_inputs import (
    HEAD_NAMES,
    Bytes,
    HeadFrames,
    frames_of_folder,
    frames_of_folders,
    rgb8,
)
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.pipeline.stitching.stitch_plan import plan_frames, sphere_bearings
from omnisight.pipeline.views.view_encoding import encode_view
from omnisight.views.stitching.image_stitcher import ImageStitcher
from omnisight.views.stitching.seam_plan import SeamPlan, plan_stitch


@dataclass(frozen=True, eq=False)
class StitchTask:
    """The sphere of each frame; see `omnisight.pipeline.batch.task.Task`.

    Attributes
    ----------
    seam_plan
        Colours, seams and local warps of the first frame.
    camera
        Equirectangular camera of the spheres.
    sphere_from_rig
        (3, 3) their rotation.
    is_level
        Whether their horizon is level.
    options
        Options of the command.
    """

    seam_plan: SeamPlan
    camera: Camera
    sphere_from_rig: NDArray[np.float64]
    is_level: bool
    options: StitchOptions

    @property
    def description(self) -> dict[str, Any]:
        """What determines the spheres."""
        own = self.seam_plan
        seams = list(own.seams.items())
        plan = digest(own.samplers, own.photometry, seams, self.camera.size, self.sphere_from_rig)
        return describe("stitch", options=self.options, plan_from_the_first_images=plan)

    def prepare(self) -> Process:
        """Return the function from the images of a frame to the file of its sphere; it computes the maps once.

        An item of another group than 0 also has the images of the frame from which its seam is estimated.
        """
        stitchers, count = dict[int, ImageStitcher](), len(self.seam_plan.samplers)

        def stitch(item: Item, data: Sequence[bytes]) -> list[bytes]:
            images = [
                rgb8(decode_image(content, name, apply_exif=self.options.apply_exif))
                for content, name in zip(data, item.names, strict=True)
            ]
            for first in range(0, len(images), count):
                check_sizes(images[first : first + count], self.seam_plan, item.names[first : first + count])
            if item.group not in stitchers:
                stitchers.clear()
                stitchers[item.group] = self.stitcher(images[count:] if item.group else None)
            sphere, heading = stitchers[item.group](images[:count]), self.options.heading
            tags = view_tags(data[0])
            return [encode_view(sphere, item.outputs[0], self.camera, tags, heading=heading, is_level=self.is_level)]

        return stitch

    def stitcher(self, images: Sequence[Bytes] | None) -> ImageStitcher:
        """Return the stitcher of the plan, or of the seams of other images if there are any."""
        plan = self.seam_plan
        if images is not None:
            plan = plan_stitch(plan.samplers_before_warp, images, self.camera.width, warp=self.options.warp)
        return ImageStitcher(plan, sphere_bearings(self.camera, self.sphere_from_rig))


def stitch_batch(
    images: Sequence[str],
    batch: Batch,
    rig: RigSource | None = None,
    cameras: Sequence[Camera | str | PathLike[str]] = (),
    options: StitchOptions = StitchOptions(),
) -> tuple[StitchResult, BatchResult]:
    """Stitch all frames of a folder for each camera, or of one folder, by workers; see `Batch`.

    The spheres are those of `omnisight.stitch`, which this machine estimates from a few frames.

    Parameters
    ----------
    images
        A folder for each camera, or one with the images of all cameras, such as front_1.jpg and back_1.jpg.
    batch
        Its output receives the spheres, which are JPEG files.
    rig, cameras, options
        As of `omnisight.stitch`.

    Raises
    ------
    ValueError
        If images or cameras do not fit, the folders are in different archives, the output holds another run, or the
        cluster cannot be used.
    """
    start = time.perf_counter()
    if batch.output.lower().endswith(IMAGE_SUFFIXES):
        raise ValueError(f"{batch.output}: has the name of an image; choose a folder for the spheres")
    if others := [folder for folder in images if file_system(folder) != file_system(images[0])]:
        raise ValueError(
            f"{images[0]} and {others[0]} are in different archives or storages, and the workers read from one: put"
            " the images of all cameras into the same archive or storage, or extract the archives"
        )
    folders = [list_images(folder, batch.output) for folder in images]
    body = load_rig(Path(rig)) if isinstance(rig, str | PathLike) else rig
    frames = _frames(images, folders, body.names if body else HEAD_NAMES)
    frames = dataclasses.replace(frames, apply_exif=options.apply_exif)
    planned = plan_frames(frames, body, cameras, options)
    task = StitchTask(planned.seam_plan, planned.camera, planned.sphere_from_rig, planned.is_level, options)
    estimated = time.perf_counter()
    versions = dict(item for folder in folders for item in folder.items())
    done = batch.run(task, _items(frames, versions, options.every), images[0])
    own = task.stitcher(None)
    stitched = StitchedFrames(own(planned.first), own.covered, frames.count, ())
    seconds = time.perf_counter()
    return stitch_result(planned, stitched, seconds - start, seconds - estimated), done


def _frames(images: Sequence[str], folders: Sequence[Iterable[str]], names: Sequence[str]) -> HeadFrames:
    """Return the frames of folders in any file system."""
    lists = [[Path(path) for path in folder] for folder in folders]
    if len(lists) > 1:
        frames = frames_of_folders(images, lists)
    else:
        found = assign_images(lists[0], [path.as_posix() for path in lists[0]], names, is_rig=True)
        frames = frames_of_folder(found, images[0], names)

    def read(source: Any, apply_exif: bool) -> NDArray[Any]:
        data = read_file(images[0], Path(source).as_posix())
        return decode_image(data, Path(source).name, apply_exif=apply_exif)

    return dataclasses.replace(frames, read=read)


def _items(frames: HeadFrames, versions: Mapping[str, str], every: int) -> list[Item]:
    """Return an item for each frame, with the frame from which its seam is estimated."""
    sources = [tuple(Path(str(source)).as_posix() for source in frame) for frame in frames.sources]
    outputs = output_names([source[0] for source in sources], ".jpg")
    first = [count // every * every if every else 0 for count in range(len(sources))]
    inputs = [source + (sources[k] if k else ()) for source, k in zip(sources, first, strict=True)]
    return [
        Item(paths, (name,), k, " ".join(versions[path] for path in paths))
        for paths, name, k in zip(inputs, outputs, first, strict=True)
    ]
