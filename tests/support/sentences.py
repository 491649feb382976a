"""The sentences that a module refuses with, as patterns, read off its source."""

import ast
import re

REFUSING = ("LogError", "UnitError", "error", "fail", "_error", "_damaged")
LEAST = 12  # characters of its own that tell a sentence from others


def sentences_in(source, refusing=REFUSING):
    """The sentences that a module refuses with, as patterns; those it puts together elsewhere are looked up there."""
    tree = ast.parse(source)
    functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    within = {id(inner): node for node in functions.values() for inner in ast.walk(node)}
    for node in ast.walk(tree):
        name = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
        if name in refusing:
            for argument in node.args:
                yield from _patterns(argument, within.get(id(node)), functions)


def _patterns(value, function, functions):
    if isinstance(value, (ast.Constant, ast.JoinedStr)):
        parts = value.values if isinstance(value, ast.JoinedStr) else [value]
        texts = [part.value if isinstance(part, ast.Constant) else None for part in parts]
        if all(isinstance(text, (str, type(None))) for text in texts) and len("".join(filter(None, texts))) >= LEAST:
            yield ".*".join(re.escape(" ".join(text.split())) for text in texts if text and text.strip())
    elif isinstance(value, ast.Name) and function is not None:
        for node in ast.walk(function):
            if isinstance(node, ast.Assign) and any(getattr(t, "id", "") == value.id for t in node.targets):
                yield from _patterns(node.value, None, functions)
    elif isinstance(value, ast.Call) and getattr(value.func, "id", "") in functions:
        called = functions[value.func.id]
        for node in ast.walk(called):
            if isinstance(node, ast.Return) and node.value is not None:
                yield from _patterns(node.value, called, functions)


def advising(source):
    """All sentences of a module with a remedy, which stands behind a semicolon, as patterns."""
    tree = ast.parse(source)
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, (ast.Constant, ast.JoinedStr)) and id(node) not in docstrings | inner:
            yield from (pattern for pattern in _patterns(node, None, {}) if r";\ " in pattern)
