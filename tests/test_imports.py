"""Imports run downwards only and in no circle; names of files say one thing; the package is quick to import."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import femseal

ROOT = Path(femseal.__file__).parent
#: From the bottom to the top: a module imports modules of its own room and of rooms before it.
ROOMS = (
    "base",
    "execution",
    "materials",
    "rarefied",
    "fluids",
    "named_fluids",
    "loads",
    "analytic",
    "topography",
    "contact",
    "flow",
    "seal",
    "scales",
    "studies",
    "budget",
    "results",
    "plots",
    "report",
    "case",
    "preparation",
    "refinement",
    "runs",
    "sweeps",
    "designs",
    "hard_cases",
    "cli",
    "__main__",
)
HEAVY = ("matplotlib", "jinja2", "vtk", "vtkmodules", "pyvista", "meshio", "SurfaceTopography", "distributed", "pyamg")
#: A module of more lines has more than one reason to change.
MOST_LINES = 400
MODULES = sorted(p for p in ROOT.rglob("*.py") if p != ROOT / "__init__.py")
each_module = pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))


def _for_type_checkers(node):
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def _imports(path):
    """(dotted module below femseal or outside package, when it is imported: "at once", "when used", "never")."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    package = parts[:-1]  # for a package's __init__ this is the package itself
    tree = ast.parse(path.read_text(encoding="utf-8"))
    when = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) or _for_type_checkers(node):
            kind = "never" if _for_type_checkers(node) else "when used"
            when.update({id(n): kind for n in ast.walk(node)})
    found = []
    for node in ast.walk(tree):
        time = when.get(id(node), "at once")
        if isinstance(node, ast.Import):
            found += [(a.name, time) for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = () if node.level == 0 else ("femseal", *package[: len(package) - node.level + 1])
            full = (*base, *(node.module or "").split(".")) if node.module else base
            for a in node.names:
                inner = (*full, a.name)
                found.append((".".join(inner if _is_module(inner) else full), time))
    return found


def _is_module(parts):
    if parts[0] != "femseal":
        return False
    place = ROOT.joinpath(*parts[1:])
    return place.with_suffix(".py").is_file() or (place / "__init__.py").is_file()


@each_module
def test_imports_run_downwards(path):
    own = path.relative_to(ROOT).parts[0].removesuffix(".py")
    assert own in ROOMS, f"{own} has no place in the flow"
    for name, _ in _imports(path):
        parts = name.split(".")
        if parts[0] == "femseal" and len(parts) > 1 and parts[1] in ROOMS:
            assert ROOMS.index(parts[1]) <= ROOMS.index(own), f"{own} imports {parts[1]}"


def test_no_circles_inside_rooms():
    graph = {}
    for path in MODULES:
        name = ".".join(("femseal", *path.relative_to(ROOT).with_suffix("").parts))
        if path.name != "__init__.py":
            graph[name] = {other for other, time in _imports(path) if time != "never" and other.startswith("femseal.")}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


def test_no_two_files_have_one_name():
    names = Counter(p.name for p in MODULES if p.name != "__init__.py")
    assert not [name for name, count in names.items() if count > 1]


@each_module
def test_modules_are_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def test_contact_and_flow_do_not_know_each_other():
    for package, other in (("contact", "flow"), ("flow", "contact")):
        for path in (ROOT / package).rglob("*.py"):
            assert not [n for n, _ in _imports(path) if n.startswith(f"femseal.{other}")]


@each_module
def test_heavy_libraries_are_imported_where_they_are_used(path):
    heavy = [name for name, time in _imports(path) if time == "at once" and name.split(".")[0] in HEAVY]
    assert not heavy


@each_module
def test_pictures_are_made_in_the_rooms_of_pictures(path):
    room = path.relative_to(ROOT).parts[0]
    if room not in ("plots", "report", "refinement", "designs"):
        assert not [name for name, _ in _imports(path) if name.split(".")[0] == "matplotlib"]


def test_analytic_needs_numpy_only():
    roots = {name.split(".")[0] for name, _ in _imports(ROOT / "analytic.py")}
    assert roots <= {"__future__", "math", "collections", "typing", "numpy"}


def test_import_loads_nothing_until_it_is_used():
    code = "import sys, femseal; print([m for m in ('numba', 'scipy', 'skfem', 'xarray') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_every_public_name_is_there():
    for name in femseal.__all__:
        assert getattr(femseal, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        femseal.nonsense  # noqa: B018


def test_a_warning_of_numbers_in_a_module_of_the_package_fails_its_test():
    """The rule of pyproject.toml goes by the name of the module, wherever the package lies."""
    code = compile("import numpy as np\nnp.array(0.0) * np.inf", "anywhere.py", "exec")
    with pytest.raises(RuntimeWarning, match="invalid value"):
        exec(code, {"__name__": "femseal.scales.curves"})
    with pytest.warns(RuntimeWarning, match="invalid value"):
        exec(code, {"__name__": "another.module"})
