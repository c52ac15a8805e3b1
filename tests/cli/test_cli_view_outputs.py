"""Folders in which omnisight view writes."""

import pytest
from cli_scene import file_names

from omnisight.images import read_image, write_image


@pytest.mark.parametrize("inputs", ["folder", "files", "pattern", "folder of one", "workers"])
def test_views_are_not_mixed_with_the_images(refuses, folder, camera_file, inputs):
    """Views are PNG files, and the images here JPEG files: none would be overwritten."""
    for path in list(folder.iterdir()):
        write_image(path.with_suffix(".jpg"), read_image(path))
        path.unlink()
    if inputs == "folder of one":
        for path in sorted(folder.iterdir())[1:]:
            path.unlink()
    before = file_names(folder)
    images = {"files": sorted(folder.iterdir()), "pattern": [folder / "*.jpg"], "workers": [folder / "*.jpg"]}
    workers = ("--workers", 1) if inputs == "workers" else ()
    said = refuses("view", *images.get(inputs, [folder]), "--camera", camera_file, "-o", folder, *workers)
    assert ("is in the folder of the images" if workers else "contains the images") in said
    assert file_names(folder) == before
