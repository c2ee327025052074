"""Files have the usual permissions, and paths stay in a folder."""

import os
import sys
from pathlib import Path

import pytest

from femseal.base.files import is_inside, write_text


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


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("new", True),
        ("part/new", True),
        ("none/new", True),
        ("part/../new", False),
        ("../new", False),
        ("..", False),
        ("linked_part/new", False),
        ("elsewhere/new", False),
        # removing or replacing these changes the link itself
        ("elsewhere", True),
        ("linked_file", True),
    ],
)
def test_a_path_stays_in_a_folder_if_it_passes_no_link(tmp_path, name, expected):
    folder = tmp_path / "folder"
    (folder / "part").mkdir(parents=True)
    (folder / "linked_part").symlink_to(folder / "part")
    (folder / "elsewhere").symlink_to(tmp_path)
    (tmp_path / "file").touch()
    (folder / "linked_file").symlink_to(tmp_path / "file")
    assert is_inside(folder, Path(name)) is expected


def test_an_absolute_path_is_not_in_a_folder(tmp_path):
    assert not is_inside(tmp_path, Path(tmp_path.anchor) / "file")
