"""Options of `calibrate_rig`.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass, fields
from pathlib import Path

from omnisight.calibration.estimation_options import EstimationOptions
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.pipeline.detection.image_options import ImageOptions
from omnisight.pipeline.inputs.named_files import named_files


@dataclass(frozen=True, kw_only=True)
class CalibrateRigOptions(ImageOptions, EstimationOptions):
    """Options of `calibrate_rig`.

    Attributes
    ----------
    target
        File that describes a board, instead of pattern and square, as of `detect`; repeat it for each of several boards
        that are in view at the same time.
    model
        Camera model of all cameras, as of `calibrate`; auto selects one for each camera.
    camera
        Known camera, NAME=FILE, whose parameters are constant; may be repeated.
    refine_cameras
        Refine known cameras too, starting from their files.
    times
        CSV file with the columns camera,frame,seconds: when each image was taken; a frame is the name or number of an
        image, or the number of a frame of a clip. By default simultaneous images have the same file name or number, or
        the same place in the order of the names.
    reference
        Name of the camera whose frame is the rig frame; the first by default.
    drop
        Name of an image to leave out, as in the table; may be repeated.
    """

    target: tuple[Path, ...] = ()
    model: str = "auto"
    camera: tuple[str, ...] = ()
    refine_cameras: bool = False
    times: Path | None = None
    reference: str | None = None
    drop: tuple[str, ...] = ()

    @property
    def camera_files(self) -> dict[str, Path]:
        """File of each known camera by name.

        Raises
        ------
        ValueError
            If an entry is not NAME=FILE, or a name occurs twice.
        """
        return named_files(self.camera)

    @property
    def targets(self) -> dict[str, Path | None]:
        """File of each board by name: that of the file; one board without a file if none is specified.

        Raises
        ------
        ValueError
            If a pattern is specified too, or a file is specified twice.
        """
        if not self.target:
            return {"board": None}
        self.check_one_board()
        names = [path.stem for path in self.target]
        if len(set(names)) < len(names):
            names = [path.as_posix() for path in self.target]
        if repeated := [name for k, name in enumerate(names) if name in names[:k]]:
            raise ValueError(f"--target {repeated[0]}: specified twice; each board needs a file of its own")
        return dict(zip(names, self.target, strict=True))

    def single(self, target: Path | None = None) -> CalibrateOptions:
        """Return the options to calibrate one of the cameras alone, from one of the boards."""
        names = {f.name for f in fields(ImageOptions)} | {f.name for f in fields(EstimationOptions)}
        return CalibrateOptions(model=self.model, target=target, **{name: getattr(self, name) for name in names})
