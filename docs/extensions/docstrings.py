"""Convert docstrings to the form that napoleon reads.

The fields of a dataclass are listed with their units and meanings. The name of each entry is put on a line of its own.
"""

import re
from dataclasses import fields, is_dataclass

_ENTRY = re.compile(r"(\w[\w, ]*) : (.*)")
#: A type of numpydoc, such as "float, optional" or "array, (n1, n2)", as against a phrase that explains the entry.
_TYPE = re.compile(
    r"(?:\{.*\}|(?:array|bool|callable|dict|float|int|iterable|list|mapping|numpy|object|one|path|range|sequence|str"
    r"|tuple|two|[A-Z]\w{2,})(?:_like)?\b)[^;\[\]]*"
)
_NAMED = ("Parameters", "Attributes", "Raises")


def restructured_docstring(app, what, name, obj, options, lines):
    """Handle `autodoc-process-docstring`."""
    if what == "class" and is_dataclass(obj) and not any(map(_is_rule, lines)):
        _list_fields(obj, lines)
    text = [_without_bars(line) for line in _returns_in_one_line(lines)]
    section = ""
    for n, line in enumerate(text):
        if n + 1 < len(text) and _is_rule(text[n + 1]):
            section = line.strip()
            continue
        entry = _ENTRY.match(line) if section in _NAMED else None
        if entry and not _has_type(text, n, entry[2]):
            # napoleon would take the text for a type
            text[n] = f"{entry[1]}\n    {entry[2]}"
    lines[:] = "\n".join(text).split("\n")


def _has_type(lines, n, text):
    """Return whether an entry follows numpydoc: a type on its first line, and its meaning in indented lines below."""
    return _TYPE.fullmatch(text) is not None and _is_indented_below(lines, n)


def _is_indented_below(lines, n):
    """Return whether the line below line n is indented further."""
    indents = [len(line) - len(line.lstrip()) for line in lines[n : n + 2] if line.strip()]
    return len(indents) == 2 and indents[1] > indents[0]


def short_signature(app, what, name, obj, options, signature, returns):
    """Handle `autodoc-process-signature`: shorten numpy's types, and replace unreadable defaults by dots."""
    return ("(...)" if name == "femseal.Case" else _shortened(signature)), _shortened(returns)


def _shortened(text):
    if text is None:
        return None
    text = re.sub(r"~?[\w.]*_Buffer \| .*?complex \| bytes \| str\]", "ArrayLike", text)
    text = re.sub(r"~?[\w.]*\bndarray\[tuple\[[^]]*\], ~?[\w.]*dtype\[[^]]*\]\]", "Array", text)
    return re.sub(r"<[^<>]*>", "...", text)


def _is_rule(line):
    return re.fullmatch("-{3,}", line.strip()) is not None


def _without_bars(line):
    parts = re.split("(`+.*?`+)", line)
    return "".join(part if part.startswith("`") else part.replace("|", r"\|") for part in parts)


def _returns_in_one_line(lines):
    """Put prose in a Returns section on one line, because napoleon would take its first words for a type."""
    out, n = [], 0
    while n < len(lines):
        has_section = (
            lines[n].strip() == "Returns" and n + 1 < len(lines) and _is_rule(lines[n + 1])
        )
        if has_section and not _is_indented_below(lines, n + 2):
            end = next((m for m in range(n + 2, len(lines)) if not lines[m].strip()), len(lines))
            out.append("")  # two empty lines end the section before
            out.append(":returns: " + " ".join(line.strip() for line in lines[n + 2 : end]))
            n = end
        else:
            out.append(lines[n])
            n += 1
    return out


def _list_fields(obj, lines):
    """List the fields of a dataclass and their explanations, in their order, at the end of its docstring."""
    names = {field.name for field in fields(obj)}
    said, text, entry = {}, [], ""
    for line in lines:
        words = re.split(r"(?:^|(?<=[.;] ))(\w+(?:, \w+)*) : ", line.strip())
        is_entry = len(words) > 1 and set(words[1].split(", ")) <= names and not words[0]
        if not is_entry and not (entry and line.strip()):
            entry = ""
            text.append(line)
            continue
        # entries that follow one another on a line
        for new, words_of_it in [("", words[0]), *zip(words[1::2], words[2::2], strict=True)]:
            entry = new or entry
            said.setdefault(entry, []).append(words_of_it.strip())
    explained = {
        name: " ".join(filter(None, said[entry])) for entry in said for name in entry.split(", ")
    }
    rows = []
    for field in fields(obj):
        meaning = field.metadata.get("long_name") or field.metadata.get("label", "")
        if (unit := field.metadata.get("unit", "")) not in ("", "1"):
            meaning += f" [{unit.replace('^2', '²').replace('^3', '³')}]"
        if dims := field.metadata.get("dims"):
            meaning += f" ({', '.join(dims)})"
        if told := "; ".join(filter(None, (meaning.strip(), explained.get(field.name)))):
            rows.append(f"{field.name} : {told}")
    if rows:
        lines[:] = [*text, "", "Attributes", "----------", *rows, ""]
