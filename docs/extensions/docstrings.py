"""Docstrings as napoleon reads them: fields of dataclasses with their unit and meaning, names apart from their text."""

import re
from dataclasses import fields, is_dataclass

_ENTRY = re.compile(r"(\w[\w, ]*) : (.*)")
_NAMED = ("Parameters", "Attributes", "Raises")


def restructured_docstring(app, what, name, obj, options, lines):
    """Handler of `autodoc-process-docstring`."""
    if what == "class" and is_dataclass(obj) and not any(map(_is_rule, lines)):
        _list_fields(obj, lines)
    text = [_without_bars(line) for line in _returns_in_one_line(lines)]
    section = ""
    for n, line in enumerate(text):
        if n + 1 < len(text) and _is_rule(text[n + 1]):
            section = line.strip()
        elif section in _NAMED and (found := _ENTRY.match(line)):
            # numpydoc would take the text for a type
            text[n] = f"{found[1]}\n    {found[2]}"
    lines[:] = "\n".join(text).split("\n")


def short_signature(app, what, name, obj, options, signature, returns):
    """Handler of `autodoc-process-signature`: numpy's types by the names of the code, defaults that can be read."""
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
    """What a function returns is told in words, which numpydoc would take for types."""
    out, n = [], 0
    while n < len(lines):
        if lines[n].strip() == "Returns" and n + 1 < len(lines) and _is_rule(lines[n + 1]):
            end = next((m for m in range(n + 2, len(lines)) if not lines[m].strip()), len(lines))
            out.append("")  # two empty lines end the section before
            out.append(":returns: " + " ".join(line.strip() for line in lines[n + 2 : end]))
            n = end
        else:
            out.append(lines[n])
            n += 1
    return out


def _list_fields(obj, lines):
    """Fields that a docstring or their metadata explain, in their order, at the end of the docstring."""
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
