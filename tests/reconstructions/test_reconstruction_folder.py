"""The folder of a reconstruction: what is written reads back, and damaged files are refused."""

import csv
import dataclasses
import io
import json
import zipfile

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnisight.reconstructions import ReconstructionError, read_reconstruction, write_reconstruction
from omnisight.reconstructions.native import ARRAYS, FILE, TEXT_FILE
from reconstructing import independent, single, two_fisheyes

MAKERS = {"single": single, "rig": two_fisheyes, "independent": independent}


@pytest.mark.parametrize("name", MAKERS)
def test_a_reconstruction_reads_back_unchanged(tmp_path, name):
    made = MAKERS[name]()
    made = dataclasses.replace(made, unverified=made.names[-1:])
    write_reconstruction(tmp_path / "model", made)
    again = read_reconstruction(tmp_path / "model")
    assert again.names == made.names
    assert again.unverified == made.unverified
    assert again.has_scale is made.has_scale
    assert again.rig.names == made.rig.names
    assert again.rig_from_world == made.rig_from_world
    for camera, other in zip(again.rig.cameras, made.rig.cameras, strict=True):
        assert camera.model == other.model
        assert camera.size == other.size
    for pose, other in zip(again.rig.sensor_from_rig, made.rig.sensor_from_rig, strict=True):
        assert pose.matrix == pytest.approx(other.matrix, abs=1e-15)
    for part in ("sensor", "frame", "pose_covariance"):
        np.testing.assert_array_equal(getattr(again, part), getattr(made, part))
    for part in ("points", "observations"):
        for field in dataclasses.fields(getattr(made, part)):
            ours, theirs = getattr(getattr(again, part), field.name), getattr(getattr(made, part), field.name)
            if field.name == "keypoint":  # of no use without the keypoints
                assert ours is None
                continue
            np.testing.assert_array_equal(ours, theirs)
            assert ours.dtype == theirs.dtype


def test_numpy_reads_the_arrays(tmp_path):
    made = single()
    write_reconstruction(tmp_path, made)
    with np.load(tmp_path / FILE, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["position"], made.points.position)


def test_the_files_are_the_same_in_every_run(tmp_path):
    write_reconstruction(tmp_path / "a", single())
    files = write_reconstruction(tmp_path / "b", single())
    assert len(files) >= 4
    for file in files:
        assert file.read_bytes() == (tmp_path / "a" / file.relative_to(tmp_path / "b")).read_bytes()


def test_poses_csv_has_the_poses_of_the_cameras_in_the_world(tmp_path):
    made = two_fisheyes()
    write_reconstruction(tmp_path, made)
    text = (tmp_path / "poses.csv").read_text(encoding="utf-8")
    assert text.splitlines()[0] == "name,x,y,z,qx,qy,qz,qw"
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["name"] for row in rows] == list(made.names)
    for i, row in enumerate(rows):
        rotation = Rotation.from_quat([float(row[key]) for key in ("qx", "qy", "qz", "qw")]).as_matrix()
        position = np.array([float(row[key]) for key in "xyz"])
        in_camera = (made.points.position - position) @ rotation
        assert in_camera == pytest.approx(made.cam_from_world(i) @ made.points.position, abs=1e-12)


def test_points_ply_has_the_points_and_their_colours(tmp_path):
    made = single()
    write_reconstruction(tmp_path, made)
    header, _, body = (tmp_path / "points.ply").read_bytes().partition(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")
    assert f"element vertex {len(made.points)}\n".encode() in header
    vertices = np.frombuffer(body, [("xyz", "<f8", 3), ("rgb", "u1", 3)])
    np.testing.assert_array_equal(vertices["xyz"], made.points.position)
    np.testing.assert_array_equal(vertices["rgb"], made.points.color)


def test_a_missing_folder_and_a_folder_without_reconstruction_are_reported(tmp_path):
    with pytest.raises(ReconstructionError, match="no such folder"):
        read_reconstruction(tmp_path / "none")
    with pytest.raises(ReconstructionError, match=r"it has no reconstruction\.npz"):
        read_reconstruction(tmp_path)


def rewrite(path, change, compression=zipfile.ZIP_STORED):
    """Rewrite the members of a file: name -> bytes."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


def array_bytes(array):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def changed_text(**values):
    def change(members):
        members[TEXT_FILE] = json.dumps(json.loads(members[TEXT_FILE]) | values).encode()

    return change


def changed_array(name, make):
    def change(members):
        array = np.load(io.BytesIO(members[f"{name}.npy"]))
        members[f"{name}.npy"] = array_bytes(make(array))

    return change


DAMAGE = {
    "no text": (lambda members: members.pop(TEXT_FILE), "reconstruction.json missing"),
    "no array": (lambda members: members.pop("color.npy"), "color.npy missing"),
    "other format": (changed_text(format="x"), "format"),
    "newer": (changed_text(version=99), "version 99"),
    "no rig": (changed_text(rig=None), "format"),
    "path out of the folder": (changed_text(names=["../a", *"bcdef"]), "not relative"),
    "absolute path": (changed_text(names=["/etc/a", *"bcdef"]), "not relative"),
    "same names": (changed_text(names=["a"] * 6), "same name"),
    "too few names": (changed_text(names=["a"]), "sensor has the shape"),
    "names are numbers": (changed_text(names=[1] * 6), "texts"),
    "point out of range": (changed_array("point", lambda a: a + 1000), "point must lie"),
    "negative image": (changed_array("image", lambda a: a - 1), "image must lie"),
    "other type": (changed_array("position", lambda a: a.astype("f4")), "position must be"),
    "objects": (changed_array("position", lambda a: a.astype(object)), "position must be"),
    "not finite": (changed_array("position", lambda a: a * np.nan), "finite"),
    "no rotation": (changed_array("rig_from_world", lambda a: 2 * a), "rotation"),
    "mirrored": (changed_array("rig_from_world", lambda a: -a), "rotation"),
    "too few residuals": (changed_array("residuals", lambda a: a[:-1]), "residuals has the shape"),
    "cut off": (lambda members: members.update({"position.npy": members["position.npy"][:-8]}), "claims"),
    "empty array": (lambda members: members.update({"position.npy": b""}), "reconstruction.npz"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_file_is_refused_with_its_name(tmp_path, name):
    write_reconstruction(tmp_path, single())
    change, message = DAMAGE[name]
    rewrite(tmp_path / FILE, change)
    with pytest.raises(ReconstructionError, match=message) as caught:
        read_reconstruction(tmp_path)
    assert str(tmp_path / FILE) in str(caught.value)


def test_a_compressed_file_is_refused(tmp_path):
    write_reconstruction(tmp_path, single())
    rewrite(tmp_path / FILE, lambda members: None, zipfile.ZIP_DEFLATED)
    with pytest.raises(ReconstructionError, match="compressed"):
        read_reconstruction(tmp_path)


def test_any_truncation_is_refused(tmp_path):
    write_reconstruction(tmp_path, single())
    data = (tmp_path / FILE).read_bytes()
    assert set(ARRAYS) == {name[:-4] for name in zipfile.ZipFile(tmp_path / FILE).namelist() if name.endswith(".npy")}
    for length in (0, 3, 100, len(data) // 2, len(data) - 1):
        (tmp_path / FILE).write_bytes(data[:length])
        with pytest.raises(ReconstructionError, match="Make it anew with omnisight reconstruct or omnisight map"):
            read_reconstruction(tmp_path)
