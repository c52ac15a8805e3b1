"""Cameras in PyTorch, against Kornia and PyEquilib, on the GPU if there is one.

Run in an environment of its own: pip install -e . kornia pyequilib torch. A GPU also reports the share of its memory
bandwidth, measured by a copy in the same run.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np
import torch

import omnisight as om
from benchmarks.race import Race, table
from omnisight.torch import Camera, sample

POINTS = 1_000_000
FISHEYE = om.Camera(
    om.model_class("kannala_brandt")(900.0, 900.0, 1919.5, 1079.5, 0.02, -0.005, 0.001, 0.0), (3840, 2160)
)


def main(arguments: list[str]) -> None:
    """Print the tables of projections and of remaps."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks torch", description=__doc__)
    parser.add_argument("--runs", type=int, default=9, help="timed runs, of which the median counts")
    parser.add_argument("--compile", action="store_true", help="also compile both, which first takes minutes")
    options = parser.parse_args(arguments)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.set_num_threads(2)
    name = torch.cuda.get_device_name() if device == "cuda" else "CPU, two threads"
    print(f"PyTorch {torch.__version__}, {name}, float32, medians of {options.runs} alternating runs\n")
    races = [*projections(device, options), *remaps(device, options)]
    print(table(races))
    works = ("project 1 M, ", "fisheye 4K to 4K perspective")
    project, remap = (min(r.ours for r in races if r.work.startswith(work) and "kept" not in r.work) for work in works)
    print(f"\nproject: {POINTS / project / 1e6:.0f} M points/s; 4K remap: {1 / remap:.0f} images/s")
    print(f"memory bandwidth used by project: {bandwidth_share(project, device, options.runs):.0%}")


def projections(device: str, options: argparse.Namespace) -> list[Race]:
    """Compare projections of a million points with Kornia, with and without derivatives."""
    from kornia.geometry.camera import project_points_z1
    from kornia.geometry.camera.distortion_kannala_brandt import distort_points_kannala_brandt

    rng = np.random.default_rng(0)
    points = torch.tensor(
        rng.normal(size=(POINTS, 3)) * (0.5, 0.5, 0.1) + (0, 0, 1.5), dtype=torch.float32, device=device
    )
    camera = Camera(FISHEYE, device=device)
    params = torch.tensor(FISHEYE.model.params, dtype=torch.float32, device=device)

    def theirs(points: torch.Tensor = points, params: torch.Tensor = params) -> torch.Tensor:
        return distort_points_kannala_brandt(project_points_z1(points), params)

    def ours(points: torch.Tensor = points, camera: Camera = camera) -> torch.Tensor:
        return camera.project(points)[0]

    def derivatives(project: Callable[[torch.Tensor], torch.Tensor]) -> None:
        at = points.detach().requires_grad_(True)
        project(at).sum().backward()

    gap = (ours() - theirs()).abs().max().item()
    theirs_trained = params.clone().requires_grad_(True)
    kinds = [("", ours, theirs)]
    if options.compile:
        fused = Camera(FISHEYE, device=device)
        fused.compile()
        kinds.append((", compiled", partial(ours, camera=fused), torch.compile(theirs)))
    races: list[Race] = []
    for label, mine, other in kinds:
        with torch.no_grad():
            work = f"project 1 M, Kannala-Brandt{label}"
            races.append(race(work, mine, other, "Kornia", options, device, f"equal to {gap:.0e} px"))
        races.append(
            race(
                f"project 1 M and derivatives{label}",
                lambda mine=mine: derivatives(mine),
                lambda other=other: derivatives(lambda at: other(at, theirs_trained)),
                "Kornia",
                options,
                device,
            )
        )
    return races


def remaps(device: str, options: argparse.Namespace) -> list[Race]:
    """Compare a perspective view of a panorama with PyEquilib, and views of a fisheye with Kornia."""
    from equilib import equi2pers
    from kornia.geometry.camera.distortion_kannala_brandt import distort_points_kannala_brandt
    from kornia.geometry.transform import remap

    sphere, view = Camera(om.sphere(4096), device=device), Camera(om.perspective((1920, 1080), 90), device=device)
    image = torch.rand(1, 3, 2048, 4096, device=device)
    rotation = torch.tensor(om.look(yaw=30, pitch=10), dtype=torch.float32, device=device)
    rots = [{"roll": 0.0, "pitch": np.radians(10), "yaw": np.radians(30)}]
    fisheye, target = Camera(FISHEYE, device=device), Camera(om.perspective((3840, 2160), 100), device=device)
    params = torch.tensor(FISHEYE.model.params, dtype=torch.float32, device=device)
    large = torch.rand(1, 3, 2160, 3840, device=device)

    def theirs_mapped(pixels: torch.Tensor) -> torch.Tensor:
        u, v = pixels.unbind(-1)
        return remap(large, u[None], v[None], align_corners=True)

    def theirs() -> torch.Tensor:
        bearings = (target.grid() - torch.stack([target.cx, target.cy]).float()) / target.fx.float()
        return theirs_mapped(distort_points_kannala_brandt(bearings, params))

    def ours(fisheye: Camera = fisheye) -> torch.Tensor:
        return fisheye.remap(large, target, antialias=False)[0]

    with torch.no_grad():
        pixels, valid = fisheye.map(target)
        kept = torch.nan_to_num(pixels)
        gap = (ours() - theirs())[..., valid].abs().max().item()
        races = [
            race(
                "sphere 4K to 1080p perspective",
                lambda: sphere.remap(image, view, rotation, antialias=False),
                lambda: equi2pers(image, rots, 1080, 1920, 90.0, mode="bilinear"),
                "PyEquilib",
                options,
                device,
            ),
            race(
                "fisheye 4K to 4K perspective, map kept",
                lambda: sample(large, pixels[None], valid),
                lambda: theirs_mapped(kept),
                "Kornia (grid_sample)",
                options,
                device,
            ),
        ]
        kinds = [("", ours, theirs)]
        if options.compile:
            fused = Camera(FISHEYE, device=device)
            fused.compile()
            kinds.append((", compiled", partial(ours, fused), torch.compile(theirs)))
        for label, mine, other in kinds:
            work, note = f"fisheye 4K to 4K perspective{label}", f"equal to {gap:.0e}"
            races.append(race(work, mine, other, "Kornia (grid_sample)", options, device, note))
        return races


def race(
    work: str,
    ours: Callable[[], object],
    theirs: Callable[[], object],
    peer: str,
    options: argparse.Namespace,
    device: str,
    note: str = "",
) -> Race:
    """Run both to warm up, then alternately; wait for the device after each."""
    times: list[list[float]] = [[], []]
    for k in range(options.runs + 1):
        for function, taken in zip((ours, theirs), times, strict=True):
            seconds = timed(function, device)
            if k:
                taken.append(seconds)
    return Race(work, median(times[0]), median(times[1]), peer, 1.0, note)


def timed(function: Callable[[], object], device: str) -> float:
    start = time.perf_counter()
    function()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - start


def bandwidth_share(seconds: float, device: str, runs: int) -> float:
    """Return the share of the bandwidth of a copy that reading points and writing pixels and masks needs."""
    source = torch.rand(64 << 20, device=device)
    target = torch.empty_like(source)
    copy = median(timed(lambda: target.copy_(source), device) for _ in range(runs + 1))
    per_second = 2 * source.numel() * 4 / copy
    return POINTS * (3 * 4 + 2 * 4 + 1) / seconds / per_second
