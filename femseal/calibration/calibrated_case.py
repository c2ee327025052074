"""Write a case file with the hardness and the shortest wave of a calibration."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..case.template import as_toml, bare_key
from .calibration import Calibration


def calibrated_text(
    tables: dict[str, Any], case_folder: Path, folder: Path, calibration: Calibration
) -> str:
    """Return the text of a case file (TOML) with the calibrated hardness and shortest wave.

    Parameters
    ----------
    tables : dict
        Tables of the case file.
    case_folder : Path
        Folder to which the names of files in the case are relative.
    folder : Path
        Folder of the new case. The file names in the new case are relative to this folder.
    calibration : Calibration
        Calibration whose medians are written into the new case.
    """
    calibrated = {name: _relocate(value, case_folder, folder) for name, value in tables.items()}
    solid = dict(calibrated[calibration.solid])
    solid.pop("yield_stress", None)
    solid.pop("hardness_over_yield", None)
    solid["hardness"] = f"{calibration.hardness.median / 1e9:.5g} GPa"
    calibrated[calibration.solid] = solid
    shortest_wave = f"{calibration.shortest_wave.median * 1e6:.5g} um"
    calibrated["surface"] = calibrated.get("surface", {}) | {"shortest_wave": shortest_wave}
    lines = [
        "# Hardness and shortest wave are medians of the posterior of a calibration with a leak test.",
        f"# The test leaked {calibration.factor.median:.3g} times as much as this case does.",
        *(f"{bare_key(name)} = {as_toml(value)}" for name, value in calibrated.items()),
    ]
    return "\n".join(lines) + "\n"


def _relocate(value: Any, case_folder: Path, folder: Path) -> Any:
    """Rewrite the file names in a value of a case so that they are relative to `folder` instead of `case_folder`."""
    if isinstance(value, dict):
        return {key: _relocate(inner, case_folder, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [_relocate(inner, case_folder, folder) for inner in value]
    if not isinstance(value, str):
        return value
    # "lay.vtu:name" means the field `name` of the file lay.vtu
    for file_name in (value, value.rpartition(":")[0]):
        if file_name and (case_folder / file_name).is_file():
            path = os.path.relpath(case_folder / file_name, folder).replace(os.sep, "/")
            return path + value.removeprefix(file_name)
    return value
