"""Code that pages of the documentation show, and cases that are put together from it."""

import re


def code_blocks(page, language):
    """Blocks of code of a page."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def tables_of_case(text):
    """Tables of a case by their header; "" is what comes before the first."""
    parts = re.split(r"(?m)^(\[\w+\])", text)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def merged_case(*texts):
    """A case in which tables of the later texts replace those of the same name, and so does a method at their top."""
    found = {}
    for text in texts:
        new = tables_of_case(text)
        if found:
            method = re.search(r"(?m)^method = .*", new[""])
            new[""] = re.sub(r"(?m)^method = .*", method[0], found[""]) if method else found[""]
        found |= new
    return "".join(name + body for name, body in found.items())
