"""Numbers as people say them."""

from typing import Final

MOST_PERCENT: Final = 10.0
"""Share above which percents say less than "times"."""


def percent(share: float, digits: int = 0, *, signed: bool = False, of: str = "") -> str:
    """Return a share as "12 %" or "12 % of 3 N"; never as "-0 %", and many times the whole as "2000 times 3 N"."""
    if abs(share) > MOST_PERCENT:
        size = f"{share:+.3g}" if signed else f"{share:.3g}"
        times = "many times" if "e" in size or "inf" in size else f"{size} times"
        return f"{times} {of}".rstrip()
    return f"{100 * share:{'+' if signed else ''}z.{digits}f} %" + (f" of {of}" if of else "")
