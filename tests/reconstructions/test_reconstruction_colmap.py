"""COLMAP's files of a reconstruction: what pycolmap reads from them, and the cameras that are refused."""

import dataclasses
import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

from omnisight.reconstructions import ExportOptions, ReconstructionError, export_reconstruction, write_reconstruction
from reconstructing import independent, single, two_fisheyes

MAKERS = {
    "equirectangular": single,
    "fisheye below 90 degrees": lambda: single("narrow_fisheye"),
    "rig": lambda: two_fisheyes("narrow_fisheye"),
    "independent": independent,
}
# In a process of its own: pycolmap and numba in one crash here.
READ_BY_PYCOLMAP = """
import json, sys, numpy, pycolmap
def read(folder):
    model = pycolmap.Reconstruction(folder)
    images, errors = {}, []
    for image in model.images.values():
        for pixel in image.points2D:
            xyz = model.points3D[pixel.point3D_id].xyz
            errors.append(float(numpy.linalg.norm(image.project_point(xyz) - pixel.xy)))
        images[image.name] = [image.cam_from_world().matrix().tolist(), len(image.points2D), image.frame.rig_id]
    rigs = [rig.num_sensors() for rig in model.rigs.values()]
    tracks = {k: sorted([e.image_id, e.point2D_idx] for e in p.track.elements) for k, p in model.points3D.items()}
    points = {k: [p.xyz.tolist(), p.color.tolist(), p.error] for k, p in model.points3D.items()}
    return dict(images=images, errors=errors, rigs=rigs, frames=len(model.frames), points=points, tracks=tracks)
text, binary, again = sys.argv[1:]
pycolmap.Reconstruction(text).write_binary(again)
print(json.dumps([read(text), read(binary)]))
"""


def read_by_pycolmap(*folders):
    """Return what pycolmap reads from the first two folders; the third becomes its own binary file of the first."""
    if importlib.util.find_spec("pycolmap") is None:
        pytest.skip("needs pycolmap")
    completed = subprocess.run(
        [sys.executable, "-c", READ_BY_PYCOLMAP, *map(str, folders)], capture_output=True, text=True, timeout=60
    )
    assert completed.returncode == 0, completed.stderr
    return json.loads(completed.stdout.splitlines()[-1])


@pytest.mark.peer
@pytest.mark.parametrize("name", MAKERS)
def test_pycolmap_reads_text_and_binary(tmp_path, name):
    made = MAKERS[name]()
    folders = [tmp_path / part for part in ("text", "binary", "theirs")]
    folders[2].mkdir()
    export_reconstruction(made, folders[0], ExportOptions("colmap"))
    export_reconstruction(made, folders[1], ExportOptions("colmap_binary"))
    for read in read_by_pycolmap(*folders):
        assert set(read["images"]) == set(made.names)
        for i, image in enumerate(made.names):
            matrix, count, _ = read["images"][image]
            assert np.array(matrix) == pytest.approx(made.cam_from_world(i).matrix, abs=1e-12)
            assert count == (made.observations.image == i).sum()
        lengths = np.linalg.norm(made.observations.residuals, axis=1)
        assert sorted(read["errors"]) == pytest.approx(sorted(lengths.tolist()), abs=1e-6)
        assert len(read["points"]) == len(made.points)
        for key, (xyz, color, error) in read["points"].items():
            k = int(key) - 1
            assert xyz == pytest.approx(made.points.position[k].tolist(), abs=1e-12)
            assert color == made.points.color[k].tolist()
            assert error == pytest.approx(lengths[made.observations.point == k].mean(), abs=1e-9)
            assert len(read["tracks"][key]) == (made.observations.point == k).sum()
        assert read["frames"] == len(made.rig_from_world)
        assert sorted(read["rigs"]) == ([1, 1] if name == "independent" else [len(made.rig)])
    assert (folders[2] / "cameras.bin").stat().st_size > 0
    for file in sorted(folders[2].iterdir()):
        assert file.stat().st_size == (folders[1] / file.name).stat().st_size, file.name


@pytest.mark.peer
def test_the_binary_files_of_cameras_and_rigs_are_those_that_pycolmap_writes(tmp_path):
    folders = [tmp_path / part for part in ("text", "binary", "theirs")]
    folders[2].mkdir()
    export_reconstruction(two_fisheyes("narrow_fisheye"), folders[0], ExportOptions("colmap"))
    export_reconstruction(two_fisheyes("narrow_fisheye"), folders[1], ExportOptions("colmap_binary"))
    read_by_pycolmap(*folders)
    for name in ("cameras.bin", "rigs.bin"):
        assert (folders[1] / name).read_bytes() == (folders[2] / name).read_bytes(), name


def test_the_centre_of_the_first_pixel_is_a_half(tmp_path):
    made = single("pinhole")
    export_reconstruction(made, tmp_path, ExportOptions("colmap"))
    camera = (tmp_path / "cameras.txt").read_text().splitlines()[-1].split()
    assert camera[:4] == ["1", "SIMPLE_PINHOLE", "640", "480"]
    assert list(map(float, camera[5:])) == [320.0, 240.0]
    lines = (tmp_path / "images.txt").read_text().splitlines()
    x, y, point = lines[next(k for k, line in enumerate(lines) if line.endswith("camera/000.png")) + 1].split()[:3]
    assert [float(x), float(y)] == pytest.approx((made.observations.pixels[0] + 0.5).tolist())
    assert int(point) == made.observations.point[0] + 1


@pytest.mark.parametrize("make", [lambda: single("fisheye"), two_fisheyes])
def test_a_fisheye_past_90_degrees_is_refused_with_advice(tmp_path, make):
    with pytest.raises(ReconstructionError, match=r"sees up to 95 degrees .* --to splat"):
        export_reconstruction(make(), tmp_path / "out", ExportOptions("colmap"))
    assert not (tmp_path / "out").exists()


def test_the_folder_of_a_reconstruction_has_colmap_text_where_possible(tmp_path):
    write_reconstruction(tmp_path, single())
    assert {path.name for path in (tmp_path / "colmap").iterdir()} >= {"cameras.txt", "rigs.txt", "points3D.txt"}
    write_reconstruction(tmp_path, single("fisheye"))
    assert not list((tmp_path / "colmap").iterdir())


def test_names_with_spaces_are_refused_in_text_and_kept_in_binary(tmp_path):
    made = single("narrow_fisheye")
    made = dataclasses.replace(made, names=tuple(f"IMG {i}.jpg" for i in range(len(made))))
    with pytest.raises(ReconstructionError, match=r"'IMG 0\.jpg' has a space in its name.*--to colmap_binary"):
        export_reconstruction(made, tmp_path, ExportOptions("colmap"))
    export_reconstruction(made, tmp_path, ExportOptions("colmap_binary"))
    assert b"IMG 0.jpg\0" in (tmp_path / "images.bin").read_bytes()
    write_reconstruction(tmp_path, made)
    assert not (tmp_path / "colmap").exists()
