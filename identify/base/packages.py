"""Whether the packages that were installed together are found together."""

import importlib.util
from pathlib import Path


def check_data_io() -> None:
    """Look whether `data_io`, without which nothing here works, is the package that was installed with this one.

    Raises:
        ImportError: a file or folder of that name stands before it on the path, beside the user's script as a rule.
    """
    spec = importlib.util.find_spec("data_io")
    found = None if spec is None or spec.origin is None else Path(spec.origin).resolve()
    if found is None:
        raise ImportError(
            "the package data_io is not there; it is installed with identify: install the workbench again"
        )
    if found != (Path(__file__).parents[2] / "data_io" / "__init__.py").resolve():
        raise ImportError(f"data_io is {found}, not the package of the workbench, which it hides: rename that file")
