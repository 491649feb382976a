"""A bar changes in place, in a notebook and on a terminal; sentences that are to stay do."""

import io
import sys
from types import SimpleNamespace

import pytest

from identify.base.progress import Notice, ProgressBar


class Place:
    """Where a notebook shows something: what stood there, one after the other."""

    def __init__(self, first):
        self.shown = [first]

    def update(self, other):
        self.shown.append(other)


@pytest.fixture
def notebook(monkeypatch):
    places = []

    def display(shown, display_id):
        places.append(Place(shown))
        return places[-1]

    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object()))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(HTML=str, display=display))
    return places


def work(progress):
    progress("reading", 0.0)
    progress(Notice("log 2 was cut <short>"), 0.1)
    progress("solving", 0.5)
    progress("what to change", None)


def test_in_a_notebook_one_place_changes(notebook, capsys):
    work(ProgressBar())
    (place,) = notebook
    assert place.shown[0] == '<progress value="0.000"></progress> reading'
    assert place.shown[2] == 'log 2 was cut &lt;short&gt;<br><progress value="0.500"></progress> solving'
    assert place.shown[3].endswith("<progress></progress> what to change")
    assert capsys.readouterr() == ("", "")


def test_on_a_terminal_one_line_changes(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setenv("TERM", "xterm")
    work(ProgressBar(terminal))
    lines = terminal.getvalue().split("\n")
    assert len(lines) == 2 and lines[0].endswith("log 2 was cut <short>") and " 50%" in lines[1]
