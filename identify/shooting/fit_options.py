"""What a user asks of a fit beyond its values: how finely, and which further looks at how sure it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from identify.base.errors import FitError
from identify.shooting.accuracy import DEFAULT, Accuracy, accuracy_of


@dataclass(frozen=True)
class Asked:
    """accuracy: of the integration; profile: every parameter by its profile likelihood; bootstrap: replicates, 0 for
    none; accuracy_table: what each level costs and changes; effects_table: the fit with and without each effect."""

    accuracy: Accuracy = DEFAULT
    profile: bool = False
    bootstrap: int = 0
    accuracy_table: bool = False
    effects_table: bool = False

    def document(self) -> dict[str, Any]:
        """All of it, for provenance; only accuracy and profile decide the numbers, and `again` reads no more."""
        return asdict(self) | {"accuracy": self.accuracy.name}

    @staticmethod
    def again(document: Any) -> Asked:
        """What a stored result asked for; the default where it says nothing that can be read.

        Args:
            document: "asked" of its provenance, or whatever stands there.
        """
        told = document if isinstance(document, Mapping) else {}
        try:
            accuracy = accuracy_of(str(told.get("accuracy", DEFAULT.name)))
        except FitError:
            accuracy = DEFAULT
        return Asked(accuracy=accuracy, profile=told.get("profile") is True)


NOTHING_MORE = Asked()
