"""The results folder of a run."""

import json
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from ..base import (
    AnyPath,
    FemsealError,
    Mapper,
    comma_separated,
    made_folder,
    read_plain,
    write_bytes,
    write_text,
)
from ..base.files import is_inside
from ..results.dataset import FILE_NAME, save
from ..results.pixel_fields import NAME as FIELDS
from ..results.pixel_fields import plan_fields, write_fields
from ..results.results import Results
from ..results.tables import rows, write_workbook
from ..results.vtk_files import write_vtk
from ..studies.choices import FIELDS_LIMIT
from ..topography import Surface
from .page import FILES, REPORT_NAME, draw_all, write_report

#: Manifest of the files of a run, one a line; the next run removes those that it does not write again.
MANIFEST = "files.txt"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e7
#: Subfolder of the files of a run until all of them are written.
UNFINISHED = ".unfinished"
#: Subfolder of the files for ParaView.
VIEWS = "vtk"


def write_folder(
    results: Results,
    folder: AnyPath,
    surface: Surface | None = None,
    *,
    pictures: bool = True,
    report: bool = True,
    fields: bool = True,
    paraview: str = "vtu",
    fields_limit: float = FIELDS_LIMIT,
    mapper: Mapper = map,
) -> list[Path]:
    """Write `results.nc`, `table.csv`, `table.xlsx`, `report.html`, the pictures, the fields over all pixels and, in
    `vtk/`, files for ParaView.

    They are written into the folder `.unfinished` and take the place of an earlier run's files once all are there,
    `results.nc` last. Files that femseal did not write stay as they are.

    results : of a run; pictures and fields without data are left out.
    folder : made if needed; files of the same name are replaced.
    surface : the combined heights, for `surface.png` and ParaView; None: without.
    pictures, report, fields : False leaves these out; without pictures and report nothing is drawn.
    paraview : "vtu", or "none" without the files in `vtk/`, see `write_vtk`.
    fields_limit : size of the fields over all pixels before compression [byte] above which steps are left out; the
        attribute "left_out" of the dataset then says so.
    mapper : such as over processes of this machine, one of which writes the files for ParaView.

    Returns the paths of all files written, with `files.txt`, which lists them.
    Raises InputError: the folder cannot be made.
    FemsealError : a file could not be written; `.unfinished/results.nc` then holds the results.
    """
    steps, left_out = plan_fields(results, fields_limit if fields else 0.0)
    results.dataset.attrs["left_out"] = json.dumps(left_out if fields else [])

    def write(unfinished: Path) -> list[Path]:
        written = write_fields(results, steps, unfinished) if steps.size else []
        if paraview != "none":
            written += write_vtk(results, surface, unfinished / VIEWS, mapper)
        return written + _write_for_people(results, surface, pictures, report, unfinished)

    return _replaced(results, made_folder(folder), write)


def write_again(
    results: Results,
    surface: Surface | None = None,
    *,
    pictures: bool = True,
    report: bool = True,
    fields: bool = True,
    paraview: str = "vtu",
) -> list[Path]:
    """Write the files of results that were read from a folder there again, but for those that their fields are in.

    Files of fields, and with `paraview` also those in `vtk/`, stay as they are, or are removed with False and "none".
    The other arguments, what is returned and the errors are as in `write_folder`.
    """
    target = Path(results.folder or "")
    heads = {FIELDS: fields, VIEWS: paraview != "none"}
    kept = [
        name
        for name in _former(target)
        if heads.get(Path(name.parts[0]).stem) and (target / name).is_file()
    ]
    if not fields:
        results.dataset.attrs["left_out"] = json.dumps([])
    write = partial(_write_for_people, results, surface, pictures, report)
    return _replaced(results, target, write, kept)


def _replaced(
    results: Results,
    target: Path,
    write: Callable[[Path], list[Path]],
    kept: Sequence[Path] | None = None,
) -> list[Path]:
    """Write the files of a run, and put them in the place of those of an earlier one but the kept.

    kept : files of the earlier run; its results are then these, and stay until the new ones are complete: nothing else
        keeps them.
    """
    unfinished = target / UNFINISHED
    # files that a link leads to stay
    if unfinished.is_symlink() or unfinished.is_file():
        unfinished.unlink()
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        saved = save(results, unfinished)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    try:
        names = [path.relative_to(unfinished) for path in [*write(unfinished), saved]]
        listed = [*(kept or ()), *names]
        if kept is None:
            (target / FILE_NAME).unlink(missing_ok=True)
        former = [name for name in _former(target) if name not in listed]
        _list_files(target, [*listed, *former])
        for name in names:
            if not is_inside(target, name):
                raise FemsealError(
                    f"'{target / name.parent}' is a link to another folder, expected a folder"
                )
            made_folder((target / name).parent)
            os.replace(unfinished / name, target / name)
        if former:
            _remove(target, former)
            _list_files(target, listed)
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise FemsealError(
            f"output folder: {reason}; the computed results are in '{saved}'"
        ) from error
    shutil.rmtree(unfinished, ignore_errors=True)
    return [target / MANIFEST, *(target / name for name in listed)]


def _list_files(folder: Path, names: Iterable[Path]) -> None:
    write_text(folder / MANIFEST, "".join(f"{name.as_posix()}\n" for name in names))


def _write_for_people(
    results: Results, surface: Surface | None, pictures: bool, report: bool, folder: Path
) -> list[Path]:
    """Tables, pictures and report."""
    written = [
        write_text(folder / "table.csv", comma_separated(rows(results))),
        write_workbook(results, folder / "table.xlsx"),
    ]
    drawings = draw_all(results, surface) if pictures or report else {}
    for name in FILES if pictures else ():
        if name in drawings:
            written.append(write_bytes(folder / f"{name}.png", drawings[name]))
    return [*written, write_report(results, folder / REPORT_NAME, drawings)] if report else written


def _former(folder: Path) -> list[Path]:
    """The files that the manifest of an earlier run names; names that lead out of the folder are passed over."""
    try:
        lines = read_plain(folder / MANIFEST, _LARGEST_MANIFEST).decode().splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    names = [Path(line) for line in lines if line and "\0" not in line]
    return [
        name for name in names if name.parts and not name.is_absolute() and ".." not in name.parts
    ]


def _remove(folder: Path, names: Iterable[Path]) -> None:
    """Remove files of an earlier run, and folders that they leave empty.

    A name that leads out of the folder by a link is passed over.
    """
    parents: set[Path] = set()
    for name in names:
        with suppress(OSError):  # no such file, or a name too long to be one
            if is_inside(folder, name):
                (folder / name).unlink()
                parents.update(name.parents)
    for parent in sorted(parents - {Path()}, key=lambda p: -len(p.parts)):
        with suppress(OSError):  # not empty
            (folder / parent).rmdir()
