"""The house is in order: the field's words in names, functions and files that can be read at once, few parameters a kernel."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import antway

SOURCE = Path(antway.__file__).resolve().parent
MOST_LINES_OF_A_FUNCTION = 100
MOST_LINES_OF_A_FILE = 450
MOST_PARAMETERS_OF_A_KERNEL = 12
REASON = re.compile(r"#.*\b(lines|parameters)\b.*\b(because|so that|measured)\b", re.IGNORECASE)

# Words of the project's own that stood where the field has terms (docs/architecture.md). Words that are right elsewhere
# ("tests", "bound", "moves", "place") cannot be told apart by their letters and are not here.
FORBIDDEN = {
    *("way", "ways", "rival", "rivals", "room", "rooms", "piece", "pieces", "berth", "reach", "lag", "surge"),
    *("usual", "belief", "beliefs", "book", "course", "courses", "commitment", "gain", "stray", "squad"),
    *("ground", "labour", "fade", "fades", "share", "shares", "heat", "regret", "flips", "stretch", "survival"),
    *("survive", "wave", "waves", "strip", "strips", "ladder", "climb", "lane", "lanes", "wish", "wishes", "told"),
    *("said", "patience", "desk", "errand", "begin", "begins", "begun", "who"),
}
# Names that have such a word in another meaning, each with its reason; of a file alone after its path.
ALLOWED = {
    "obstacle_surge": "a public option that the README shows",
    "gain": "what a move of 2-opt or a relaxation gains, the word of the literature",
    "share": "a part of a whole, in [0, 1]",
    "shares": "parts of a whole",
    "LINE_STRIP": "a name of ROS",
    "PATIENCE_EXCEEDED": "a name of ROS",
    "kernels/robot/reach.py reach": "the places that a robot can come to",
    "kernels/robot/reach.py reach_gap_along": "as reach",
    "web/server.py on_message_begin": "a name of httptools",
    "kernels/robot/guard.py reach": "as in kernels/robot/reach.py",
    "kernels/robot/guard.py within_reach": "as reach",
    "policies/guard.py _within_reach": "as reach",
    "gain_of": "as gain",
    "strip_figure": "a public name; a strip of pictures",
    "arena/environments.py rooms": "of a building",
}


def files() -> list[Path]:
    """All Python files of the package."""
    return sorted(SOURCE.rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    """The tree of a file, which several checks walk."""
    return ast.parse(path.read_text(encoding="utf-8"))


def names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """The line and the name of whatever a file gives a name to."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def words(name: str) -> set[str]:
    """The words of a name in snake case or camel case, in small letters."""
    return set(re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().split("_"))


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods."""
    return (node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)))


def has_reason(lines: list[str], node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Tell whether a comment right above a function, or in it, says why it has so many lines or parameters."""
    first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
    return any(REASON.search(line) for line in lines[max(first - 4, 0) : node.end_lineno])


def is_kernel(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Tell whether Numba compiles a function."""
    return any(ast.unparse(one) in ("kernel", "bare_kernel", "inner_kernel") for one in node.decorator_list)


def test_names_are_the_fields_words() -> None:
    """No name has one of the words that stood where the field has terms, but for a few with a reason."""
    found = []
    for path in files():
        home = path.relative_to(SOURCE).as_posix()
        for line, name in names(parsed(path)):
            if words(name) & FORBIDDEN and not {name, f"{home} {name}"} & set(ALLOWED):
                found.append(f"{home}:{line} {name}")
    assert not found, "\n".join(found)


def test_functions_are_short() -> None:
    """No function has more than 100 lines besides its docstring, but with a comment that says why."""
    found = []
    for path in files():
        text = path.read_text(encoding="utf-8")
        for node in functions(parsed(path)):
            described = node.body[0] if ast.get_docstring(node) else None
            length = (node.end_lineno or 0) - node.lineno + 1
            if described is not None:
                length -= (described.end_lineno or 0) - described.lineno + 1
            if length > MOST_LINES_OF_A_FUNCTION and not has_reason(text.splitlines(), node):
                found.append(f"{path.relative_to(SOURCE)}:{node.lineno} {node.name}: {length} lines")
    assert not found, "\n".join(found)


def test_kernels_have_few_parameters() -> None:
    """What travels together is a record, unless a comment says what was measured against it."""
    found = []
    for path in files():
        text = path.read_text(encoding="utf-8")
        for node in functions(parsed(path)):
            count = len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs)
            if is_kernel(node) and count > MOST_PARAMETERS_OF_A_KERNEL and not has_reason(text.splitlines(), node):
                found.append(f"{path.relative_to(SOURCE)}:{node.lineno} {node.name}: {count} parameters")
    assert not found, "\n".join(found)


def test_files_are_short() -> None:
    """No file has more than one subject."""
    lengths = {str(path.relative_to(SOURCE)): len(path.read_text(encoding="utf-8").splitlines()) for path in files()}
    assert not {name: length for name, length in lengths.items() if length > MOST_LINES_OF_A_FILE}


def test_the_checks_can_fail() -> None:
    """Each check finds what it is there to find."""
    tree = ast.parse("def wayOut(squad_size, fine):\n    self.regret = 1\n    path = 2\n")
    assert {name for _, name in names(tree) if words(name) & FORBIDDEN} == {"wayOut", "squad_size", "regret"}
    node = next(functions(ast.parse("# Many parameters because records were measured to cost 2 us.\n@kernel\ndef f(a): pass")))
    assert is_kernel(node) and has_reason(["# Many parameters because records were measured to cost 2 us.", "@kernel"], node)
    assert not has_reason(["# Drives the robot.", "@kernel", "def f(a): pass"], node)
