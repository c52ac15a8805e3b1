"""Interruption of a calibration (Ctrl-C): the best camera fitted so far is kept."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

from omnisight.camera import Camera


class CalibrationInterrupted(KeyboardInterrupt):
    """A calibration was interrupted after its models were fitted, before its accuracy was assessed.

    Attributes
    ----------
    camera
        The camera with the lowest rms so far, with the verdict "do not use", because its accuracy is unknown.
    """

    def __init__(self, camera: Camera) -> None:
        super().__init__("interrupted")
        self.camera = camera


@contextmanager
def keep_camera(best_camera: Callable[[], Camera]) -> Generator[None]:
    """Raise `CalibrationInterrupted` with the best camera so far where an interruption would lose it."""
    try:
        yield
    except KeyboardInterrupt:
        raise CalibrationInterrupted(best_camera()) from None
