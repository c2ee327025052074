"""Texts with columns: the numbers of their lines, and texts that cannot be read."""

import pytest

from femseal.base import InputError
from femseal.base.text_columns import read_columns, text_rows


@pytest.fixture
def file(tmp_path):
    return tmp_path / "table.csv"


def test_rows_have_the_numbers_of_their_lines_in_the_file(file):
    file.write_text('# head\nname,x\n"two\nlines",1\n\n# comment\nlast,2\n')
    numbers, texts, entries = zip(*text_rows(file), strict=True)
    assert numbers == (2, 3, 7)
    assert texts == ("name,x", '"two lines",1', "last,2")
    assert entries == (["name", "x"], ["two\nlines", "1"], ["last", "2"])


def test_a_number_with_a_line_break_is_refused(file):
    file.write_text('x,y\n"1\n2",3\n')
    with pytest.raises(InputError, match="expected numbers with decimal points"):
        read_columns(file, ("x", "y"))


def test_a_column_of_too_many_characters_is_refused(file):
    file.write_text(f"x,y\n1,2\n{'1' * 200_000},2\n")
    with pytest.raises(InputError, match=r"with the line 3 \(field larger than field limit"):
        read_columns(file, ("x", "y"))
