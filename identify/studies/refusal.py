"""What is wrong with a batch before it begins: every complaint at once."""

from __future__ import annotations

from collections.abc import Sequence

from identify.base.errors import IdentifyError


class BatchError(IdentifyError):
    """A batch cannot begin. `complaints` holds one sentence per thing to mend; the text counts them."""

    def __init__(self, complaints: Sequence[str]) -> None:
        self.complaints = tuple(complaints)
        first, number = self.complaints[0], len(self.complaints)
        super().__init__(first if number == 1 else f"{number} things to mend, first {first}")
