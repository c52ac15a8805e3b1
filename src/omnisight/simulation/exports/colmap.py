"""COLMAP's text model of the true poses, with points of the surfaces."""

from collections.abc import Iterator, Sequence

from omnisight.reconstructions import ExportOptions, get_reconstruction_format
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import ExportFile, SimulatedSequence
from omnisight.simulation.exports._true_model import check_format, true_model

DESCRIPTION = """\
colmap/      COLMAP's text model of the true poses in sparse/0, in the world frame of poses.txt, with true
             points and their exact pixels; images/ has links to the images.
"""
NEEDS_IMU, NEEDS_SAMPLES = False, True


def check(cameras: Sequence[MountedCamera]) -> None:
    """Check that COLMAP has models of the cameras."""
    check_format("colmap", cameras)


def files(sequence: SimulatedSequence) -> Iterator[ExportFile]:
    """Return the text files and the images."""
    model = get_reconstruction_format("colmap").files(true_model(sequence), ExportOptions(format="colmap"))
    yield from ((f"colmap/sparse/0/{name}", data) for name, data in model)
    yield from sequence.images("colmap/images")
