"""Every message that the page of troubleshooting quotes is one that the package says."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
#: Messages stand in the first column; "…" is what varies.
QUOTED = re.findall(r"(?m)^\| `([^`]+)` \|", TEXT)
VARIES = "\x00"


def said_in(tree):
    """Texts of a module as they are said, each with a mark where a value goes in."""
    nodes = list(ast.walk(tree))
    parts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    parts |= {
        id(node.value) for node in nodes if isinstance(node, ast.Expr)
    }  # docstrings are not said
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            yield "".join(
                part.value if isinstance(part, ast.Constant) else VARIES for part in node.values
            )
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts
        ):
            yield node.value


@pytest.fixture(scope="module")
def messages():
    modules = sorted((ROOT / "femseal").rglob("*.py"))
    return [
        text for path in modules for text in said_in(ast.parse(path.read_text(encoding="utf-8")))
    ]


def test_the_page_quotes_messages():
    assert len(set(QUOTED)) == len(QUOTED) >= 20


@pytest.mark.parametrize("message", QUOTED)
def test_a_quoted_message_stands_in_the_code(message, messages):
    asked = re.compile(".*".join(map(re.escape, message.split("…"))), re.DOTALL)
    assert any(map(asked.search, messages))


def test_what_is_not_said_is_not_found(messages):
    assert not any("the seal leaks because" in text for text in messages)
