"""What the house measures: lines, files and rooms, and the counts by which a reader feels its complexity.

    python experiments/run_house.py            # a line a room, then the sums
    python experiments/run_house.py -v         # and the names behind each count
    python experiments/run_house.py -v studies report

Counted from the syntax of each file: private functions used once (`_name` that its file mentions once beside its
definition, and no other imports); constants (names bound to numbers, or tuples of them, at the top of a module); lines
with `Any`, imports apart; functions of more than seven parameters, `self` and `cls` apart.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ESTIMATOR = ("estimation", "shooting", "simulation", "logs", "diagnosis", "uneven")
MANY = 7
COUNTS = ("files", "functions", "used once", "constants", "Any", "many parameters")


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(path.read_text("utf-8"))))


def measured(files: list[Path], root: Path = ROOT) -> dict[str, list[str]]:
    """The places of each count in these files, as `file:line name`."""
    found: dict[str, list[str]] = {name: [] for name in COUNTS}
    imported = {alias.name for path in files for node in _nodes(path) if isinstance(node, ast.ImportFrom)
                for alias in node.names}  # fmt: skip
    for path in files:
        file, nodes = path.relative_to(root).as_posix(), _nodes(path)
        found["files"].append(file)
        names = [getattr(node, "id", getattr(node, "attr", "")) for node in nodes]
        uses = Counter(names)
        for node in nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                place, taken = f"{file}:{node.lineno} {node.name}", node.args
                found["functions"].append(place)
                private = node.name.startswith("_") and not node.name.endswith("__")
                if private and uses[node.name] == 1 and node.name not in imported:
                    found["used once"].append(place)
                parameters = {one.arg for one in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)}
                if len(parameters - {"self", "cls"}) > MANY:
                    found["many parameters"].append(place)
        lines = {node.lineno for node in nodes if isinstance(node, ast.Name) and node.id == "Any"}
        found["Any"] += [f"{file}:{line}" for line in sorted(lines)]
        assert isinstance(nodes[0], ast.Module)
        for statement in nodes[0].body:
            if isinstance(statement, ast.Assign | ast.AnnAssign) and _numeric(statement.value):
                targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                bound = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
                found["constants"] += [f"{file}:{statement.lineno} {name}" for name in bound]
    return found


def _numeric(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone: `1e-3`, `60 * 60`, `(1, 2.5)`."""
    allowed = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.operator, ast.unaryop, ast.expr_context)
    inside = () if value is None else tuple(ast.walk(value))
    numbers = [type(node.value) in (int, float) for node in inside if isinstance(node, ast.Constant)]
    return all(isinstance(node, allowed) for node in inside) and bool(numbers) and all(numbers)


def rooms() -> dict[str, list[Path]]:
    """Files of each room: the folders of identify, the modules beside them, and data_io."""
    found: dict[str, list[Path]] = {}
    for path in sorted((ROOT / "identify").rglob("*.py")):
        parts = path.relative_to(ROOT / "identify").parts
        found.setdefault(parts[0].removesuffix(".py").strip("_"), []).append(path)
    return {**found, "data_io": sorted((ROOT / "data_io").rglob("*.py"))}


def main(fast: bool = False, names: bool = False, only: tuple[str, ...] = ()) -> None:
    """Print a line a room, and the sums where `only` names no rooms; fast: of two small rooms."""
    every, only = rooms(), ("base", "scene") if fast else only
    sets = {room: every[room] for room in only or every}
    if not only:
        sets["the estimator"] = [path for room in ESTIMATOR for path in every[room]]
        sets["identify"] = [path for room, files in every.items() if room != "data_io" for path in files]
    print(f"{'':14}{'lines':>8}" + "".join(f"{name:>{len(name) + 2}}" for name in COUNTS))
    for room, files in sets.items():
        found, lines = measured(files), sum(len(path.read_text("utf-8").splitlines()) for path in files)
        print(f"{room:14}{lines:>8,}" + "".join(f"{len(found[name]):>{len(name) + 2},}" for name in COUNTS))
        if names and room in every:
            for name in COUNTS[2:]:
                print(f"\n{room}, {name}: {len(found[name])}\n" + "".join(f"  {at}\n" for at in found[name]), end="")


if __name__ == "__main__":
    main(names="-v" in sys.argv, only=tuple(word for word in sys.argv[1:] if word != "-v"))
