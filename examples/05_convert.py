"""Convert a camera to other models and write it in every format that can hold it, each with its error."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.conversion import convert_model
from omnisight.formats import FormatError, format_names, get_format
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
setup = fisheye_setup()
camera = setup.camera

for name in ("equidistant", "unified", "eucm", "double_sphere", "mei", "ocam"):
    fitted = convert_model(camera, name, theta_max=setup.theta[1])
    print(
        f"{camera.model.name} as {name:14} {fitted.mean_px:7.4f} px mean, {fitted.max_px:7.4f} px max,"
        f" within 0.5 px up to {np.degrees(fitted.agreement_theta):.0f} degrees"
    )

for name in format_names():
    path = folder / f"fisheye.{name}{get_format(name).SUFFIX}"
    try:
        written = om.save(camera, path, format=name)
    except FormatError as error:
        print(error)
        continue
    print(f"{path.name}: reads back within {written.error_px:.0e} px", *written.notes, sep="; ")
print(f"written to {folder}")
