"""What a misfit that nothing explains may come of, of what the scene leaves unsaid: groups that share what differs
between them, and effects that are left out."""

from __future__ import annotations

from collections.abc import Iterator

from identify.effects import MAIN
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.scene import Scene

NAMED = 3  # values of a label that are listed


def left_unsaid(scene: Scene) -> str:
    """What to try, to go behind a sentence on a misfit; "" where the scene leaves nothing unsaid."""
    return "".join(f"; or {each}" for each in (*_shared(scene), *_left_out(scene)))


def _shared(scene: Scene) -> Iterator[str]:
    """A sentence for each label by which logs differ, and parameters could."""
    shared = [
        name
        for name, spec in scene.parameters.items()
        if name not in RIG_PARAMETERS and (spec.per, spec.fixed, spec.tie) == (None, None, None)
    ]
    labels = dict.fromkeys(label for log in scene.logs for label in log.labels)
    for label in labels if shared else ():
        values = list(dict.fromkeys(log.labels.get(label, "") for log in scene.logs))
        if len(values) < 2 or "" in values:
            continue
        of = listed(values) if len(values) <= NAMED else f"{len(values)} values"
        yield (
            f"{listed(shared, 'or')} differs by {label} ({of}) and is shared: give it "
            f'one value each, [parameters] {shared[0]} = {{ per = "{label}" }}'
        )


def _left_out(scene: Scene) -> Iterator[str]:
    """A sentence where the scene leaves out effects that most contacts have."""
    missing = [name for name in MAIN if scene.effects != "auto" and name not in scene.effects]
    if missing:
        yield (
            f"the scene leaves out an effect that matters ({', '.join(missing)}): add it to effects, or see which the "
            'data ask for with effects = "auto"'
        )
