"""Every sentence in which a log is refused has input that triggers it and input that just does not."""

import functools
import re

import pytest

from data_io import LogError
from data_io.units import UnitError
from tests.support.refusal_cases import CASES
from tests.support.sentences import sentences_in


@functools.cache
def refused(folder, name):
    """The sentence of a case."""
    place = folder / re.sub(r"\W", "_", name)
    place.mkdir()
    with pytest.MonkeyPatch.context() as patch, pytest.raises((LogError, UnitError)) as caught:
        CASES[name][0](place, patch)
    return str(caught.value)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("refused")


@pytest.mark.parametrize("name", CASES)
def test_what_is_refused_and_what_just_is_not(folder, tmp_path, monkeypatch, name):
    sentence = refused(folder, name)
    assert "\n" not in sentence and len(sentence) < 700
    CASES[name][1](tmp_path, monkeypatch)


def test_every_sentence_in_the_sources_has_its_case(folder, request):
    """A refusal added without a case fails here."""
    told = [refused(folder, name) for name in CASES]
    modules = sorted((request.config.rootpath / "data_io").glob("*.py"))
    patterns = {(path.name, p) for path in modules for p in sentences_in(path.read_text(encoding="utf-8"))}
    assert len(patterns) > 100
    untold = [f"{name}: {p}" for name, p in sorted(patterns) if not any(re.search(p, sentence) for sentence in told)]
    assert untold == [], untold


def test_a_new_sentence_would_be_noticed():
    source = """
def why(x):
    return f"something else {x} is wrong"

def check(source, x):
    text = f"the {x} was found; another was expected"
    if x:
        raise source.error(text)
    raise LogError(f"{x}: {why(x)}") if x > 2 else source.error(why(x))
"""
    assert set(sentences_in(source)) == {r"something\ else.*is\ wrong", r"the.*was\ found;\ another\ was\ expected"}
