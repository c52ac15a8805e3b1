"""nerfstudio's transforms.json of the true poses, with points of the surfaces."""

from collections.abc import Iterator, Sequence

from omnisight.reconstructions import ExportOptions, get_reconstruction_format
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import ExportFile, SimulatedSequence
from omnisight.simulation.exports._true_model import check_format, true_model

DESCRIPTION = """\
nerfstudio/  transforms.json of the true poses, for nerfstudio and instant-ngp, in the world frame of poses.txt;
             sparse_pc.ply has true points, images/ links to the images.
"""
NEEDS_IMU, NEEDS_SAMPLES = False, True


def check(cameras: Sequence[MountedCamera]) -> None:
    """Check that nerfstudio has models of the cameras."""
    check_format("nerfstudio", cameras)


def files(sequence: SimulatedSequence) -> Iterator[ExportFile]:
    """Return transforms.json, the points and the images."""
    model = get_reconstruction_format("nerfstudio").files(true_model(sequence), ExportOptions(format="nerfstudio"))
    yield from ((f"nerfstudio/{name}", data) for name, data in model)
    yield from sequence.images("nerfstudio/images")
