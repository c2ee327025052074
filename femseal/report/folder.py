"""The results folder of a run."""

from __future__ import annotations

import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from ..base.errors import FemsealError
from ..base.files import is_inside, made_folder, read_plain, replacing, write_text
from ..base.stage import Mapper
from ..results import fields, seal_lengths
from ..results.netcdf import FILE_NAME, save
from ..results.results import Results
from ..results.tables import csv_text
from ..results.vtk import write_vtk
from ..topography import Topography
from . import pictures
from .page import REPORT_NAME, write_report

#: Manifest of the files of a run, one a line; the next run removes those that it does not write again.
MANIFEST = "files.txt"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e7
#: Subfolder of the files of a run until all of them are written.
UNFINISHED = ".unfinished"


def write_folder(
    results: Results,
    folder: str | os.PathLike[str],
    surface: Topography | None = None,
    *,
    paraview: str = "vtu",
    fields_limit: float = fields.LIMIT,
    mapper: Mapper = map,
) -> list[Path]:
    """Write `results.nc`, `table.csv`, `report.html`, the pictures, the fields over all pixels and, in `vtk/`, files
    for ParaView.

    They are written into the folder `.unfinished` and take the place of an earlier run's files once all are there,
    `results.nc` last. Files that femseal did not write stay as they are.

    Parameters
    ----------
    results : of a run; pictures and fields without data are left out.
    folder : made if needed; files of the same name are replaced.
    surface : the combined heights, for `surface.png` and ParaView; None: without.
    paraview : format of the files in `vtk/`, see `write_vtk`.
    fields_limit : size of the fields over all pixels before compression [byte] above which steps are left out; the
        attribute "left_out" of the dataset then says so.
    mapper : draws the pictures; it may use several processes.

    Returns
    -------
    Paths of all files written, with `files.txt`, which lists them.

    Raises
    ------
    InputError : the folder cannot be made.
    FemsealError : a file could not be written; `.unfinished/results.nc` then holds the results.
    """
    target = made_folder(folder)
    plan = fields.plan_fields(results, fields_limit)
    results.dataset.attrs["left_out"] = json.dumps([plan.left_out] if plan.left_out else [])
    unfinished = target / UNFINISHED
    _clear(unfinished)
    try:
        saved = save(results, unfinished)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    try:
        with ThreadPoolExecutor(1) as beside:
            # files are written while processes draw
            files = beside.submit(_write_fields, results, plan, surface, unfinished, paraview)
            written = _write_for_people(results, unfinished, pictures.draw_all(results, surface, mapper=mapper))
            written += [*files.result(), saved]
        names = [path.relative_to(unfinished) for path in written]
        (target / FILE_NAME).unlink(missing_ok=True)
        _remove_former(target)
        write_text(target / MANIFEST, "".join(f"{name.as_posix()}\n" for name in names))
        for name in names:
            if not is_inside(target, name):
                raise FemsealError(f"'{target / name.parent}' is a link to another folder, allowed is a folder")
            made_folder((target / name).parent)
            os.replace(unfinished / name, target / name)
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise FemsealError(f"output folder: {reason}; the computed results are in '{saved}'") from error
    shutil.rmtree(unfinished, ignore_errors=True)
    return [target / MANIFEST, *(target / name for name in names)]


def _write_for_people(results: Results, folder: Path, drawings: pictures.Drawings) -> list[Path]:
    written = [write_text(folder / "table.csv", csv_text(results))]
    if seal_lengths.has_lengths(results):
        written.append(write_text(folder / "lengths.csv", seal_lengths.csv_text(results)))
    for name in pictures.FILES:
        if name in drawings:
            with replacing(folder / f"{name}.png") as temporary:
                temporary.write_bytes(drawings[name].whole)
            written.append(folder / f"{name}.png")
    written.append(write_report(results, folder / REPORT_NAME, drawings))
    return written


def _write_fields(
    results: Results, plan: fields.FieldPlan, surface: Topography | None, folder: Path, paraview: str
) -> list[Path]:
    written = fields.write_fields(results, plan, folder) if plan.steps.size else []
    return [*written, *write_vtk(results, surface, folder / "vtk", paraview)]


def _clear(folder: Path) -> None:
    """Remove a folder, or what stands in its place; files that links lead to stay."""
    if folder.is_symlink() or folder.is_file():
        folder.unlink()
    shutil.rmtree(folder, ignore_errors=True)


def _remove_former(folder: Path) -> None:
    """Remove the files that the manifest of an earlier run names, and folders that they leave empty.

    A name that leads out of the folder, also by a link, is passed over.
    """
    try:
        lines = read_plain(folder / MANIFEST, _LARGEST_MANIFEST).decode().splitlines()
    except (OSError, UnicodeDecodeError):
        return
    names = [Path(line) for line in lines if line and "\0" not in line]
    names = [name for name in names if not name.is_absolute() and ".." not in name.parts]
    parents: set[Path] = set()
    for name in names:
        with suppress(OSError):  # no such file, or a name too long to be one
            if is_inside(folder, name):
                (folder / name).unlink()
                parents.update(name.parents)
    for parent in sorted(parents - {Path()}, key=lambda p: -len(p.parts)):
        with suppress(OSError):  # not empty
            (folder / parent).rmdir()
