"""The section of the report on what pressures the seal needs, from the files of `femseal design` in the folder."""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any

from ..base.files import read_plain

if TYPE_CHECKING:
    from ..results.results import Results

DESIGN_FILE, DESIGN_PICTURE = "design.json", "design.png"
#: No file of them is larger [byte].
_LARGEST = 1e7
_PNG = b"\x89PNG\r\n\x1a\n"


def design_section(results: Results) -> dict[str, Any] | None:
    """Sentences, tables and picture for the same case; None where the folder has none."""
    if results.folder is None:
        return None
    try:
        found = json.loads(read_plain(results.folder / DESIGN_FILE, _LARGEST))
        if found["case"] != results.case:
            return None
        picture = read_plain(results.folder / DESIGN_PICTURE, _LARGEST)
        if not picture.startswith(_PNG):
            return None
        tables = [{"title": "Pressure in assembly (Qmin) and in service (QSmin)", **found["sheet"]}]
        tables += [found["slopes"]] if found["slopes"] else []
        return {
            "sentences": [str(text) for text in found["sentences"]],
            "tables": [
                {"title": str(t["title"]), "heads": [str(h) for h in t["heads"]], "lines": _texts(t)} for t in tables
            ],
            "picture": "data:image/png;base64," + base64.b64encode(picture).decode(),
        }
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _texts(table: dict[str, Any]) -> list[list[str]]:
    lines = [[str(text) for text in line] for line in table["lines"]]
    if any(len(line) != len(table["heads"]) for line in lines):
        raise ValueError("lines of another length than the headings")
    return lines
