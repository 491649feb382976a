"""Names that must not meet twice."""

from collections.abc import Collection


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it where it is already taken."""
    if name not in taken:
        return name
    return next(other for i in range(2, len(taken) + 3) if (other := f"{name} ({i})") not in taken)
