"""Progress on stderr."""

import sys

import pytest

from omnisight.cli._progress import progress
from omnisight.compilation import report_compilation


@pytest.mark.parametrize(("is_verbose", "shown"), [(False, "compile code (first run)"), (True, "compile grow")])
def test_compilation_is_shown_with_its_reason(is_verbose, shown, monkeypatch, capsys):
    monkeypatch.setattr("omnisight.cli._progress.is_verbose", lambda: is_verbose)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress() as report:
        report_compilation("grow", None)
        report_compilation("grow", 1.25)
        report("detect boards", 1, 1)
    assert shown in capsys.readouterr().err
