"""Structure from motion: the counterpart of `omnisight reconstruct`."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, compress
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.pipeline.batch.peak_memory import peak_memory_bytes
from omnisight.pipeline.inputs.camera_sources import AnyCameraSource, CameraSources, RigSource
from omnisight.pipeline.inputs.image_set import ImageSet, image_set
from omnisight.pipeline.inputs.work_folder import WorkFolder
from omnisight.pipeline.reconstruction.detected_images import DetectedImages, detect_images
from omnisight.pipeline.reconstruction.metric_world import MetricWorld
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult
from omnisight.pipeline.reconstruction.self_calibration import CONVERGED_RAD, MAX_ROUNDS
from omnisight.pipeline.reconstruction.stored_stages import match, similar
from omnisight.pipeline.reconstruction.unregistered_images import unregistered_images
from omnisight.progress import Progress, no_progress
from omnisight.rig import Rig
from omnisight.sfm.calibration_check import FocalLengthChange, focal_length_changes
from omnisight.sfm.colmap_mapper import Mapper, map_images_with_colmap, require_pycolmap
from omnisight.sfm.common_extrinsics import with_common_extrinsics
from omnisight.sfm.contradicted_edges import without_contradicted_edges
from omnisight.sfm.extrinsics import estimate_extrinsics
from omnisight.sfm.georeference import Georeference
from omnisight.sfm.map import Map
from omnisight.sfm.mapping import map_images, refine_with_ray_cameras
from omnisight.sfm.reconstruction import Reconstruction
from omnisight.sfm.result import build_reconstruction, covariances
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.scale_averaging import PointDistances
from omnisight.sfm.view_graph import Edge, ViewGraph, match_pairs, overlapping_pairs

Pairs = list[tuple[int, int]]

# Images up to which all pairs are compared by their strongest keypoints, and, beyond, number of the most similar images
# that each is matched with: retrieval then finds 98 % or more of the overlapping pairs. Images in the order of a path
# need it for loops only.
MAX_EXHAUSTIVE, NEIGHBOURS, LOOP_NEIGHBOURS = 40, 20, 10
NEEDS_SCALE = (
    "the rays of a non-central camera have different origins, so the model must be in metres: specify --scale,"
    " --positions, or a rig of cameras that are apart; or use the central camera, of --model auto"
)
# Mappers of COLMAP by the engine.
MAPPERS: dict[str, Mapper] = {"colmap": "incremental", "colmap-global": "global"}


def reconstruct(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    camera: AnyCameraSource | Mapping[str, AnyCameraSource] | None = None,
    rig: RigSource | None = None,
    options: ReconstructOptions = ReconstructOptions(),
    progress: Progress = no_progress,
    work: str | PathLike[str] | None = None,
) -> ReconstructionResult:
    """Estimate the poses of images and the points that they show.

    Keypoints of pairs of images are matched and relative poses estimated; orientations and positions of all images are
    averaged over the pairs; points are triangulated, and refined with the poses by bundle adjustment.

    Parameters
    ----------
    images
        Folder, or image files. The sub-folders of a folder without images of its own are searched too.
    camera
        The camera of all images, or its calibration file of any format; or several by name, where the path of each
        image contains the name of its camera, as a folder or in the file name. It may be omitted for equirectangular
        images of 360° x 180°, which are twice as wide as high. A non-central camera needs a model in metres.
    rig
        In place of `camera`: the cameras and their poses on one rigid body, or the file. Images of its cameras with the
        same name or number were taken at the same time.
    options
        Options of the command.
    progress
        Called with the stage, the work done and the total.
    work
        Folder for keypoints, pairs and relative poses: after an interruption, the same call continues with them. It can
        be deleted afterwards.

    Returns
    -------
    The models: in metres for a rig of cameras that are apart, or with the option `scale` or `positions`; otherwise the
    unit of the world is arbitrary.

    Raises
    ------
    ValueError
        If no image of a camera can be read, a camera does not fit, or COLMAP is the engine and is not installed
        or fails.
    """
    return reconstruct_with_keypoints(images, camera, rig, options, progress, work)[0]


def reconstruct_with_keypoints(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    camera: AnyCameraSource | Mapping[str, AnyCameraSource] | None,
    rig: RigSource | None,
    options: ReconstructOptions,
    progress: Progress,
    work: str | PathLike[str] | None,
) -> tuple[ReconstructionResult, dict[str, Keypoints]]:
    """Return the result of `reconstruct`, and the keypoints of each image by its name that observations refer to."""
    start = time.perf_counter()
    if options.engine in MAPPERS:
        require_pycolmap()
    sources = CameraSources.of(camera, rig, options.extrinsics, options.name)
    files = image_set(images, sources.names, is_rig=sources.is_rigid)
    world = MetricWorld.of(files, sources, options)
    if sources.ray_cameras and not (world.is_known or sources.has_scale):
        raise ValueError(NEEDS_SCALE)
    steps = _ReconstructionSteps(
        files, sources, options, world, progress, WorkFolder(None if work is None else Path(work)), start
    )
    detected, graph, maps = steps.maps(detect_images(files, sources, options, progress, steps.work))
    changes = _focal_length_changes(maps, detected, steps.names)
    maps, georeferences = steps.place(maps, detected, graph)
    models = steps.models(maps, detected)
    result = steps.result(models, georeferences, changes, detected, graph)
    return result, dict(zip(files.names, detected.keypoints, strict=True))


def _focal_length_changes(
    maps: Sequence[Map], detected: DetectedImages, names: Sequence[str]
) -> dict[str, FocalLengthChange]:
    """Return the suspicious changes of the focal lengths of fixed cameras by the largest map."""
    if not maps or detected.free_cameras is not None:
        return {}
    changes = focal_length_changes(maps[0], detected.cameras, detected.keypoints)
    return {name: change for name, change in zip(names, changes, strict=True) if change and change.is_suspicious}


@dataclass(frozen=True)
class _ReconstructionSteps:
    """The steps of the reconstruction of a set of images.

    Attributes
    ----------
    files
        The images.
    sources
        Their cameras.
    options
        Options of the command.
    world
        What determines the metre.
    progress
        Called with the stage, the work done and the total.
    work
        Folder of keypoints, pairs and relative poses.
    start
        Time at which the computation started, seconds.
    """

    files: ImageSet
    sources: CameraSources
    options: ReconstructOptions
    world: MetricWorld
    progress: Progress
    work: WorkFolder
    start: float

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the cameras."""
        return self.sources.names or ("camera",)

    def maps(self, detected: DetectedImages) -> tuple[DetectedImages, ViewGraph, list[Map]]:
        """Map the images; with guessed cameras, repeat it with those of the map until their rays stay the same."""
        graph, maps = self.map(detected)
        for _ in range(MAX_ROUNDS if any(detected.is_guessed) and maps else 0):
            adapted = detected.seen_by(maps[0].cameras)
            if adapted.change_of_rays(detected) <= CONVERGED_RAD:
                break
            detected = adapted
            graph, maps = self.map(detected)
        if self.sources.estimates_extrinsics and maps:
            return self.map_on_estimated_rig(detected, graph, maps[0])
        return detected, graph, maps

    def map(self, detected: DetectedImages) -> tuple[ViewGraph, list[Map]]:
        """Match pairs of images and map them."""
        images = RigImages.of(detected.keypoints, self.files.camera, len(detected.cameras))
        if (free := detected.free_cameras) is not None:
            images = images.with_free_cameras(free, detected.keypoints)
        if self.sources.poses:
            poses = np.array([pose.matrix for pose in self.sources.poses])
            images = images.on_rig(self.files.frame, poses, is_known=True)
        pairs, matching = self.pairs(detected.keypoints, images), partial(self.progress, "matching")
        graph = match(self.work, detected.keypoints, pairs, matching, images.known_pose)
        maps = self.map_graph(detected, images, graph, refines_sensors=self.sources.refines_extrinsics)
        return graph, with_common_extrinsics(maps) if self.sources.refines_extrinsics and len(maps) > 1 else maps

    def map_on_estimated_rig(
        self, detected: DetectedImages, graph: ViewGraph, found: Map
    ) -> tuple[DetectedImages, ViewGraph, list[Map]]:
        """Map the images again, on the rig whose poses a map of independent images determines.

        Cameras that this map has refined are now fixed: at the seam of opposite fisheyes, focal lengths and the
        distance of the cameras have nearly the same effect.
        """
        poses, _ = estimate_extrinsics(found, self.files.frame)
        _check_extrinsics(poses, self.sources.names)
        if found.images.pixels is not None:
            refined = found.images.pixels.free.at(found.values, covariances(found).values)
            detected = replace(detected, cameras=refined)
        images = replace(found.images, pixels=None).on_rig(self.files.frame, poses, is_known=False)
        graph = ViewGraph(_with_known_poses(graph.edges, images, detected.keypoints), graph.compared)
        return detected, graph, self.map_graph(detected, images, graph, refines_sensors=True)

    def map_graph(
        self, detected: DetectedImages, images: RigImages, graph: ViewGraph, *, refines_sensors: bool
    ) -> list[Map]:
        """Map a view graph."""

        def watch(done: int) -> None:
            self.progress("mapping", done, images.frames)

        if self.options.engine in MAPPERS:
            graph = without_contradicted_edges(graph, PointDistances(detected.keypoints), images)
            mapper = MAPPERS[self.options.engine]
            return map_images_with_colmap(images, graph, watch, mapper, refines_sensors=refines_sensors)
        return map_images(detected.keypoints, images, graph, watch, refines_sensors=refines_sensors)

    def place(
        self, maps: list[Map], detected: DetectedImages, graph: ViewGraph
    ) -> tuple[list[Map], tuple[Georeference, ...]]:
        """Bring maps to the known metre, and refine those of non-central cameras, whose rays are known in metres."""
        maps, georeferences = self.world.place(maps)
        if not self.sources.ray_cameras:
            return maps, georeferences
        return self.world.place([self.with_exact_rays(found, detected, graph) for found in maps])

    def with_exact_rays(self, found: Map, detected: DetectedImages, graph: ViewGraph) -> Map:
        """Refine a map with the exact rays of non-central cameras, whose origins are in metres."""
        if not found.has_scale:
            raise ValueError(NEEDS_SCALE)
        watch = partial(self.progress, "refining")
        cameras, keypoints = self.sources.ray_cameras, detected.keypoints
        return refine_with_ray_cameras(found, cameras, keypoints, graph.edges, lambda done: watch(done, done))

    def models(self, maps: Sequence[Map], detected: DetectedImages) -> tuple[Reconstruction, ...]:
        """Return the models of maps with the covariances of their poses."""
        exact = self.sources.ray_cameras or (None,) * len(self.names)
        cameras = tuple(ray or central for ray, central in zip(exact, detected.cameras, strict=True))
        body = Rig(cameras, (Pose(),) * len(cameras), self.names)
        models = list[Reconstruction]()
        for found in maps:
            self.progress("covariances", len(models), len(maps))
            models.append(
                build_reconstruction(
                    found, body, self.files.names, detected.keypoints, detected.colors, self.world.origin
                )
            )
        self.progress("covariances", len(models), len(maps))
        return tuple(models)

    def result(
        self,
        models: tuple[Reconstruction, ...],
        georeferences: tuple[Georeference, ...],
        changes: Mapping[str, FocalLengthChange],
        detected: DetectedImages,
        graph: ViewGraph,
    ) -> ReconstructionResult:
        """Return the models, with the reasons of the images that are in none."""
        unregistered = unregistered_images(self.files, models, detected, graph)
        unreadable = tuple(self.files.names[i] for i in detected.unreadable)
        return ReconstructionResult(
            models,
            len(self.files),
            unregistered,
            unreadable,
            time.perf_counter() - self.start,
            peak_memory_bytes(),
            reason="" if models else next(why for name, why in unregistered.items() if name not in unreadable),
            simultaneous=self.files.rule,
            self_calibrated=tuple(compress(self.names, detected.is_guessed)),
            focal_length_changes=changes,
            georeferences=georeferences,
            other_warnings=self.world.warnings,
            known_poses=self.sources.poses if self.sources.refines_extrinsics else (),
        )

    def pairs(self, keypoints: Sequence[Keypoints], images: RigImages) -> Pairs:
        """Select pairs of images."""
        selecting, are_many = partial(self.progress, "selecting pairs"), len(keypoints) > MAX_EXHAUSTIVE
        if self.options.pairs == "auto" and are_many:
            return similar(self.work, keypoints, NEIGHBOURS, selecting)
        if self.options.pairs == "sequential":
            loops = similar(self.work, keypoints, LOOP_NEIGHBOURS, selecting) if are_many else []
            return sorted({*_near_pairs(images.frame, self.options.window), *loops})
        pairs = list(combinations(range(len(keypoints)), 2))
        return pairs if self.options.pairs == "all" else overlapping_pairs(keypoints, pairs, selecting)


def _near_pairs(frame: NDArray[np.intp], window: int) -> Pairs:
    """Return the pairs of images whose frames (I,) differ by at most a window."""
    order = np.argsort(frame, kind="stable")
    last = np.searchsorted(frame[order], frame[order] + window, side="right")
    return [
        (min(a, b), max(a, b))
        for i, (a, end) in enumerate(zip(order.tolist(), last.tolist(), strict=True))
        for b in order[i + 1 : end].tolist()
    ]


def _check_extrinsics(poses: NDArray[np.float64], names: Sequence[str]) -> None:
    """Raise ValueError if the poses (S, 3, 4) of sensors on a rig are not all known."""
    if unknown := [name for name, pose in zip(names, poses, strict=True) if np.isnan(pose).any()]:
        raise ValueError(
            f"the pose of camera {unknown[0]} on the rig is unknown: no image of it is in the largest model together"
            " with an image of another camera taken at the same time; move the rig further, or leave the camera out"
        )


def _with_known_poses(edges: Sequence[Edge], images: RigImages, keypoints: Sequence[Keypoints]) -> list[Edge]:
    """Return the edges, where those between images of one frame have the poses of the rig."""
    together = [(edge.a, edge.b) for edge in edges if images.frame[edge.a] == images.frame[edge.b]]
    others = [edge for edge in edges if images.frame[edge.a] != images.frame[edge.b]]
    return others + match_pairs(keypoints, together, no_progress, images.known_pose).edges
