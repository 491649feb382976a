"""`stickslip cache`: says what is kept, removes it."""

import json

from identify.base import native
from identify.cli import main as cli


def test_what_is_kept_is_said_and_removed(machine_code, capsys):
    base = native.folder()
    assert base is not None
    (base / f"wide-{1:040}.0123456789abcdef.so").write_bytes(bytes(2_500_000))
    (base / f"plain-{2:040}.failed").touch()
    (base / "notes.txt").write_text("mine")
    assert cli.main(["cache"]) == 0
    assert f"{base}: 2 files, 2.5 MB of at most 64 MB" in capsys.readouterr().out
    assert cli.main(["cache", "--clear", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["files"], document["bytes"], document["cleared"]) == (2, 2_500_000, True)
    assert [path.name for path in base.iterdir()] == ["notes.txt"]


def test_without_a_folder_it_says_so(monkeypatch, capsys):
    monkeypatch.setattr(native, "folder", lambda: None)
    assert cli.main(["cache"]) == 0
    assert "STICKSLIP_CACHE names another one" in capsys.readouterr().out
