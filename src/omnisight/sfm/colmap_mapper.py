"""Initial poses of all frames of a view graph by COLMAP's mapper, in place of averaging.

COLMAP has no model of most cameras beyond 90° from the axis. It gets the bearings as pixels of equirectangular images,
with the verified matches and the fixed poses of the sensors on the rig. Triangulation and bundle adjustment follow
here: the maps are the same in form as those of `map_images`.
"""

import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Literal

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import thread_count
from omnisight.sfm._colmap_process import ColmapProblem
from omnisight.sfm.initial_poses import InitialPoses
from omnisight.sfm.map import Map
from omnisight.sfm.mapping import Watch, refine_poses
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import Edge, ViewGraph

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mapper = Literal["incremental", "global"]

PROCESS = "omnisight.sfm._colmap_process"
# Lines of glog that report an error; it writes the severity, the date, the time and the place first.
ERROR_LINE = re.compile(r"^[EF]\d{8} .*?\] (.*)")


class ColmapError(ValueError):
    """COLMAP is not installed, or its process failed."""


def map_images_with_colmap(
    images: RigImages, graph: ViewGraph, watch: Watch, mapper: Mapper = "incremental", *, refines_sensors: bool
) -> list[Map]:
    """Return the maps of the models of COLMAP, the one with most frames first.

    A frame that several models contain belongs to the largest.

    Raises
    ------
    ColmapError
        If COLMAP is not installed or fails.
    """
    maps, is_used = list[Map](), np.zeros(images.frames, bool)
    for frames, poses in colmap_poses(images, graph.edges, watch, mapper):
        is_new = ~is_used[frames]
        if np.isin(images.frame, frames[is_new]).sum() < 2:
            continue
        first = InitialPoses(frames[is_new], poses[is_new])
        found = refine_poses(first, images, graph, watch, refines_sensors=refines_sensors)
        if (found.row_of_image >= 0).sum() > 1:
            maps.append(found.with_verification())
            is_used[found.frames] = True
    return sorted(maps, key=lambda found: -len(found.frames))


def require_pycolmap() -> None:
    """Raise ColmapError if pycolmap is not installed."""
    if importlib.util.find_spec("pycolmap") is None:
        raise ColmapError("the engine colmap needs pycolmap, which is not installed: pip install 'omnisight[colmap]'")


def colmap_poses(
    images: RigImages, edges: Sequence[Edge], watch: Watch, mapper: Mapper = "incremental"
) -> list[tuple[Indices, Array]]:
    """Return frames (F,) and their poses rig_from_world (F, 3, 4) of each model of COLMAP, the largest first."""
    require_pycolmap()
    if not edges:
        return []
    with tempfile.TemporaryDirectory(prefix="omnisight-colmap-") as name:
        folder = Path(name)
        np.savez(folder / "problem.npz", **_problem(images, edges, mapper)._asdict())
        _run(folder, lambda count: watch(min(count, images.frames)))
        with np.load(folder / "poses.npz") as found:
            model, frame, poses = (found[key] for key in ("model", "frame", "rig_from_world"))
    models = list[tuple[Indices, Array]]()
    for number in np.unique(model):
        rows = np.flatnonzero(model == number)
        rows = rows[np.argsort(frame[rows])]
        models.append((frame[rows].astype(np.intp), _relative_to_first(poses[rows])))
    return sorted(models, key=lambda each: -len(each[0]))


def _problem(images: RigImages, edges: Sequence[Edge], mapper: Mapper) -> ColmapProblem:
    """Return keypoints and matches in COLMAP's terms: a pixel has the median standard deviation of the bearings."""
    # The axes have the length 1 / sigma.
    sigma = float(np.median(1.0 / np.maximum(np.linalg.norm(images.axes, axis=2), 1e-300)))
    width = 2 * max(round(np.pi / sigma), 1)
    x, y, z = images.bearings.T
    longitude, latitude = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
    pixels = width * np.column_stack([longitude / (2 * np.pi) + 0.5, latitude / (2 * np.pi) + 0.25])
    return ColmapProblem(
        width=np.array(width),
        pixels=pixels,
        offsets=images.offsets,
        sensor=images.sensor,
        frame=images.frame,
        sensor_from_rig=images.sensor_from_rig,
        ends=np.array([(edge.a, edge.b) for edge in edges], np.intp),
        b_from_a=np.array([edge.b_from_a.matrix for edge in edges]),
        has_translation=np.array([edge.has_translation for edge in edges]),
        starts=np.cumsum([0, *(len(edge.pairs) for edge in edges)]),
        pairs=np.concatenate([edge.pairs for edge in edges]),
        is_global=np.array(mapper == "global"),
        threads=np.array(thread_count()),
    )


def _run(folder: Path, watch: Watch) -> None:
    """Run COLMAP on the problem of a folder.

    Raises
    ------
    ColmapError
        If the process fails or crashes, with the reason.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-P", "-m", PROCESS, str(folder)]
    with tempfile.TemporaryFile("w+") as log:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, env=environment) as process:
            try:
                for line in process.stdout or ():
                    if line.strip().isdigit():
                        watch(int(line))
                status = process.wait()
            except BaseException:  # also Ctrl-C
                process.kill()
                raise
        if status:
            raise ColmapError(f"COLMAP {_end(status)}: {_reason(log)}; use the engine omnisight instead")


def _end(status: int) -> str:
    """Return how a process ended."""
    if status > 0:
        return "failed"
    with suppress(ValueError):
        return f"crashed ({signal.Signals(-status).name})"
    return f"crashed (signal {-status})"


def _reason(log: IO[str]) -> str:
    """Return the last error that COLMAP logged, or the last line."""
    log.seek(0)
    lines = [line.strip() for line in log if line.strip() and not line.lstrip().startswith(("@", "***"))]
    errors = [found[1] for line in lines if (found := ERROR_LINE.match(line))]
    return (errors or lines or ["no reason stated"])[-1]


def _relative_to_first(poses: Array) -> Array:
    """Return poses (F, 3, 4) in the frame of the first."""
    rotations = poses[:, :, :3] @ poses[0, :, :3].T
    return np.concatenate([rotations, poses[:, :, 3:] - rotations @ poses[0, :, 3:]], axis=2)
