"""Messages of names and files that do not exist."""

import pytest

from omnisight.extensions import file_error, no_such_file


@pytest.mark.parametrize(
    ("missing", "closest"),
    [
        ("camra.json", "camera.json"),
        ("camera.jsn", "camera.json"),
        ("camera.yml", "camera.yml2"),
        ("Images", "images"),
        ("none.json", None),
        ("folder/camera.json", None),
    ],
)
def test_a_missing_file_gets_the_closest_name_in_its_folder(tmp_path, missing, closest):
    for name in ("camera.json", "photo.json", "images"):
        (tmp_path / name).touch()
    if closest == "camera.yml2":
        (tmp_path / "camera.yml2").touch()
        (tmp_path / "camera.json").unlink()
    question = f" (did you mean {closest}?)" if closest else ""
    assert no_such_file(tmp_path / missing) == f"no such file or folder{question}"


def test_of_two_files_with_one_stem_that_with_the_extension_is_proposed(tmp_path):
    for name in ("camera.json", "camera.yaml", "camera.xml"):
        (tmp_path / name).touch()
    assert no_such_file(tmp_path / "cameras.yaml").endswith("(did you mean camera.yaml?)")


def test_other_errors_keep_the_reason_of_the_system(tmp_path):
    assert file_error(tmp_path, PermissionError(13, "Permission denied")) == "Permission denied"
    assert file_error(tmp_path / "a", FileNotFoundError(2, "No such file or directory")) == "no such file or folder"
