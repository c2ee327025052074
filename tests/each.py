"""Many quick checks of one kind as one test, which names the values that fail."""

import functools
import inspect


def each(names, values):
    """Like `pytest.mark.parametrize`, but all values within one test: for tests without files and patches of their own."""
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    values = list(values)
    if not values:
        raise ValueError(f"no values of {', '.join(names)}")

    def decorate(test):
        @functools.wraps(test)
        def with_all_of_them(*arguments, **fixtures):
            for value in values:
                given = dict(zip(names, value if len(names) > 1 else (value,), strict=True))
                try:
                    test(*arguments, **given, **fixtures)
                except BaseException as failure:
                    failure.add_note(
                        f"with {', '.join(f'{name} = {text!r}' for name, text in given.items())}"
                    )
                    raise

        signature = inspect.signature(test)
        others = [p for name, p in signature.parameters.items() if name not in names]
        with_all_of_them.__signature__ = signature.replace(parameters=others)
        return with_all_of_them

    return decorate
