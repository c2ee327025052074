"""Describe the user's own code by plain data, so that the digest of a function changes with its code.

If a user changes a contact law, it may keep its name and parameters, but its code is different. Code of Python, femseal
and installed packages is identified by its name and version. Any other code is described by its bytecode, its constants
and its default values. The description also contains the values of the variables that the code uses from enclosing
functions and from its module. If a value cannot be described, `NoDigest` is raised. If a result depends on a value that
cannot be described, it is neither read from the store nor written to it.
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
#: Attributes of a class that do not influence the behaviour of its objects, or that follow from other attributes.
_NOT_CODE = {
    "__dict__",
    "__weakref__",
    "__doc__",
    "__module__",
    "__annotations__",
    "__abstractmethods__",
    "_abc_impl",
    "__dataclass_params__",
    "__dataclass_fields__",
    "__match_args__",
    "__parameters__",
    "__orig_bases__",
    "__firstlineno__",
    "__static_attributes__",
    "__annotate__",
    "__annotate_func__",
    "__annotations_cache__",
    "_is_protocol",
    "__protocol_attrs__",
}
#: Types of functions and methods that are written in C.
_C_FUNCTIONS = (
    types.BuiltinFunctionType,
    types.MethodDescriptorType,
    types.WrapperDescriptorType,
    types.ClassMethodDescriptorType,
    types.MethodWrapperType,
)
#: Modules whose universal functions, such as `numpy.exp`, do not know the name of their module.
_HOMES_OF_UFUNCS = ("numpy", "scipy.special")


class NoDigest(TypeError):
    """Report that a value cannot be described by plain data and therefore has no digest."""


class CodeDescription:
    """Describe the functions, classes and objects from which a digest is computed.

    A function or class that has already been described is represented by a number. Without numbers, the description of
    two functions that call each other would never end.
    """

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {}
        # Keeps a reference to each numbered object, because a new object could get the id of a deleted object.
        self._numbered: list[Any] = []

    def __call__(self, value: Any) -> Any:
        """Describe a value by a tuple of plain data and of values that the caller still has to describe.

        Raises
        ------
        NoDigest : the state of an object is unknown, for example because its class is written in C.
        """
        if not isinstance(value, types.FunctionType | type):
            return _describe_object(value)
        if id(value) in self._numbers:
            return "again", self._numbers[id(value)]
        self._numbers[id(value)] = len(self._numbers)
        self._numbered.append(value)
        if isinstance(value, type):
            return _describe_class(value)
        return _describe_function(value)


def is_known(module: str) -> bool:
    """Return whether the name and the version of a module identify its code.

    Modules of Python, of femseal and of installed packages are identified by name and version. Name and version do not
    identify a package installed in editable mode.
    """
    return _origin(module) is not None


def _origin(module: str) -> str | None:
    """Return the version of the package that installed a module, or None if no package did.

    The returned version is "" for modules of Python and femseal, because their versions are already part of every key
    in a store.
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
    """Return the names and versions of the packages that contain a top-level module, or None if there are none."""
    names = packages_distributions().get(top, [])
    return ", ".join(f"{name} {version(name)}" for name in sorted(names)) or None


def _describe_object(value: Any) -> Any:
    """Describe an object that is neither a class nor a Python function."""
    if isinstance(value, types.CodeType):
        return _describe_bytecode(value)
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
    if isinstance(
        value, tuple | list
    ):  # an instance of a subclass; tuples and lists themselves are plain data
        return "items", type(value), *value
    if isinstance(value, complex):
        return "complex", value.real, value.imag
    if value is Ellipsis or value is NotImplemented:
        return "constant", repr(value)
    if is_dataclass(value):
        return "object", type(value), _state(value)
    # functions compiled by numba, and functions whose results are cached
    wrapped = getattr(value, "py_func", getattr(value, "__wrapped__", None))
    if isinstance(wrapped, types.FunctionType):
        options = getattr(value, "targetoptions", {})
        return "wrapped", type(value).__qualname__, repr(sorted(options.items())), wrapped
    if callable(value):
        return _describe_c_function(value)
    raise NoDigest(type(value).__qualname__)


def _describe_c_function(function: Any) -> Any:
    """Describe a function written in C by its name and its class, or by its name and its module."""
    name = getattr(function, "__name__", None)
    bound_to = getattr(function, "__self__", None)
    if isinstance(bound_to, type):  # a class method, such as dict.fromkeys
        return "method", bound_to, name
    defined_in = getattr(function, "__objclass__", None)  # the class of a method, such as str.lower
    if isinstance(function, _C_FUNCTIONS) and defined_in is not None:
        return "method", defined_in, name
    own_module = getattr(function, "__module__", None)
    for module in [own_module] if own_module else _HOMES_OF_UFUNCS:
        origin = _origin(module)
        is_found = getattr(sys.modules.get(module), str(name), None) is function
        if origin is not None and is_found:
            return "function", module, name, origin
    raise NoDigest(f"{type(function).__qualname__} {name}")


def _describe_function(function: types.FunctionType) -> Any:
    """Describe a function by its name if its module is known, otherwise by its code and the values in the code."""
    name, module = function.__qualname__, function.__module__
    is_named = "<" not in name  # neither a lambda nor a function inside another
    if is_named and is_known(module):
        return "function", module, name, _origin(module)
    values = _values_used(function)
    used = [[key, values[key]] for key in sorted(values)]
    return "code", function.__code__, function.__defaults__, function.__kwdefaults__, used


def _describe_bytecode(code: types.CodeType) -> Any:
    """Describe a code object without its file name and line numbers, which have no effect on its results."""
    numbers = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
    names = [code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]
    return "bytecode", code.co_code, code.co_exceptiontable, numbers, names, code.co_consts


def _describe_class(kind: type) -> Any:
    """Describe a class by its name if its module is known, and otherwise by its attributes and base classes."""
    name, module = kind.__qualname__, kind.__module__
    if "<" not in name and is_known(module):
        return "class", module, name, _origin(module)
    attributes = [
        [name, value]
        for name, value in sorted(vars(kind).items())
        if name not in _NOT_CODE and not _is_generated_by_dataclass(value)
    ]
    field_names = [field.name for field in fields(kind)] if is_dataclass(kind) else []
    return "class", name, type(kind), list(kind.__bases__), field_names, attributes


def _is_generated_by_dataclass(value: Any) -> bool:
    """Return whether a method was generated by `dataclass` and is therefore determined by the fields of the class."""
    method = getattr(value, "__wrapped__", value)
    code = getattr(method, "__code__", None)
    return code is not None and code.co_qualname.startswith("__create_fn__")


def _state(value: Any) -> list[Any]:
    """Return the names and values of the fields of a dataclass object.

    For a user-defined class, attributes that are not fields are returned as well, except for values stored by
    `cached_property`.
    """
    kind = type(value)
    state = {field.name: getattr(value, field.name) for field in fields(value)}
    if not is_known(kind.__module__):
        for name, attribute in getattr(value, "__dict__", {}).items():
            descriptor = inspect.getattr_static(kind, name, None)
            if name not in state and not isinstance(descriptor, functools.cached_property):
                state[name] = attribute
    return [list(pair) for pair in state.items()]


def _values_used(function: types.FunctionType) -> dict[str, Any]:
    """Return the values, by name, that a function uses from enclosing functions and from its module.

    If the function uses another user-written module, the attributes of that module that it may use are returned as
    well. Variables without a value are left out, because using such a variable raises an error anyway.
    """
    values = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            values[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            continue
    names = set(_names(function.__code__))
    for name in names & function.__globals__.keys():
        value = function.__globals__[name]
        values[name] = value
        if isinstance(value, types.ModuleType) and not is_known(value.__name__):
            for attribute in names & vars(value).keys():
                values[f"{name}.{attribute}"] = vars(value)[attribute]
    return values


def _names(code: types.CodeType) -> Iterator[str]:
    """Yield the names of variables and attributes in a code object and in the functions defined inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)
