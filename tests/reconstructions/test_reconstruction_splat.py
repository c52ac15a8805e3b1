"""Perspective views of a reconstruction for Gaussian splatting."""

import dataclasses
import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

from omnisight.images import read_image, write_image
from omnisight.pipeline.batch.batch import Batch
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.views.export_batch import export_batch
from omnisight.reconstructions import ExportOptions, ReconstructionError, export_reconstruction, write_reconstruction
from reconstructing import independent, paint, single, two_fisheyes

MAKERS = {"equirectangular": single, "rig": two_fisheyes, "independent": independent}
# In a process of its own: pycolmap and numba in one crash here.
READ_BY_PYCOLMAP = """
import json, sys, numpy, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
images = {}
for image in model.images.values():
    errors = [
        float(numpy.linalg.norm(image.project_point(model.points3D[p.point3D_id].xyz) - p.xy)) for p in image.points2D
    ]
    every = [[k, image.project_point(p.xyz)] for k, p in model.points3D.items()]
    pixels = {int(k): list(map(float, xy)) for k, xy in every if xy is not None}
    images[image.name] = [errors, image.camera.model.name, image.camera.width, image.camera.height, pixels]
print(json.dumps([images, sorted(rig.num_sensors() for rig in model.rigs.values()), len(model.frames)]))
"""


@pytest.mark.peer
@pytest.mark.parametrize("name", MAKERS)
def test_pycolmap_projects_the_points_to_where_the_views_show_them(tmp_path, name):
    if importlib.util.find_spec("pycolmap") is None:
        pytest.skip("needs pycolmap")
    made, out = MAKERS[name](), tmp_path / "out"
    export_reconstruction(made, out, ExportOptions("splat", paint(made, tmp_path / "images"), 256))
    completed = subprocess.run(
        [sys.executable, "-c", READ_BY_PYCOLMAP, str(out / "sparse/0")], capture_output=True, text=True, timeout=60
    )
    assert completed.returncode == 0, completed.stderr
    images, rigs, frames = json.loads(completed.stdout.splitlines()[-1])
    assert set(images) == {path.name for path in (out / "images").iterdir()}
    assert {f"{image}.png" for image in images} == {path.name for path in (out / "masks").iterdir()}
    assert frames == len(made.rig_from_world)
    assert len(rigs) == (2 if name == "independent" else 1)
    observed = sum(len(errors) for errors, *_ in images.values())
    assert observed >= 0.98 * len(made.observations)
    hits = []
    for image, (errors, model, width, height, pixels) in images.items():
        assert model in ("PINHOLE", "SIMPLE_PINHOLE")
        assert max(errors, default=0) < 3
        view, mask = read_image(out / "images" / image), read_image(out / "masks" / f"{image}.png")
        assert view.shape == (height, width, 3)
        assert mask.shape == (height, width)
        for u, v in pixels.values():
            row, column = int(v), int(u)  # COLMAP's pixel (0, 0) reaches from 0 to 1
            if 0 <= u < width and 0 <= v < height and mask[row, column]:
                hits.append(view[row, column].min() > 100)
    assert len(hits) > 3 * len(made.points)
    assert np.mean(hits) > 0.97


def test_a_narrow_camera_has_one_view_and_a_sphere_six(tmp_path):
    made = independent()
    export_reconstruction(made, tmp_path / "out", ExportOptions("splat", paint(made, tmp_path / "images"), 128))
    names = sorted(path.name for path in (tmp_path / "out" / "images").iterdir())
    assert [name for name in names if name.startswith("pinhole_001")] == ["pinhole_001_front.jpg"]
    assert len([name for name in names if name.startswith("equirectangular_000")]) == 6


def test_the_masks_of_a_fisheye_end_at_its_calibrated_field_of_view(tmp_path):
    made = single("fisheye")
    export_reconstruction(made, tmp_path / "out", ExportOptions("splat", paint(made, tmp_path / "images"), 200))
    masks = {path.name.split("_")[-1][:-8]: read_image(path) > 0 for path in (tmp_path / "out" / "masks").glob("*0_*")}
    assert set(masks) == {"front", "left", "right", "up", "down"}
    assert masks["front"].all()
    # The right face covers 45 to 135 degrees along its middle row; the camera ends at 95.
    middle = np.flatnonzero(masks["right"][100])
    assert middle[0] == 0
    assert middle[-1] == pytest.approx(99.5 + 100 * np.tan(np.radians(95 - 90)), abs=1)


def test_the_mask_without_a_calibrated_field_of_view_is_the_image_circle(tmp_path):
    made = single("fisheye")
    camera = dataclasses.replace(made.rig.cameras[0], theta_max=None)
    made = dataclasses.replace(made, rig=dataclasses.replace(made.rig, cameras=(camera,)))
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    lit = np.hypot(u - camera.model.cx, v - camera.model.cy) < 200
    for name in made.names:
        (tmp_path / "images" / name).parent.mkdir(parents=True, exist_ok=True)
        write_image(tmp_path / "images" / name, np.where(lit, 180, 5).astype(np.uint8))
    export_reconstruction(made, tmp_path / "out", ExportOptions("splat", tmp_path / "images", 200))
    paths = sorted((tmp_path / "out" / "masks").iterdir())
    assert len(paths) == 5 * len(made.names)
    for path in paths:
        view, mask = read_image(tmp_path / "out" / "images" / path.name[:-4]), read_image(path) > 0
        assert (view[mask] > 90).mean() > 0.98
        if "front" not in path.name:
            assert (view[~mask] < 90).mean() > 0.97


def test_missing_images_are_refused_before_anything_is_written(tmp_path):
    made = single()
    with pytest.raises(ReconstructionError, match="--images"):
        export_reconstruction(made, tmp_path / "out", ExportOptions("splat"))
    images = paint(made, tmp_path / "images")
    (images / made.names[2]).unlink()
    with pytest.raises(ReconstructionError, match="1 of 6 images are not in"):
        export_reconstruction(made, tmp_path / "out", ExportOptions("splat", images))
    with pytest.raises(ReconstructionError, match="--size must be"):
        export_reconstruction(single(), tmp_path / "out", ExportOptions("splat", paint(made, images), 3))
    assert not (tmp_path / "out").exists()


def test_views_are_not_written_among_the_images(tmp_path):
    made = single()
    images = paint(made, tmp_path / "images")
    before = sorted(images.iterdir())
    with pytest.raises(ReconstructionError, match=r"images: is the folder of the images"):
        export_reconstruction(made, tmp_path, ExportOptions("splat", images, 64))
    write_reconstruction(tmp_path / "model", made)
    with pytest.raises(ValueError, match=r"images: is the folder of the images"):
        export_batch(tmp_path / "model", str(images), Batch(str(tmp_path), BatchOptions(workers=1)), 64)
    assert sorted(images.iterdir()) == before
