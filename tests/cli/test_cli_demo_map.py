"""omnisight demo --map."""

import re
import shlex
from pathlib import Path


def test_the_demo_reconstructs_a_rendered_walk(run, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.demos.demo_map.IMAGE_COUNT", 12)
    monkeypatch.setattr("omnisight.pipeline.demos.demo_map.IMAGE_WIDTH_PX", 512)
    output = tmp_path / "a walk"
    status, out, _ = run("demo", output, "--map")
    assert status == 0
    assert "model       12 of 12 images" in out
    assert float(re.search(r"^positions +error ([\d.]+) mm", out, re.MULTILINE)[1]) < 10
    assert (output / "map" / "viewer.html").as_uri() in out
    assert (output / "map" / "viewer.html").stat().st_size > 10_000
    _, *command = shlex.split(out.splitlines()[-1])
    status, _, err = run(*command)
    assert (status, err) == (0, "")
    assert Path("splat/sparse/0/cameras.bin").stat().st_size > 0
