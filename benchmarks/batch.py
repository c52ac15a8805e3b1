"""Views of many images: the cost of workers beside a plain loop and FFmpeg's v360, and of interruptions.

The times of a method are measured over all images and over a tenth of them: the difference is the cost of an image
without the start of the processes. The methods alternate, and the costs are medians over `--runs`. `--interrupt` also
kills workers and clients, and compares all bytes.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

import omnisight as om
from benchmarks.batch_interruptions import digests, interrupt_local_cluster, interrupt_scheduler
from omnisight.models.equidistant import Equidistant

ONE_THREAD = {"OMNISIGHT_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1"}
# Number of different images; the others are copies of them.
DIFFERENT = 8
FIELD_OF_VIEW_DEG = 185.0
PLAIN, ONE, ONE_DASK = "plain loop, one thread", "`--workers 1`", "`--cluster local --workers 1`"

# The command that turns the images of a folder into views in another folder.
Method = Callable[[Path, Path], list[str]]


class Cost(NamedTuple):
    """Cost of the views of many images.

    Attributes
    ----------
    rate
        Images per second, with the start of the processes.
    wall_ms, cpu_ms
        Time for another image, ms, and CPU time of all processes.
    start_s
        Time without the images, s.
    """

    rate: float
    wall_ms: float
    cpu_ms: float
    start_s: float


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=2000)
    parser.add_argument("--size", type=int, default=640, help="width of the square fisheye images, px")
    parser.add_argument("--view", type=int, help="width of the views, px; by default that of the images")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--runs", type=int, default=3, help="measurements of each method")
    parser.add_argument("--interrupt", action="store_true", help="kill workers twice and the client once")
    parser.add_argument("--folder", type=Path, help="where the images and views are written for the time of the run")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        measure(Path(folder), options)


def measure(folder: Path, options: argparse.Namespace) -> None:
    """Print a table of costs, and whether all runs wrote the same bytes."""
    print(f"{os.cpu_count()} cores, load before the run {os.getloadavg()[0]:.1f}")
    camera = make_images(folder, options.images, options.size)
    width = options.view or options.size
    view = ["--camera", str(camera), "--size", f"{width}x{width * 3 // 4}", "--interpolation", "bilinear", "--quiet"]
    print(f"| {options.images} images of {options.size} px, views of {width} px | images/s | warm | CPU ms | start s |")
    print("|---|---|---|---|---|")
    compared = methods(view, width, str(options.workers))
    runs = [
        {name: cost_of(method, folder, name, options.images) for name, method in compared.items()}
        for _ in range(options.runs)
    ]
    costs = {name: Cost(*map(median, zip(*(run[name] for run in runs), strict=True))) for name in compared}
    for name, cost in costs.items():
        print(f"| {name} | {cost.rate:.0f} | {1e3 / cost.wall_ms:.0f} | {cost.cpu_ms:.2f} | {cost.start_s:.1f} |")
    for name in (ONE, ONE_DASK):
        wall, cpu = (getattr(costs[name], time) / getattr(costs[PLAIN], time) - 1 for time in ("wall_ms", "cpu_ms"))
        print(f"overhead of {name} for an image: {wall:+.1%} of the time, {cpu:+.1%} of the CPU time")
    expected = digests(folder / PLAIN)
    for name in costs:
        if not name.startswith("ffmpeg"):
            print(f"{name}: {len(expected)} views, equal to those of the loop: {digests(folder / name) == expected}")
    if options.interrupt:
        for interrupt in (interrupt_local_cluster, interrupt_scheduler):
            output = folder / interrupt.__name__
            events = interrupt([*omnisight(folder / "all", output), *view], output, options)
            equal = digests(output) == expected
            print(f"{interrupt.__name__}: {events}; equal to the views of the loop: {equal}", flush=True)
    print(f"load after the run {os.getloadavg()[0]:.1f}")


def methods(view: Sequence[str], width: int, workers: str) -> dict[str, Method]:
    """Return the commands that are compared."""

    def ours(*arguments: str) -> Method:
        return lambda source, output: [*omnisight(source, output), *view, *arguments]

    def ffmpeg(*threads: str) -> Method:
        fov = f"ih_fov={FIELD_OF_VIEW_DEG}:iv_fov={FIELD_OF_VIEW_DEG}:h_fov=90:v_fov=73.7"
        filters = f"v360=fisheye:flat:{fov}:w={width}:h={width * 3 // 4}"
        start = ["ffmpeg", "-loglevel", "error", *threads]
        return lambda source, output: [
            *start,
            "-i",
            f"{source}/%06d.jpg",
            "-vf",
            filters,
            *threads[:2],
            f"{output}/%06d.png",
        ]

    found = {
        PLAIN: ours(),
        ONE: ours("--workers", "1"),
        ONE_DASK: ours("--workers", "1", "--cluster", "local"),
        f"`--workers {workers}`": ours("--workers", workers),
        f"`--cluster local --workers {workers}`": ours("--workers", workers, "--cluster", "local"),
    }
    if shutil.which("ffmpeg"):
        found |= {"ffmpeg v360, one thread": ffmpeg("-threads", "1", "-filter_threads", "1"), "ffmpeg v360": ffmpeg()}
    return found


def omnisight(source: Path, output: Path) -> list[str]:
    """Return the command for views of the images of a folder."""
    return [sys.executable, "-m", "omnisight", "view", str(source), "-o", str(output)]


def make_images(folder: Path, count: int, size: int) -> Path:
    """Write copies of a few noisy fisheye images to all/, as JPEG, and the first tenth to tenth/; return the camera."""
    focal = size / np.radians(FIELD_OF_VIEW_DEG)
    camera = om.Camera(Equidistant(focal, focal, (size - 1) / 2, (size - 1) / 2), (size, size))
    rng, smooth = np.random.default_rng(0), om.sphere(256)
    for name in ("all", "tenth"):
        (folder / name).mkdir()
    for i in range(count):
        file = folder / "all" / f"{i:06}.jpg"
        if i < DIFFERENT:
            texture = rng.integers(0, 256, (smooth.height, smooth.width, 3)).astype(np.uint8)
            om.write_image(file, om.remap(texture, smooth, camera))
        else:
            shutil.copyfile(folder / "all" / f"{i % DIFFERENT:06}.jpg", file)
        if i < count // 10:
            os.link(file, folder / "tenth" / file.name)
    return om.save(camera, folder / "camera.json").path


def cost_of(method: Method, folder: Path, name: str, count: int) -> Cost:
    """Return the cost of a method; its views of all images remain in the folder of its name."""
    shutil.rmtree(folder / name, ignore_errors=True)
    few = timed(method, folder / "tenth", folder / "few")
    shutil.rmtree(folder / "few")
    many = timed(method, folder / "all", folder / name)
    wall, cpu = ((b - a) / (count - count // 10) for a, b in zip(few, many, strict=True))
    return Cost(count / many[0], 1e3 * wall, 1e3 * cpu, many[0] - count * wall)


def timed(method: Method, source: Path, output: Path) -> tuple[float, float]:
    """Return the time and the CPU time, s, of a command with all of its processes."""
    output.mkdir()
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = method(source, output)
    environment = os.environ if "--workers" in command else os.environ | ONE_THREAD
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter() - start, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
