"""What each effect costs in numbers counted, and the table of effects of docs/effects.md.

Costs are counted on the composed model, with the effect and without it.

python experiments/run_effect_table.py [--docs]    --docs: write the tables of docs/effects.md
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import casadi as ca

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from identify.effects import ALL
from identify.effects.quantities import Effect, Parameter
from identify.model.model import assemble
from tests.support import effects_case

PAGE = Path(__file__).resolve().parents[1] / "docs" / "effects.md"
MARK = "<!-- {}: written by experiments/run_effect_table.py --docs -->"
END = "<!-- end -->"
COUNTED = ("slip", "rest", "grip", "load_cell")


def number(value: float) -> str:
    """A number as people write it."""
    return f"{value:.4g}".replace("e-0", "e-").replace("e+0", "e")


def parameter(q: Parameter) -> str:
    """Name, default with unit, and how it is taken."""
    unit = f" {q.unit}" if q.unit else ""
    kind = {"friction": "", "rig": ", [rig]", "given": ", given"}[q.kind]
    return f"`{q.name}` {number(q.default)}{unit}{kind}"


def null(effect: Effect) -> str:
    """The values at which it is as good as absent."""
    told = []
    for name, value in effect.null.items():
        q = next(q for q in effect.parameters if q.name == name)
        sign = "=" if q.lower <= value <= q.upper else "→"
        told.append(f"{name} {sign} {number(value).replace('inf', '∞')}")
    return ", ".join(told) or "normal force constant"


def effects_table() -> list[str]:
    """What the effects say, bring and come from: the rows of a markdown table."""
    rows = [
        "| effect | says | parameters (default) | states | absent at | excludes, needs | source |",
        "|" + " --- |" * 7,
    ]
    for e in ALL:
        rivals = [r.name for r in ALL if e.role and r.role == e.role and r is not e]
        bounds = [f"not with {', '.join(rivals)}"] * bool(rivals) + [f"needs {', '.join(e.needs)}"] * bool(e.needs)
        cells = (
            f"`{e.name}`",
            e.says,
            "<br>".join(parameter(q) for q in e.parameters) or "none",
            ", ".join(f"`{s.name}`" + f" {s.unit}" * bool(s.unit) for s in e.states) or "none",
            null(e),
            "; ".join(bounds),
            e.source,
        )
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def counted(names: tuple[str, ...]) -> list[int]:
    """Of one composition: states and parameters of the model, instructions by function of COUNTED."""
    model = assemble(names)
    return [len(model.states), len(model.parameters), *(getattr(model, name).n_instructions() for name in COUNTED)]


def cost_table(effects: tuple[Effect, ...] = ALL) -> list[str]:
    """Counts of the main effects without rivals of an effect, without and with it: the rows of a markdown table."""
    heads = ("effect", "states", "parameters", *COUNTED)
    rows = ["| " + " | ".join(heads) + " |", "| --- |" + " ---: |" * (len(heads) - 1)]
    for e in effects:
        less = effects_case.without(e)
        counts = zip(counted(less), counted((*less, e.name)), strict=True)
        rows.append(f"| `{e.name}` | " + " | ".join(f"{a}" if a == b else f"{a} → {b}" for a, b in counts) + " |")
    return rows


def page_with(tables: dict[str, list[str]], text: str) -> str:
    """The page with these tables in their places."""
    for name, rows in tables.items():
        head = MARK.format(name)
        pattern = re.escape(head) + r"\n.*?" + re.escape(END)
        text, count = re.subn(pattern, lambda _, h=head, r=rows: "\n".join([h, *r, END]), text, flags=re.DOTALL)
        if count != 1:
            raise ValueError(f"{PAGE.name} holds {count} places for the table {name!r}; expected one")
    return text


def page_tables() -> dict[str, list[str]]:
    """The tables of docs/effects.md; counts hold for one version of CasADi, which is said."""
    version = f"Counted with CasADi {ca.__version__}."
    return {"effects": effects_table(), "costs": [*cost_table(), "", version]}


def main(fast: bool = False) -> None:
    """Print the costs; fast: of a few effects."""
    print(f"# Effects: what each costs\n\n{describe()}\n")
    print("\n## Costs, counted: without → with\n")
    print("\n".join(cost_table(ALL[3:5] if fast else ALL)))


if __name__ == "__main__":
    if "--docs" in sys.argv:
        PAGE.write_text(page_with(page_tables(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        main(fast="--fast" in sys.argv)
