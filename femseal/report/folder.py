"""Write the results folder of a run. If the writing is interrupted, earlier results in the folder remain intact."""

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
from ..results.dataset_file import FILE_NAME, save
from ..results.file_options import FIELDS_LIMIT
from ..results.pixel_fields import SERIES_NAME, plan_fields, write_fields
from ..results.results import Results
from ..results.tables import rows, write_workbook
from ..results.vtk_files import write_vtk
from ..topography import Surface
from .page import REPORT_NAME, write_report
from .pictures import FILES, draw_formats

#: File that lists the files of a run, one name per line. The next run in the same folder replaces or removes all files
#: in this list.
FILE_LIST = "files.txt"
#: Largest size of a manifest that is read [byte].
_LARGEST_FILE_LIST = 1e7
#: Subfolder that contains the files of a run until all of them are written.
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
    picture_formats: Sequence[str] = ("png",),
    paraview: str = "vtu",
    fields_limit: float = FIELDS_LIMIT,
    mapper: Mapper = map,
) -> list[Path]:
    """Write all files of a run: results, tables, report, pictures, fields over all pixels, and files for ParaView.

    The files are first written to the subfolder `.unfinished`. When all files are complete, they replace the files of
    an earlier run. The file `results.nc` is replaced last. Files that femseal did not write are not changed.

    Parameters
    ----------
    results : Results
        Results of a run. Pictures and fields are left out if the results have no data for them.
    folder : path
        Folder for the files, which is created if needed.
    surface : Topography or Patches, optional
        Combined heights of the faces, for `surface.png` and the files for ParaView.
    pictures, report, fields : bool
        Whether to write the pictures, the report, and the fields over all pixels.
    picture_formats : sequence of {"png", "svg", "pdf"}
        Formats of the picture files. The pictures on the page of the report are always PNG.
    paraview : {"vtu", "none"}
        Format of the files in `vtk/`, see `write_vtk`.
    fields_limit : float
        Largest size of the fields over all pixels before compression [byte]. If the fields are larger, some load steps
        are left out; the attribute "left_out" of the dataset lists these steps.
    mapper : callable
        Function that applies a stage to its arguments, like the builtin `map`. A mapper that uses several processes
        writes several files at the same time.

    Returns
    -------
    list of Path
        Paths of all files, including the manifest `files.txt`.

    Raises
    ------
    InputError
        The folder cannot be created.
    FemsealError
        A file could not be written. The computed results are in `.unfinished/results.nc`.
    """
    steps, left_out = plan_fields(results, fields_limit if fields else 0.0)
    results.dataset.attrs["left_out"] = json.dumps(left_out if fields else [])

    def write_files(unfinished: Path) -> list[Path]:
        """Write all files except `results.nc` to a folder, and return the paths of the files."""
        written = []
        if steps.size:
            written += write_fields(results, steps, unfinished)
        if paraview != "none":
            written += write_vtk(results, surface, unfinished / VIEWS, mapper)
        formats = picture_formats if pictures else ()
        written += _write_tables_and_pictures(results, surface, formats, report, unfinished)
        return written

    return _replace_files(results, made_folder(folder), write_files)


def write_again(
    results: Results,
    surface: Surface | None = None,
    *,
    pictures: bool = True,
    report: bool = True,
    fields: bool = True,
    picture_formats: Sequence[str] = ("png",),
    paraview: str = "vtu",
) -> list[Path]:
    """Write tables, pictures and report again into the folder from which the results were read.

    The fields over all pixels and the files in `vtk/` cannot be written again, because the results do not contain the
    necessary data. The fields of the earlier run remain in the folder, or are removed if `fields` is False. The files
    in `vtk/` remain in the folder, or are removed if `paraview` is "none". See `write_folder` for the other parameters,
    the returned paths and the errors.
    """
    target = Path(results.folder or "")
    # Fields and files for ParaView are in a folder of this name, or in a .pvd file of this name beside the folder.
    is_kept = {SERIES_NAME: fields, VIEWS: paraview != "none"}
    kept_files = []
    for name in _files_of_earlier_run(target):
        stem = Path(name.parts[0]).stem
        if is_kept.get(stem) and (target / name).is_file():
            kept_files.append(name)
    if not fields:
        # the attribute lists the load steps that the fields leave out; without fields, there are none
        results.dataset.attrs["left_out"] = json.dumps([])
    formats = picture_formats if pictures else ()
    write_files = partial(_write_tables_and_pictures, results, surface, formats, report)
    return _replace_files(results, target, write_files, kept_files)


def _replace_files(
    results: Results,
    target: Path,
    write_files: Callable[[Path], list[Path]],
    kept_files: Sequence[Path] | None = None,
) -> list[Path]:
    """Write the files of a run. When all files are complete, they replace the files of an earlier run.

    Parameters
    ----------
    results : Results
        Results of the run, which are saved before the other files.
    target : Path
        Folder of the run.
    write_files : callable
        Function that takes a folder, writes all files except `results.nc` to this folder, and returns the paths of the
        files.
    kept_files : sequence of Path, optional
        Files of the earlier run that remain in the folder, relative to `target`. If `kept_files` is given, `results`
        were read from this folder, and its file `results.nc` may be their only copy. The file `results.nc` is therefore
        kept until a new file replaces it.

    Returns
    -------
    list of Path
        Paths of all files of the run.
    """
    unfinished = target / UNFINISHED
    # a link with this name is removed, but not the files to which it leads
    if unfinished.is_symlink() or unfinished.is_file():
        unfinished.unlink()
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        saved_results = save(results, unfinished)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    try:
        written = [*write_files(unfinished), saved_results]
        new_files = [path.relative_to(unfinished) for path in written]
        all_files = [*(kept_files or ()), *new_files]
        if kept_files is None:
            # without its results, the earlier run no longer counts as finished while its files are replaced
            (target / FILE_NAME).unlink(missing_ok=True)
        outdated = [name for name in _files_of_earlier_run(target) if name not in all_files]
        # the manifest also lists the outdated files until they are removed, in case their removal is interrupted
        _write_manifest(target, [*all_files, *outdated])
        for name in new_files:
            _move_file(name, unfinished, target)
        if outdated:
            _remove_files(target, outdated)
            _write_manifest(target, all_files)
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise FemsealError(
            f"output folder: {reason}; the computed results are in '{saved_results}'"
        ) from error
    shutil.rmtree(unfinished, ignore_errors=True)
    return [target / FILE_LIST, *(target / name for name in all_files)]


def _move_file(name: Path, source: Path, target: Path) -> None:
    """Move a file from one folder to another.

    Raises FemsealError if the path of the moved file leads out of the target folder or passes a link.
    """
    if not is_inside(target, name):
        parent = target / name.parent
        raise FemsealError(
            f"'{parent}' is outside '{target}' or passes a link, expected a folder inside it"
        )
    made_folder((target / name).parent)
    os.replace(source / name, target / name)


def _write_manifest(folder: Path, names: Iterable[Path]) -> None:
    """Write the names of the files of a run, one per line."""
    write_text(folder / FILE_LIST, "".join(f"{name.as_posix()}\n" for name in names))


def _write_tables_and_pictures(
    results: Results, surface: Surface | None, formats: Sequence[str], report: bool, folder: Path
) -> list[Path]:
    """Write tables, pictures in the given formats and, if requested, the report; return the paths of the files."""
    written = [
        write_text(folder / "table.csv", comma_separated(rows(results))),
        write_workbook(results, folder / "table.xlsx"),
    ]
    needed_formats = set(formats)
    if report:
        needed_formats.add("png")  # the report contains the pictures as PNG
    # contents of the picture files, by name and format
    drawings: dict[str, dict[str, bytes]] = {}
    if needed_formats:
        drawings = draw_formats(results, surface, sorted(needed_formats))
    for name in FILES:
        if name not in drawings:
            continue
        for form in formats:
            written.append(write_bytes(folder / f"{name}.{form}", drawings[name][form]))
    if report:
        as_png = {name: pictures["png"] for name, pictures in drawings.items()}
        written.append(write_report(results, folder / REPORT_NAME, as_png))
    return written


def _files_of_earlier_run(folder: Path) -> list[Path]:
    """Return the files in the manifest of an earlier run. Paths that lead out of the folder are left out."""
    try:
        text = read_plain(folder / FILE_LIST, _LARGEST_FILE_LIST).decode()
    except (OSError, UnicodeDecodeError):
        return []
    names = [Path(line) for line in text.splitlines() if line and "\0" not in line]
    return [
        name for name in names if name.parts and not name.is_absolute() and ".." not in name.parts
    ]


def _remove_files(folder: Path, names: Iterable[Path]) -> None:
    """Remove files of an earlier run, and folders that become empty.

    A file is not removed if its path leads out of the folder or passes a link.
    """
    parents: set[Path] = set()
    for name in names:
        with suppress(OSError):  # the file no longer exists, or the name is too long for a file
            if is_inside(folder, name):
                (folder / name).unlink()
                parents.update(name.parents)
    deepest_first = sorted(parents - {Path()}, key=lambda parent: -len(parent.parts))
    for parent in deepest_first:
        with suppress(OSError):  # the folder is not empty
            (folder / parent).rmdir()
