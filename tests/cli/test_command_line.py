"""The command line helps whoever mistypes: unknown words, logs taken for scenes; quiet and verbose."""

import io
import json

import pytest

from identify import examples, identification
from identify.cli import fit as fit_command
from identify.cli import main as cli
from identify.cli.common import Answer
from identify.cli.progress import Progress
from tests.support.fake_fit import fit_of_a_scene

LOG = examples.FOLDER / "5_mm_per_s.txt.gz"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["fit", "--scene", "x.toml", "--acuracy=tight"], "unrecognized arguments: --acuracy=tight"),
        (["fit", "--scene", "x.toml", "--acc", "tight"], "unrecognized arguments: --acc"),
        (["fitt", "--scene", "x"], "invalid choice: 'fitt'"),
        (["plan"], "required: SCENE.toml|result.json"),
    ],
)
def test_a_word_that_is_not_known_is_refused_by_name(given, words, capsys):
    assert cli.main(given) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("command", ["fit", "simulate", "stability"])
def test_a_log_given_as_a_scene_is_recognised(command, tmp_path, capsys):
    more = ["--duration", "1", "--rate", "100", "--out", str(tmp_path / "x.csv")] if command == "simulate" else []
    assert cli.main([command, "--scene", str(LOG), *more]) == 2
    said = capsys.readouterr().err
    assert "this is a log, not a scene; write a scene from it with: stickslip scene" in said
    broken = tmp_path / "scene.toml"
    broken.write_text("[rig\nmass = 1")
    assert cli.main([command, "--scene", str(broken), *more]) == 2
    assert "not valid TOML" in capsys.readouterr().err


def test_the_advice_for_a_log_given_as_a_scene_gets_further(tmp_path, capsys):
    assert cli.main(["scene", str(LOG), "--out", str(tmp_path / "scene.toml")]) == 0
    assert cli.main(["fit", "--scene", str(tmp_path / "scene.toml")]) == 2
    assert "still to fill in" in capsys.readouterr().err


def test_quiet_says_the_answer_alone_and_verbose_the_seconds(monkeypatch, capsys):
    def run(_arguments, terminal):
        with Progress(terminal.notes, terminal.progress) as progress:
            progress("reading", 0.1)
        terminal.say("the answer")
        return Answer()

    monkeypatch.setattr(fit_command, "run", run)
    heard = []
    for more in ([], ["--quiet"], ["--verbose"], ["--progress", "json"]):
        assert cli.main(["fit", "--scene", "x", *more]) == 0
        heard.append(capsys.readouterr())
    assert [h.out for h in heard] == ["the answer\n"] * 4
    assert [h.err for h in heard[:2]] == ["reading\n", ""] and heard[2].err.split()[1:] == ["s", "reading"]
    told = json.loads(heard[3].err)
    assert set(told) == {"stage", "share", "seconds"} and told["stage"] == "reading"
    assert cli.main(["fit", "--quiet"]) == 2
    assert "--scene" in capsys.readouterr().err, "an error is said all the same"


def test_a_bar_says_how_long_it_will_take(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with Progress(stream) as progress:
        progress("solving", 0.5)
    assert "left about" in stream.getvalue()


@pytest.mark.parametrize("starts", ["data", "user", "both", None])
def test_where_the_search_starts_can_be_said(starts, monkeypatch, tmp_path, capsys):
    asked = []

    def fit(_scene, *, starts, **_):
        asked.append(starts)
        return fit_of_a_scene()

    monkeypatch.setattr(identification, "fit", fit)
    monkeypatch.setattr("identify.report.write_report", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    more = [] if starts is None else ["--starts", starts]
    assert cli.main(["fit", "--scene", str(examples.SCENE), *more]) == 0 and asked == [starts]
    assert cli.main(["fit", "--scene", str(examples.SCENE), "--starts", "mine"]) == 2
