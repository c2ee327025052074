"""Configuration of Sphinx: `sphinx-build docs docs/_build`; `-t short` leaves out the long examples of the gallery."""

import logging
import os
import shutil
import sys
from pathlib import Path

from sphinx_gallery.sorting import ExplicitOrder

import femseal

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

from case_keys import write_case_keys  # noqa: E402
from command_line import write_command_line  # noqa: E402
from docstrings import restructured_docstring, short_signature  # noqa: E402
from gallery_support import name_the_script, notebook_as_script  # noqa: E402  beside this file

os.environ["MPLBACKEND"] = "Agg"
logging.getLogger("skfem").setLevel(logging.WARNING)

project = "femseal"
author = "the femseal developers"
copyright = "the femseal developers"
release = version = femseal.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "formulas",  # beside this file
    "sphinx_gallery.gen_gallery",
]
# paper.md is for a journal, which has its own form of citations
exclude_patterns = ["_build", "_examples", "gallery_header.rst", "paper.md"]
# functions in the configuration; spaces in the path of the whole, which do no harm
suppress_warnings = ["ref.python", "config.cache", "sphinx_gallery.space_in_filename"]

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"femseal {release}"
html_static_path = ["static"]
html_css_files = ["femseal.css"]
html_show_sourcelink = False

default_role = "py:obj"
napoleon_use_ivar = True
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 80

#: Examples of the gallery; with `-t short` only the quick ones are run. The others of the folder need an argument.
SHOWN = (
    *("tutorial", "elastic_check", "one_cell", "scratch", "lens_ring", "measured_face"),
    *("real_size_seal", "paper_2018", "read_results", "design_answer", "sobol"),
)
QUICK = ("elastic_check", "one_cell", "scratch", "measured_face")
#: Pictures for the examples that are not run with `-t short`; paths are relative to this folder.
THUMBNAILS = {
    "tutorial": "../examples/turned_seal.png",
    "lens_ring": "tutorials/lens_ring.png",
    "real_size_seal": "../examples/real_sizes.png",
    "paper_2018": "paper_2018/permeability.png",
    "read_results": "tutorials/drawing.png",
    "design_answer": "tutorials/leak_test.png",
    "sobol": "static/sobol.png",
}

# Examples run in a folder of their own, as some write files beside themselves.
EXAMPLES = HERE / "_examples"
shutil.rmtree(EXAMPLES, ignore_errors=True)
EXAMPLES.mkdir()
for name in (*(f"{stem}.py" for stem in SHOWN if stem != "tutorial"), "measured_face.x3p"):
    shutil.copy(HERE.parent / "examples" / name, EXAMPLES)
if not tags.has("short"):  # noqa: F821  Sphinx defines tags
    femseal.run(HERE.parent / "examples" / "turned_seal.toml", EXAMPLES / "results" / "turned_seal")
notebook_as_script(HERE.parent / "examples" / "tutorial.ipynb", EXAMPLES / "tutorial.py")
for stem, picture in THUMBNAILS.items():
    with (EXAMPLES / f"{stem}.py").open("a", encoding="utf-8") as script:
        script.write(f'\n# sphinx_gallery_thumbnail_path = "{picture}"\n')
shutil.copy(HERE / "gallery_header.rst", EXAMPLES / "GALLERY_HEADER.rst")

write_command_line(HERE / "command_line.md")
write_case_keys(HERE / "case_keys.md")

sphinx_gallery_conf = {
    "examples_dirs": "_examples",
    "gallery_dirs": "gallery",
    "filename_pattern": rf"/({'|'.join(QUICK if tags.has('short') else SHOWN)})\.py",  # noqa: F821
    # every picture of a result belongs to pyplot
    "image_scrapers": ("matplotlib",),
    "reset_modules": ("matplotlib", name_the_script),
    "within_subsection_order": ExplicitOrder([f"{stem}.py" for stem in SHOWN]),
    "capture_repr": ("_repr_html_",),
    "copyfile_regex": r".*\.x3p",
    "download_all_examples": False,
    "show_signature": False,
    "remove_config_comments": True,
    "write_computation_times": False,
    "min_reported_time": 3600,
}


def setup(app):
    app.connect(
        "autodoc-process-docstring", restructured_docstring, priority=400
    )  # before napoleon
    app.connect("autodoc-process-signature", short_signature)
