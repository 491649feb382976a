"""What the tests of the batch share with the trials of it."""

from experiments.batch_trials import (
    ROOT,
    SCENE,
    STUB,
    alive,
    children,
    environment,
    kill,
    put,
    result_of,
    started,
    wait_for,
    write_case,
)

__all__ = [
    "ROOT", "SCENE", "STUB", "Silent", "alive", "children", "environment", "kill", "put", "result_of", "started",
    "wait_for", "write_case",
]  # fmt: skip


class Silent:
    """Hears how far a batch is and keeps it."""

    def __init__(self):
        self.heard = []

    def begins(self, total, kept):
        self.heard.append(("begins", total, kept))

    def ended(self, group, end, done, total, remaining):
        self.heard.append((group, end.status, done, total, remaining))

    def tick(self):
        pass
