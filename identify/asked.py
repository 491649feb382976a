"""What a user asks of a fit beyond its values: how finely, and which further looks at how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

from identify.accuracy import DEFAULT, Accuracy


@dataclass(frozen=True)
class Asked:
    """accuracy: of the integration; profile: every parameter by its profile likelihood; bootstrap: replicates, 0 for
    none; accuracy_table: what each level costs and changes; effects_table: the fit with and without each effect."""

    accuracy: Accuracy = DEFAULT
    profile: bool = False
    bootstrap: int = 0
    accuracy_table: bool = False
    effects_table: bool = False


NOTHING_MORE = Asked()
