"""Collect all data on which the results of a run depend, to recognise results that can be used again."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Any
from uuid import uuid4

from ..base import InputError, numerical_versions
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..case.table_types import makers_in
from ..execution.resuming import USER_CODE
from ..refinement.settings import first_settings, first_version
from ..store.digests import is_known


def run_identity(case: Case, faces: dict[str, str]) -> dict[str, Any]:
    """Return all data on which the results of a run depend, as nested dictionaries of plain values.

    Of the table [output], only the test fluid is included: all its other keys can be changed before a run is resumed.
    """
    echo = case.echo()
    echo |= {"output": {"test_fluid": echo["output"].get("test_fluid")}}
    identity = echo | {"content of face files": faces, "version": numerical_versions()}
    return identity | user_code(case)


def face_files(case: Case) -> dict[str, str]:
    """Return the SHA-256 digest of every file that a case reads, by the path of the file in the case.

    These are the height maps and masks of the faces, the files named for the seal and the seat, and pressure maps.
    """
    digests = {}
    for key, path in case.files():
        try:
            with (case.folder / path).open("rb") as file:
                digests[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            expected = f"a file that can be read ({error.strerror})"
            raise InputError(key, f"'{path}'", expected) from None
    return digests


def user_code(case: Case) -> dict[str, str]:
    """Return a mark that never repeats if a case contains user-defined classes: fluids, seal shapes, seats and forms.

    No earlier result is reused then, because the code of such a class may have changed. The dictionary is empty if the
    case contains no user-defined classes.
    """
    if all(is_known(maker.__module__) for maker in makers_in(case)):
        return {}
    return {USER_CODE: uuid4().hex}


def chosen_settings(case: Case, original: StudyInput) -> dict[str, Any]:
    """Return the settings that the program chooses for a case, and an entry for user-defined classes.

    If the case requests an accuracy, the settings of the first attempt are returned.
    """
    if case.accuracy is None:
        return original.chosen | user_code(case)
    chosen = first_version(case, original).chosen | user_code(case)
    settings = asdict(first_settings(case, original))
    return chosen | {f"settings.{name}": value for name, value in settings.items()}
