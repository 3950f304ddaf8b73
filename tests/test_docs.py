"""What `help()` shows at run time is what the stub tells editors, and no public name goes without."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

import physinc
from physinc import _physinc

STUB = Path(physinc.__file__).with_name("_physinc.pyi")


def words(text: str | None) -> str:
    """Text without the marks and line breaks in which the two languages differ."""
    return " ".join((text or "").replace("`", "").split())


def members(scope: ast.Module | ast.ClassDef, there: object, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Path, docstring in the stub and at run time, of what the stub documents."""
    for node in scope.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            thing = inspect.getattr_static(there, node.name, None)
            if told := ast.get_docstring(node):
                yield path + node.name, words(told), words(thing.__doc__)
            if isinstance(node, ast.ClassDef):
                yield from members(node, thing, f"{path}{node.name}.")


DOCUMENTED = list(members(ast.parse(STUB.read_text(encoding="utf-8")), _physinc))


@pytest.mark.parametrize(("told", "shown"), [pytest.param(told, shown, id=path) for path, told, shown in DOCUMENTED])
def test_the_stub_says_what_help_shows(told: str, shown: str) -> None:
    """The two are written in different files."""
    assert shown == told


@pytest.mark.parametrize("name", [name for name in physinc.__all__ if not name.startswith("__")])
def test_public_names_are_documented(name: str) -> None:
    """A class and each of its public members, a function, an exception."""
    thing = getattr(physinc, name)
    assert words(thing.__doc__), name
    if inspect.isclass(thing):
        bare = [
            key
            for key, value in vars(thing).items()
            if not key.startswith("_") and callable(getattr(value, "__get__", None)) and not value.__doc__
        ]
        assert not bare


def test_the_first_example_of_the_readme_tells_of_all_it_names(capsys: pytest.CaptureFixture[str]) -> None:
    """Surfaces that were found have no name."""
    readme = Path(__file__).parent.parent / "README.md"
    (code,) = re.findall(r"## In Python\n\n((?:    .*\n|\n)+)", readme.read_text(encoding="utf-8"))
    exec(textwrap.dedent(code), {})
    told = capsys.readouterr().out
    assert told.count("a bounce at ") >= 10
    assert re.search(r"^surface 0$", told, re.MULTILINE)
    assert re.search(r"^surface 1, 0\.0[89]\d m above surface 0$", told, re.MULTILINE)
    assert "None" not in told
