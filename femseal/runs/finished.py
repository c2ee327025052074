"""Complete results of a case in a folder: taken as they are, or with other files written beside them."""

import json
import logging
from pathlib import Path
from typing import Any

from ..base import FemsealError
from ..case.case import Case
from ..case.case_tables import FILE_KEYS
from ..execution.resuming import alone_in
from ..preparation.preparation import prepare
from ..refinement.settings import chosen, last_version
from ..report import write_again
from ..results import Results, open_results

log = logging.getLogger("femseal.runs.finished")


def finished_results(case: Case, faces: dict[str, str], folder: Path) -> Results | None:
    """Complete results of the same case and face files in a folder, if what the case leaves open is chosen as then.

    Where the case asks for other files than those that are there, and their fields are not needed for them, the files
    are written first.

    faces : digest of every face file by its path in the case.

    Raises InputError: another run is under way in the folder.
    FemsealError : a file could not be written.
    """
    try:
        results = open_results(folder)
        face_files = json.loads(results.dataset.attrs.get("face_files", "{}"))
        then = json.loads(results.dataset.attrs.get("chosen", "{}"))
    except (FemsealError, ValueError, TypeError, RecursionError):
        return None
    echo = case.echo()
    if _numbers(results.case) != _numbers(echo) or face_files != faces:
        return None
    prepared = prepare(case)
    same_choices = then == chosen(case, prepared)
    if same_choices and results.case == echo:
        return results
    if not same_choices or _lacks(results.case["output"], echo["output"]):
        log.info("computed again: the results in %s lack fields, or are of other choices", folder)
        return None
    with alone_in(folder):
        results.dataset.attrs["case"] = json.dumps(echo, ensure_ascii=False)
        options = {key: value for key, value in case.output.files.items() if key != "fields_limit"}
        write_again(
            results, last_version(case, prepared, results.attempts).scene.surface, **options
        )
        log.info("other files written to %s", folder)
    return results


def _numbers(echo: dict[str, Any]) -> dict[str, Any]:
    """The case without what says only which files are written."""
    output = {key: value for key, value in echo.get("output", {}).items() if key not in FILE_KEYS}
    return {**echo, "output": output}


def _lacks(former: dict[str, Any], now: dict[str, Any]) -> bool:
    """Whether files are asked for that take fields of the studies which are not kept."""
    keys = ("fields", "fields_limit") if now["fields"] else ()
    others = any(former.get(key) != now[key] for key in keys)
    return others or now["paraview"] not in (former.get("paraview"), "none")
