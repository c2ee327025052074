"""Use the results of a finished run again, or refuse to replace them."""

from __future__ import annotations

import json
import logging
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..base import FemsealError, InputError
from ..case.case import Case
from ..case.output_table import FILE_KEYS
from ..execution.resuming import alone_in, remove_run, resumable
from ..preparation.preparation import prepare
from ..refinement.settings import last_version
from ..report import write_again
from ..results import Results, open_results
from ..results.dataset_file import FILE_NAME
from .identity import chosen_settings

log = logging.getLogger("femseal")


def finished_results(case: Case, faces: dict[str, str], folder: Path) -> Results | None:
    """Read the results of a finished run from a folder, if running the case now would give the same results.

    If the case requests pictures or tables that are not yet in the folder, they are written first.

    Parameters
    ----------
    case : Case
        The case.
    faces : dict of str
        SHA-256 digest of each input file, by the path of the file, see `face_files`.
    folder : Path
        Results folder.

    Returns
    -------
    Results or None
        None if the folder contains no results, or if the case, a face file or the settings are different. None is also
        returned if the case requests files with fields over all pixels, which cannot be written from the results.

    Raises
    ------
    InputError
        Another run is under way in the folder.
    FemsealError
        A file could not be written.
    """
    try:
        results = open_results(folder)
        former_faces = json.loads(results.dataset.attrs.get("face_files", "{}"))
        former_settings = json.loads(results.dataset.attrs.get("chosen", "{}"))
    except (FemsealError, ValueError, TypeError, RecursionError):
        return None
    echo = case.echo()
    # results of another case, or from other input files
    if _without_file_keys(results.case) != _without_file_keys(echo) or former_faces != faces:
        return None
    # the settings that the program chooses may have changed, because its version or the code of the user has changed
    study_input = prepare(case)
    has_same_settings = former_settings == chosen_settings(case, study_input)
    if has_same_settings and _with_sorted_sources(results.case) == _with_sorted_sources(echo):
        return results
    if not has_same_settings or _needs_new_fields(results.case["output"], echo["output"]):
        log.info("the results in %s lack fields, or have other settings: they are replaced", folder)
        return None
    # only the files differ: write them from the results
    with alone_in(folder):
        results.dataset.attrs["case"] = json.dumps(echo, ensure_ascii=False)
        options = {key: value for key, value in case.output.files.items() if key != "fields_limit"}
        surface = last_version(case, study_input, results.attempts).scene.surface
        write_again(results, surface, **options)
        log.info("other files written to %s", folder)
    return results


def refuse_finished(folder: Path, case: Case | None = None) -> None:
    """Raise InputError if a folder contains results of a finished run that must not be replaced.

    Parameters
    ----------
    folder : Path
        Results folder.
    case : Case, optional
        Case of a resumed run, whose earlier results may be replaced. By default, no earlier results may be replaced.
    """
    path = folder / FILE_NAME
    if path.is_symlink() or not path.is_file():
        # writing the results would replace a link, but not the file to which it leads
        return
    if case is None:
        given = f"'{folder}', which holds the results of a finished run"
        expected = "another folder, --resume to use these results if they belong to this case"
    else:
        try:
            former = open_results(folder).case
        except FemsealError:  # a damaged file contains no results to be lost
            return
        if _without_file_keys(former) == _without_file_keys(case.echo()):
            # the same case is computed again, for example because a face file has changed
            return
        given = f"'{folder}', which holds the results of another case, or of another version"
        expected = "another folder"
    expected += (
        ", or --replace (Python: replace_results=True) to compute this case and replace them"
    )
    raise InputError("output", given, expected)


def remove_stored_stages(folder: Path, identity: dict[str, Any]) -> None:
    """Remove the stored stages of a finished run from its folder, unless they belong to another run.

    identity : data that determine the results of the finished run, see `identity.run_identity`.
    """
    with suppress(InputError), alone_in(folder):
        resumable(folder, identity)  # raises InputError for another identity
        remove_run(folder)


def _without_file_keys(echo: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a case without the keys that only control which files are written."""
    echo = _with_sorted_sources(echo)
    output = {key: value for key, value in echo.get("output", {}).items() if key not in FILE_KEYS}
    return {**echo, "output": output}


def _with_sorted_sources(echo: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a case with the error sources in a fixed order, which may differ between versions."""
    output = dict(echo.get("output", {}))
    if "model_parts" in output:
        output["model_parts"] = sorted(output["model_parts"])
    return {**echo, "output": output}


def _needs_new_fields(former_output: dict[str, Any], output: dict[str, Any]) -> bool:
    """Return whether the case requests files that cannot be written from the results of a former run.

    Files with fields over all pixels and files for ParaView cannot be written from the results.

    former_output : table [output] of the former run's case.
    output : table [output] of the present case.
    """
    if output["paraview"] not in (former_output.get("paraview"), "none"):
        return True
    if not output["fields"]:
        return False
    return any(former_output.get(key) != output[key] for key in ("fields", "fields_limit"))
