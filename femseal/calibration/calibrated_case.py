"""The file of a case with calibrated values, from the tables of its file."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from .calibration import Calibration


def calibrated_text(data: dict[str, Any], base: Path, folder: Path, found: Calibration) -> str:
    """TOML of the tables of a case, whose files are relative to `base`, for a file in `folder`."""
    tables: dict[str, Any] = {name: _moved(value, base, folder) for name, value in data.items()}
    solid = dict(tables[found.solid])
    solid.pop("yield_stress", None)
    tables[found.solid] = solid | {"hardness": f"{found.hardness.median / 1e9:.5g} GPa"}
    tables["surface"] = tables.get("surface", {}) | {"shortest_wave": f"{found.shortest_wave.median * 1e6:.5g} um"}
    lines = [
        "# Hardness and shortest wave by a calibration with a leak test, medians of the posterior.",
        f"# The test leaked {found.factor.median:.3g} times as much as this case does.",
        *(f"{_key(name)} = {_toml(value)}" for name, value in tables.items() if not _is_table(value)),
    ]
    for name, value in tables.items():
        if _is_table(value):
            for table in [value] if isinstance(value, dict) else value:
                head = f"[{_key(name)}]" if isinstance(value, dict) else f"[[{_key(name)}]]"
                lines += ["", head, *(f"{_key(key)} = {_toml(inner)}" for key, inner in table.items())]
    return "\n".join(lines) + "\n"


def _moved(value: Any, base: Path, folder: Path) -> Any:
    """A value with the names of files that are there, relative to another folder."""
    if isinstance(value, dict):
        return {key: _moved(inner, base, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [_moved(inner, base, folder) for inner in value]
    if isinstance(value, str):
        # "lay.vtu:name" is a field of a file
        name, colon, field = value.rpartition(":") if not (base / value).is_file() else (value, "", "")
        if name and (base / name).is_file():
            return os.path.relpath(base / name, folder).replace(os.sep, "/") + colon + field
    return value


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
    )


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else json.dumps(name)


def _toml(value: Any) -> str:
    """A value of a TOML file, a table on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return str(value).lower() if isinstance(value, bool) else str(value)
