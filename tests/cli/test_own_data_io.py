"""A file of the user's that is called as one of our packages is named in a sentence, whichever way in is taken."""

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize("name", ["data_io.py", "data_io/__init__.py"])
@pytest.mark.parametrize("way", [["-c", "from identify import fit"], ["-m", "identify", "inspect", "log.csv"]])
def test_a_file_that_hides_a_package_is_named(tmp_path, request, name, way):
    own = tmp_path / name
    own.parent.mkdir(exist_ok=True)
    own.write_text("def load(p):\n    return open(p).read()\n")
    environment = os.environ | {"PYTHONPATH": str(request.config.rootpath)}
    ended = subprocess.run([sys.executable, *way], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert f"data_io is {own.resolve()}, not the package" in ended.stderr.splitlines()[-1]
    assert ended.returncode == (2 if "-m" in way else 1)
    own.unlink()
    ended = subprocess.run([sys.executable, *way], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "data_io is" not in ended.stderr
