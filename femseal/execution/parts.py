"""Parts of a run: which of the items of a stage each of several processes without a common scheduler computes.

Part 3 of 16 computes the third sixteenth of the items of every stage, consecutive ones. A stage of
fewer items than parts leaves some without work.
"""

import re
from collections.abc import Iterable

from ..base import InputError, PartsMissing, shown

#: Number of a part, from 1, and how many there are.
Part = tuple[int, int]
#: Most parts.
MOST_PARTS = 100_000


def parsed_part(text: str | None) -> Part | None:
    """The part that a text such as "3/16" names; None without one.

    Raises InputError: the text is none of that kind.

    >>> parsed_part("3/16")
    (3, 16)
    """
    if text is None:
        return None
    if not (found := re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip(), re.ASCII)):
        raise InputError("part", shown(text), "a number and how many parts there are, such as 3/16")
    return checked_part((int(found[1]), int(found[2])))


def checked_part(part: Part) -> Part:
    """A part with a number from 1 to how many there are; else InputError."""
    whole = isinstance(part, (tuple, list)) and [type(number) for number in part] == [int, int]
    if not whole or not 1 <= part[0] <= part[1] <= MOST_PARTS:
        expected = f"a number and how many parts there are, such as (3, 16): from 1 on, at most {MOST_PARTS} parts"
        raise InputError("part", shown(part), expected)
    return part[0], part[1]


def own_items(part: Part, count: int) -> tuple[int, int]:
    """First of the items that are a part's own, and the one after its last.

    >>> [own_items((n, 3), 7) for n in (1, 2, 3)]
    [(0, 3), (3, 5), (5, 7)]
    """
    number, parts = part
    return -(-(number - 1) * count // parts), -(-number * count // parts)


def parts_of(items: Iterable[int], part: Part, count: int) -> list[int]:
    """Numbers of the parts whose own some items are, of as many as a part is of.

    >>> parts_of([0, 2, 3], (1, 3), 7)
    [1, 2]
    """
    return sorted({n * part[1] // count + 1 for n in items})


def missing_parts(part: Part, stage: str, missing: list[int]) -> PartsMissing:
    """What to say of a stage of which a part has done its own items, and others have not."""
    shown_ones = ", ".join(map(str, missing[:20])) + (
        f" and {len(missing) - 20} more" if len(missing) > 20 else ""
    )
    named = f"{'part' if len(missing) == 1 else 'parts'} {shown_ones} of {part[1]}"
    return PartsMissing(
        f"part {part[0]}/{part[1]}: '{stage}' needs {named}; run this part again after them"
    )
