"""Extend sphinx-gallery: define `__file__` in the examples, and convert a notebook to an example."""

import builtins
import json
import re
from pathlib import Path


def name_the_script(gallery_conf, fname):
    """Define `__file__` for an example, because sphinx-gallery executes its text without it."""
    if fname:
        builtins.__file__ = str(
            Path(gallery_conf["src_dir"], gallery_conf["examples_dirs"], Path(fname).name)
        )


def notebook_as_script(notebook: Path, script: Path) -> None:
    """Write the cells of a notebook as blocks of a script; the first cell, with the title, becomes the docstring."""
    first, *others = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    blocks = [f'"""{_restructured(first)}\n"""']
    after_text = False
    for cell in others:
        if cell["cell_type"] == "markdown":
            blocks.append(
                "# %%\n"
                + "\n".join(f"# {line}".rstrip() for line in _restructured(cell).splitlines())
            )
        else:
            blocks.append(("" if after_text else "# %%\n") + "".join(cell["source"]))
        after_text = cell["cell_type"] == "markdown"
    script.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")


def _restructured(cell: dict) -> str:
    """Convert the headings and the code in the text of a Markdown cell to reStructuredText."""
    text = "".join(cell["source"]).replace("`", "``")
    return re.sub(
        r"^(#+) (.*)$",
        lambda m: f"{m[2]}\n{'=-~'[len(m[1]) - 1] * len(m[2])}",
        text,
        flags=re.MULTILINE,
    )
