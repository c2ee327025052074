"""Docstrings as napoleon reads them: fields of dataclasses with their unit and meaning, names apart from their text."""

import re
from dataclasses import fields, is_dataclass

_ENTRY = re.compile(r"(\w[\w, ]*) : (.*)")


def restructured_docstring(app, what, name, obj, options, lines):
    """Handler of `autodoc-process-docstring`."""
    if what == "class" and is_dataclass(obj) and not any(re.fullmatch("-{3,}", line) for line in lines):
        _list_fields(obj, lines)
    section = ""
    for n, line in enumerate(lines):
        if n + 1 < len(lines) and re.fullmatch("-{3,}", lines[n + 1].strip()):
            section = line.strip()
        elif section in ("Parameters", "Attributes", "Raises") and (found := _ENTRY.match(line)):
            # numpydoc would take the text for a type
            lines[n] = f"{found[1]}\n    {found[2]}"
        parts = re.split("(`+.*?`+)", lines[n])
        lines[n] = "".join(part if part.startswith("`") else part.replace("|", r"\|") for part in parts)
    lines[:] = "\n".join(lines).split("\n")


def _list_fields(obj, lines):
    """Fields that a docstring or their metadata explain, in their order, at the end of the docstring."""
    said, text, entry = {}, [], None
    for line in lines:
        if found := _ENTRY.match(line):
            entry = found[1]
            said[entry] = [found[2]]
        elif entry and line.strip():
            said[entry].append(line.strip())
        else:
            entry = None
            text.append(line)
    names = {name: entry for entry in said for name in entry.split(", ")}
    rows = []
    for field in fields(obj):
        meaning = field.metadata.get("long_name") or field.metadata.get("label", "")
        if (unit := field.metadata.get("unit", "")) not in ("", "1"):
            meaning += f" [{unit.replace('^2', '²').replace('^3', '³')}]"
        if dims := field.metadata.get("dims"):
            meaning += f" ({', '.join(dims)})"
        parts = [meaning, *said.get(names.get(field.name), [])]
        if any(parts):
            rows += [f"{field.name} : {'; '.join(filter(None, (parts[0], ' '.join(parts[1:]))))}"]
    if rows:
        lines[:] = [*text, "", "Attributes", "----------", *rows, ""]


def short_types(app, what, name, obj, options, signature, returns):
    """Handler of `autodoc-process-signature`: numpy's types by the names that the code has for them."""
    return _shortened(signature), _shortened(returns)


def _shortened(text):
    if text is None:
        return None
    text = re.sub(r"_Buffer \| _SupportsArray\[.*?complex \| bytes \| str\]", "ArrayLike", text)
    return re.sub(r"~?(numpy\.)?ndarray\[tuple\[[^]]*\], ~?(numpy\.)?dtype\[[^]]*\]\]", "Array", text)
