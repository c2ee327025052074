"""Imports run upwards only and in no circle, however they are written; files are short and have names of their own.

An import counts whether it is made at once, inside a function, for type checkers alone or by a string.
Tests import no other tests.
"""

import ast
import subprocess
import sys
from collections import Counter, defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import femseal

ROOT = Path(femseal.__file__).parent
TESTS = Path(__file__).parent
#: From top to bottom: a module imports from its own room and from rooms above it. A room need not be there yet.
ROOMS = (
    "base",
    "store",
    "execution",
    "materials",
    "loads",
    "persson",
    "analytic",
    "topography",
    "contact",
    "flow",
    "named_fluids",
    "gases",
    "fluids",
    "seal",
    "face",
    "scene",
    "checks",
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
    "calibration",
    "commands",
    "new_case",
    "cli",
    "__main__",
)
HEAVY = {
    "matplotlib",
    "jinja2",
    "vtk",
    "vtkmodules",
    "pyvista",
    "meshio",
    "SurfaceTopography",
    "distributed",
    "dask",
    "pyamg",
    "pyfftw",
    "CoolProp",
    "gmsh",
}
BY_STRING = {"import_module", "__import__"}
#: Rooms that draw.
PICTURES = {"plots", "report", "designs", "calibration"}
#: A module of more lines of code has more than one reason to change.
MOST_LINES = 400
#: The law of the contact and that of the flow are both called what they are.
SHARED_NAMES = {"__init__.py", "law.py"}


def _module(path):
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {_module(path): path for path in sorted(ROOT.rglob("*.py"))}


def _room(module):
    return [*module.split("."), ""][1]


@cache
def _tree(module):
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def _nodes(module):
    return tuple(ast.walk(_tree(module)))


def _called(node):
    return (
        getattr(node.func, "id", getattr(node.func, "attr", ""))
        if isinstance(node, ast.Call)
        else ""
    )


@cache
def _importers():
    """Names of functions that import what a string names: `import_module`, and those that hand a name on to it."""
    functions = [n for module in MODULES for n in _nodes(module) if isinstance(n, ast.FunctionDef)]
    return BY_STRING | {
        f.name for f in functions if any(_called(n) in BY_STRING for n in ast.walk(f))
    }


@cache
def _exported(package):
    """Names that the __init__ of a package takes from elsewhere, and the module of each."""
    return {
        alias.asname or alias.name: full
        for node in _nodes(package)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        for full in [_from(package, node)]
    }


def _from(module, node):
    """Dotted name of what `from … import` of a module names."""
    if node.level == 0:
        return node.module
    package = module.split(".") if MODULES[module].name == "__init__.py" else module.split(".")[:-1]
    return ".".join(
        [*package[: len(package) - node.level + 1], *([node.module] if node.module else [])]
    )


def _home(full, name):
    """Module that holds a name imported from another one, through what packages hand on."""
    if f"{full}.{name}" in MODULES:
        return f"{full}.{name}"
    if full in MODULES and MODULES[full].name == "__init__.py" and name in _exported(full):
        return _home(_exported(full)[name], name)
    return full


def loaded_after(code, *modules):
    """Which of these modules code loads in a process of its own, and what it prints before."""
    code = f"import sys\n{code}\nprint([m for m in {modules!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    return done.stdout


@cache
def _imports(module):
    """{(dotted name, how)}: "at once", "when used" or "for types"; by a string is "when used"."""
    how = {}
    for node in _nodes(module):
        types_only = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if types_only or isinstance(node, ast.FunctionDef):
            time = "for types" if types_only else "when used"
            how |= {id(inner): time for inner in ast.walk(node)}
    found = set()
    by_string = any(_called(node) in BY_STRING for node in _nodes(module))
    for node in _nodes(module):
        time = how.get(id(node), "at once")
        if isinstance(node, ast.Import):
            found |= {(alias.name, time) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            full = _from(module, node)
            found |= {(_home(full, alias.name), time) for alias in node.names}
        elif by_string or _called(node) in _importers():
            # of a file that imports by strings all its strings count
            texts = [node] if by_string else [*node.args, *(k.value for k in node.keywords)]
            texts = [t.value for t in texts if isinstance(getattr(t, "value", None), str)]
            names = (t.lstrip(".").removeprefix("femseal.").partition(":")[0] for t in texts)
            found |= {(n, "when used") for n in map("femseal.{}".format, names) if n in MODULES}
    return frozenset(found)


@cache
def _graph():
    """Modules of the package that each module imports; femseal itself hands on names of all rooms and is left out."""
    inside = {
        module: {name for name, _ in _imports(module) if name in MODULES} for module in MODULES
    }
    # an __init__ that hands names on imports them; to import a name through it is to import the module of the name
    return {
        module: names - {module, "femseal"}
        for module, names in inside.items()
        if module != "femseal"
    }


def test_every_room_has_its_place():
    assert {_room(module) for module in MODULES} - {""} <= set(ROOMS)


def test_imports_run_upwards():
    patches = {room: place for place, room in enumerate(ROOMS)}
    downwards = {
        (module, _room(other))
        for module, others in _graph().items()
        for other in others
        if patches[_room(other)] > patches[_room(module)]
    }
    assert downwards == set()


def test_only_methods_that_show_a_result_use_packages_as_attributes_of_femseal():
    """The methods are a short way to functions of packages below, which import the classes of the methods."""
    used = {
        (module, node.attr)
        for module in MODULES
        for node in _nodes(module)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "femseal"
    }
    assert {name for _, name in used} == {"plots", "report", "results"}
    assert {_room(module) for module, _ in used} == {"base", "results"}


def test_no_modules_import_each_other():
    """Inside rooms: between rooms there is no circle without an import that runs downwards."""
    inside = {
        module: {other for other in others if _room(other) == _room(module)}
        for module, others in _graph().items()
    }
    try:
        list(TopologicalSorter(inside).static_order())
    except CycleError as error:
        pytest.fail(f"circle of imports: {error.args[1]}")


def test_files_have_names_of_their_own():
    names = Counter(path.name for path in MODULES.values())
    assert {name for name, count in names.items() if count > 1} <= SHARED_NAMES


def _constants(module):
    """Names of the constants that a module defines."""
    for node in _tree(module).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            elements = target.elts if isinstance(target, ast.Tuple) else [target]
            yield from (e.id for e in elements if isinstance(e, ast.Name) and e.id.isupper())


def test_a_constant_of_several_modules_has_one_meaning():
    """A constant that others may import has a name of its own, which says its quantity."""
    public = Counter(name for m in MODULES for name in _constants(m) if name[0] != "_")
    assert {name for name, count in public.items() if count > 1} == set()
    for module in MODULES:
        names = set(_constants(module))
        assert {name for name in names if f"_{name}" in names} == set(), module


def _lines_of_code(path):
    """Lines without docstrings, comments and blank ones."""
    text = path.read_text(encoding="utf-8")
    said = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            said |= set(range(node.lineno, node.end_lineno + 1))
    lines = enumerate(text.splitlines(), start=1)
    return sum(n not in said and line.strip()[:1] not in ("", "#") for n, line in lines)


def test_files_are_short():
    lines = {module: _lines_of_code(path) for module, path in MODULES.items()}
    assert {module: count for module, count in lines.items() if count > MOST_LINES} == {}


def test_contact_and_flow_do_not_know_each_other():
    rooms = defaultdict(set)
    for module, others in _graph().items():
        rooms[_room(module)] |= {_room(other) for other in others}
    assert "flow" not in rooms["contact"]
    assert "contact" not in rooms["flow"]


def test_heavy_libraries_are_imported_where_they_are_used():
    outside = {
        (m, name.split(".")[0]) for m in MODULES for name, how in _imports(m) if how == "at once"
    }
    assert {(module, name) for module, name in outside if name in HEAVY} == set()


def test_pictures_are_made_in_the_rooms_of_pictures():
    drawing = {m for m in MODULES for name, _ in _imports(m) if name.split(".")[0] == "matplotlib"}
    assert {module for module in drawing if _room(module) not in PICTURES} == set()


def test_analytic_itself_imports_numpy_only():
    names = {name for name, _ in _imports("femseal.analytic")}
    roots = {name.split(".")[0] for name in names if _room(name) not in ("base", "persson")}
    assert roots <= {"__future__", "math", "collections", "functools", "typing", "numpy"}


def test_import_loads_nothing_until_it_is_used():
    assert loaded_after("import femseal", "numba", "scipy", "skfem", "xarray") == "[]\n"


def test_every_public_name_is_there():
    for name in femseal.__all__:
        assert getattr(femseal, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        femseal.nonsense  # noqa: B018


def test_a_warning_of_numbers_in_a_module_of_the_package_fails_its_test():
    """The rule of pyproject.toml goes by the name of the module, wherever the package lies."""
    code = compile("import numpy as np\nnp.array(0.0) * np.inf", "anywhere.py", "exec")
    with pytest.raises(RuntimeWarning, match="invalid value"):
        exec(code, {"__name__": "femseal.library.curves"})
    with pytest.warns(RuntimeWarning, match="invalid value"):
        exec(code, {"__name__": "another.module"})


def _without_docstring(tree, inside=False):
    """Public functions and classes, and private ones of more than ten lines, that say nothing; none inside functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not inside:
            dunder = node.name.startswith("__")
            long = node.end_lineno - node.lineno >= 10 and not dunder
            if (long or not node.name.startswith("_")) and not ast.get_docstring(node):
                yield f"{node.name} in line {node.lineno}"
        yield from _without_docstring(node, inside or isinstance(node, ast.FunctionDef))


def test_functions_and_classes_have_docstrings():
    found = {
        name: [*_without_docstring(ast.parse(path.read_text("utf-8")))]
        for name, path in MODULES.items()
    }
    assert not {name: functions for name, functions in found.items() if functions}


def test_a_faulty_case_is_refused_before_the_solvers_are_loaded(tmp_path):
    (tmp_path / "case.toml").write_text('[material]\nyeld_stress = "1 GPa"\n', encoding="utf-8")
    code = f"import femseal as fs\ntry: fs.load_case({str(tmp_path / 'case.toml')!r})\n"
    code += "except fs.InputError as error: print(error)"
    shown = loaded_after(code, "numba", "scipy.fft", "skfem", "xarray", "pandas", "rich")
    assert "perhaps meant: yield_stress" in shown
    assert shown.endswith("[]\n")


def _imported_modules(path):
    """Names of the modules that a file imports, at once or inside a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_no_module_imports_a_module_of_tests():
    """What several tests need is in a helper module, so that a test is understood without reading another one."""
    imported = {
        (path.name, name) for path in TESTS.rglob("*.py") for name in _imported_modules(path)
    }
    assert len(imported) > 1000
    assert {(path, name) for path, name in imported if name.startswith("test_")} == set()


def test_files_of_tests_have_names_of_their_own():
    """They are imported without the name of their folder."""
    names = Counter(path.name for path in TESTS.rglob("*.py"))
    assert {name for name, count in names.items() if count > 1} == set()


@pytest.mark.parametrize(
    "package", [path.parent for path in ROOT.rglob("__init__.py")], ids=lambda path: path.name
)
def test_no_name_of_a_package_is_that_of_a_file_in_it(package):
    """The file would stand in place of a function once it is loaded."""
    names = _exported(_module(package / "__init__.py"))
    assert not {path.stem for path in package.iterdir()} & names.keys()
