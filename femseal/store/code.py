"""Describe the code of users as plain data for a digest: their functions, their classes and objects of these.

Two contact laws of one name and equal parameters may compute different things, so the digest of a law has to change
with its code. Code of femseal, of the standard library and of installed packages is known by its name and version. All
other code is described by what Python runs: bytecode, constants, default values, and the values of the variables that
it takes from enclosing functions and from its module. These are followed as far as they go. Where something cannot be
described, `Unnamed` is raised: a store then neither keeps results nor finds any.
"""

from __future__ import annotations

import functools
import inspect
import sys
import types
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

_PACKAGE = __name__.partition(".")[0]
#: Folders of installed packages.
_INSTALLED = {"site-packages", "dist-packages"}
#: Attributes of classes that say nothing about what their objects do, or that follow from others.
_NOT_CODE = {"__dict__", "__weakref__", "__doc__", "__module__", "__annotations__", "__abstractmethods__", "_abc_impl",
             "__dataclass_params__", "__dataclass_fields__", "__match_args__", "__parameters__", "__orig_bases__",
             "__firstlineno__", "__static_attributes__", "__annotate__", "__annotate_func__", "__annotations_cache__",
             "_is_protocol", "__protocol_attrs__"}  # fmt: skip
#: Functions and methods of C code.
_OF_C = (
    types.BuiltinFunctionType,
    types.MethodDescriptorType,
    types.WrapperDescriptorType,
    types.ClassMethodDescriptorType,
    types.MethodWrapperType,
)
#: Modules with functions that do not say in which module they are, such as `numpy.exp`.
_NAMELESS_HOMES = ("numpy", "scipy.special")


class Unnamed(TypeError):
    """A value has no digest."""


class CodeDescription:
    """Describe the objects of one digest; a function or a class is referred to by a number where it appears again."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {}
        # what has a number stays alive, so that nothing else gets its address
        self._numbered: list[Any] = []

    def __call__(self, value: Any) -> Any:
        """Describe a value with plain data and with further values, which remain to be described.

        Raises
        ------
        Unnamed : an object whose state is unknown, such as one of C code.
        """
        if isinstance(value, types.FunctionType | type):
            if id(value) in self._numbers:
                return "again", self._numbers[id(value)]
            self._numbers[id(value)] = len(self._numbers)
            self._numbered.append(value)
            return (
                _described_class(value) if isinstance(value, type) else _described_function(value)
            )
        return _described_object(value)


def is_known(module: str) -> bool:
    """Whether code of a module is known by its name and a version: of Python, of femseal or of an installed package.

    A package that is installed from the folder in which it is edited is not.
    """
    return _origin(module) is not None


def _origin(module: str) -> str | None:
    """Version of the installed package of a module, "" of Python and femseal, None of other code.

    The versions of Python and of femseal are part of every key of a store.
    """
    top = module.partition(".")[0]
    if top == _PACKAGE or top in sys.stdlib_module_names:
        return ""
    file = getattr(sys.modules.get(top), "__file__", None)
    if file is None or _INSTALLED.isdisjoint(Path(file).parts):
        return None
    return _installed_version(top)


@functools.cache
def _installed_version(top: str) -> str | None:
    """Versions of the packages that install a top-level module, None without one."""
    names = packages_distributions().get(top, [])
    return ", ".join(f"{name} {version(name)}" for name in sorted(names)) or None


def _described_object(value: Any) -> Any:
    """Describe what is neither a function of Python nor a class."""
    if isinstance(value, types.CodeType):
        return _described_bytecode(value)
    if isinstance(value, types.ModuleType):
        return "module", value.__name__, _origin(value.__name__)
    if isinstance(value, types.MethodType):
        return "method", value.__func__, value.__self__
    if isinstance(value, functools.partial):
        return "partial", value.func, value.args, value.keywords
    if isinstance(value, staticmethod | classmethod):
        return type(value).__name__, value.__func__
    if isinstance(value, property):
        return "property", value.fget, value.fset, value.fdel
    if isinstance(value, functools.cached_property):
        return "cached property", value.func
    if isinstance(value, types.MemberDescriptorType):
        return "slot", value.__name__
    if isinstance(value, Enum):
        return "member", type(value).__module__, type(value).__qualname__, value.name, value.value
    if isinstance(value, set | frozenset):
        return type(value).__name__, *sorted(value, key=repr)
    if isinstance(value, tuple | list):  # of a class of its own
        return "items", type(value), *value
    if isinstance(value, complex):
        return "complex", value.real, value.imag
    if value is Ellipsis or value is NotImplemented:
        return "constant", repr(value)
    if is_dataclass(value):
        return "object", type(value), _state(value)
    # compiled by numba, or with a cache of its results
    wrapped = getattr(value, "py_func", getattr(value, "__wrapped__", None))
    if isinstance(wrapped, types.FunctionType):
        options = getattr(value, "targetoptions", {})
        return "wrapped", type(value).__qualname__, repr(sorted(options.items())), wrapped
    if callable(value):
        return _described_c_function(value)
    raise Unnamed(type(value).__qualname__)


def _described_c_function(function: Any) -> Any:
    """Describe a function of C code by its name in a module or a class that is known."""
    name = getattr(function, "__name__", None)
    owner = getattr(function, "__self__", None)
    if isinstance(owner, type):  # a method of a class, such as dict.fromkeys
        return "method", owner, name
    kind = getattr(function, "__objclass__", None)
    if isinstance(function, _OF_C) and kind is not None:
        return "method", kind, name
    homes = [function.__module__] if getattr(function, "__module__", None) else _NAMELESS_HOMES
    for home in homes:
        origin = _origin(home)
        if origin is not None and getattr(sys.modules.get(home), str(name), None) is function:
            return "function", home, name, origin
    raise Unnamed(f"{type(function).__qualname__} {name}")


def _described_function(function: types.FunctionType) -> Any:
    """Describe a function by its name if its module is known, else by its code and the values that it uses."""
    name, module = function.__qualname__, function.__module__
    if "<" not in name and is_known(module):
        return "function", module, name, _origin(module)
    values = _values_used(function)
    used = [[key, values[key]] for key in sorted(values)]
    return "code", function.__code__, function.__defaults__, function.__kwdefaults__, used


def _described_bytecode(code: types.CodeType) -> Any:
    """Describe a code object without its file and its lines, which change nothing."""
    numbers = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
    names = [code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]
    return "bytecode", code.co_code, code.co_exceptiontable, numbers, names, code.co_consts


def _described_class(kind: type) -> Any:
    """Describe a class by its name if its module is known, else by all its attributes and base classes."""
    name, module = kind.__qualname__, kind.__module__
    if "<" not in name and is_known(module):
        return "class", module, name, _origin(module)
    attributes = {
        name: value
        for name, value in vars(kind).items()
        if name not in _NOT_CODE and not _is_made_by_dataclass(value)
    }
    described = [[name, attributes[name]] for name in sorted(attributes)]
    own_fields = [f.name for f in fields(kind)] if is_dataclass(kind) else []
    return "class", name, type(kind), list(kind.__bases__), own_fields, described


def _is_made_by_dataclass(value: Any) -> bool:
    """Whether a method was written by `dataclass`: it follows from the fields."""
    method = getattr(value, "__wrapped__", value)
    code = getattr(method, "__code__", None)
    return code is not None and code.co_qualname.startswith("__create_fn__")


def _state(value: Any) -> list[Any]:
    """Names and values of the fields of a dataclass; of a user's also of all else but cached results."""
    kind = type(value)
    state = {field.name: getattr(value, field.name) for field in fields(value)}
    if is_known(kind.__module__):
        return [[name, state[name]] for name in state]
    for name, other in getattr(value, "__dict__", {}).items():
        attribute = inspect.getattr_static(kind, name, None)
        if name not in state and not isinstance(attribute, functools.cached_property):
            state[name] = other
    return [[name, state[name]] for name in state]


def _values_used(function: types.FunctionType) -> dict[str, Any]:
    """Values that a function takes from enclosing functions and from its module, by their names.

    Of another module of the user they are all attributes of it that the function may mean. Names without a value are
    left out: the function fails where it needs them.
    """
    values = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            values[name] = cell.cell_contents
        except ValueError:  # it has no value yet
            continue
    names = {*_names(function.__code__)}
    for name in names & function.__globals__.keys():
        value = function.__globals__[name]
        values[name] = value
        if isinstance(value, types.ModuleType) and not is_known(value.__name__):
            for inner in names & vars(value).keys():
                values[f"{name}.{inner}"] = vars(value)[inner]
    return values


def _names(code: types.CodeType) -> Iterator[str]:
    """Give the names of variables and attributes in a code and in the functions that are defined in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)
