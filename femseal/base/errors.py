"""Define the errors that femseal raises: bad input, iterations that did not converge, results that cannot be stored."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from enum import Enum
from reprlib import Repr
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from pathlib import Path

#: Longest user text that a message repeats [characters]. The middle of a longer text is left out.
_LONGEST = 160
#: Largest number of inputs that one message lists.
_MOST_FAULTS = 20
#: Name at the beginning of a text; "" if the text begins with another character.
_WORD = re.compile(r"\w*")
#: Shortens the representation of long lists, texts and numbers.
_SHORT_REPR = Repr()
_SHORT_REPR.maxstring = 80
_SHORT_REPR.maxother = 80
_SHORT_REPR.maxlong = 80


class _Absent(Enum):
    """Type of `MISSING`, which differs from every value that a user can give, also from the text "missing"."""

    MISSING = "missing"

    def __str__(self) -> str:
        return self.value


#: Value of `InputError.given` when a required input is absent.
MISSING = _Absent.MISSING


class FemsealError(Exception):
    """Base class of all errors that femseal raises on purpose.

    Attributes
    ----------
    exit_code : int
        Exit code of a command that ends with this error.
    """

    exit_code = 1


class NotKept(FemsealError):
    """Report that results cannot be written or read.

    This error stops a run, because a run that cannot store its results could not be resumed later.
    """


class InputError(FemsealError, ValueError):
    """Report an input that cannot be used.

    Parameters
    ----------
    what : str
        Name of the input.
    given : object
        The value that the user has given. Use "" if the value would not help the reader of the message, and `MISSING`
        if the user has given no value.
    expected : str
        Description of the values that are accepted.
    suggested : mapping, optional
        Values that the text `expected` suggests for other arguments, by argument name. The placeholder "{name}" in the
        text stands for "name=value", or for the key and the value in a case.

    Examples
    --------
    >>> str(InputError("pressure", -1.0, "a number >= 0 [Pa]"))
    'pressure: given -1.0, expected a number >= 0 [Pa]'
    """

    exit_code = 2

    def __init__(
        self, what: str, given: object, expected: str, suggested: Mapping[str, Any] | None = None
    ) -> None:
        self.what, self.given = what, given
        self.suggested = dict(suggested or {})
        self._template = expected
        self.expected = self._with_suggestions({})
        super().__init__(what, given, self.expected)

    def __str__(self) -> str:
        given = shortened(self.given)
        if given == "":
            description = ""
        elif self.given is MISSING:
            description = "missing, "
        else:
            description = f"given {given}, "
        return f"{shortened(self.what)}: {description}expected {self.expected}"

    def inside(self, table: str) -> Self:
        """Return a copy of the error whose input name is prefixed with the table, as in "load.map"."""
        return self._with(what=f"{table}.{self.what}")

    def with_keys(self, keys: Mapping[str, str]) -> Self:
        """Return a copy of the error that names the keys of the case file instead of the arguments.

        The key of an argument replaces its name, which is the first word of `what`, and its name in suggestions in
        `expected`.

        keys : key in the case file of each argument, by the name of the argument.

        >>> error = InputError("wave", "1 µm", "2 µm, or {shape}", {"shape": (4, 8)})
        >>> error.expected
        '2 µm, or shape=(4, 8)'
        >>> str(error.with_keys({"wave": "surface.shortest_wave", "shape": "surface.points"}))
        'surface.shortest_wave: given 1 µm, expected 2 µm, or surface.points = [4, 8]'
        """
        # "wave" is the argument in "wave" and in "wave of the first face", but not in "wavelength" or "wave_number"
        argument = _WORD.match(self.what)[0]  # type: ignore[index]
        what = self.what
        if argument in keys:
            what = f"{keys[argument]}{self.what.removeprefix(argument)}"
        expected = self._with_suggestions(keys)
        return self._with(what=what, expected=expected, _template=expected, suggested={})

    def _with(self, **changes: Any) -> Self:
        """Return a copy of the error, of the same class, with some attributes changed."""
        return _remade(type(self), {**vars(self), **changes})

    def _with_suggestions(self, keys: Mapping[str, str]) -> str:
        """Return the description of accepted values, and insert the suggested values of arguments or of case keys."""
        expected = self._template
        for name, value in self.suggested.items():
            text = f"{name}={value}"
            if name in keys:
                # TOML has arrays in place of tuples
                value_in_case = list(value) if isinstance(value, tuple) else value
                text = f"{keys[name]} = {value_in_case}"
            expected = expected.replace(f"{{{name}}}", text)
        return expected

    def __reduce__(self) -> tuple[Any, ...]:
        # a given object may not be picklable, but its text always is
        given = MISSING if self.given is MISSING else shortened(self.given)
        return _remade, (type(self), {**vars(self), "given": given})


class FileError(InputError):
    """Report a file that cannot be used.

    Parameters
    ----------
    path : Path
        The file.
    what, given, expected : as in `InputError`
    """

    def __init__(self, path: Path, what: str, given: object, expected: str) -> None:
        self.path = path
        super().__init__(what, given, expected)


class InputErrors(InputError):
    """Report several inputs that cannot be used.

    The attributes `what`, `given` and `expected` refer to the first of them.

    Parameters
    ----------
    faults : sequence of InputError
        One error for each input.
    """

    def __init__(self, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        super().__init__(faults[0].what, faults[0].given, faults[0].expected)

    def __str__(self) -> str:
        lines = [str(fault) for fault in self.faults[:_MOST_FAULTS]]
        omitted = len(self.faults) - len(lines)
        if omitted == 1:
            lines.append("1 more fault")
        elif omitted > 1:
            lines.append(f"{omitted} more faults")
        return "\n".join(lines)

    def inside(self, table: str) -> Self:
        """Return a copy in which the table is prefixed to the input names of all faults."""
        return type(self)([fault.inside(table) for fault in self.faults])

    def with_keys(self, keys: Mapping[str, str]) -> Self:
        """Return a copy in which all faults name the keys of the case file instead of the arguments."""
        return type(self)([fault.with_keys(keys) for fault in self.faults])


def _remade(kind: Any, attributes: Mapping[str, Any]) -> Any:
    """Make an error of a class from its attributes, without calling the constructor of the class.

    The constructors of subclasses have different parameters from the constructor of `InputError`. A subclass must
    therefore keep what it needs in its attributes; these must be picklable.
    """
    error = kind.__new__(kind)
    vars(error).update(attributes)
    error.args = (error.what, error.given, error.expected)
    return error


def shortened(value: object, longest: int = _LONGEST) -> str:
    """Return a value as one line of text for a message, omitting the middle if it is long.

    Examples
    --------
    >>> shortened("a" * 20, 9)
    'aaaa…aaaa'
    """
    text = str(value)
    if not text.isprintable():
        # line breaks and control characters are written as escape sequences
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if len(text) <= longest:
        return text
    half = (longest - 1) // 2
    return f"{text[:half]}…{text[-half:]}"


def shown(value: object) -> str:
    """Return a short `repr` of a value for a message, even for long or deeply nested values."""
    try:
        return shortened(_SHORT_REPR.repr(value))
    except ValueError:
        # Python refuses to convert integers of thousands of digits to text
        return "a number of too many digits"


class NotConverged(FemsealError, RuntimeError):
    """Report an iteration that did not converge.

    Parameters
    ----------
    message : str
        Message that states the residual that was reached and what the user can try.
    residual : float
        Residual after the last iteration; NaN if the iteration has no residual.
    """

    def __init__(self, message: str, residual: float = float("nan")) -> None:
        super().__init__(message)
        self.residual = residual
