"""Files are written with the usual permissions."""

import os
import sys

import pytest

from femseal.base.files import write_text


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no umask")
@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_file_has_the_usual_permissions(tmp_path, monkeypatch, mask):
    """The mask of the process is not touched: another thread may be making a file."""
    before = os.umask(mask)
    try:
        with monkeypatch.context() as patch:
            patch.delattr(os, "umask")
            path = write_text(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
