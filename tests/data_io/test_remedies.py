"""Every remedy that a refusal of the readers names is applied to the very input that caused it, and gets further.

The refusals are those of `tests/support/refusal_cases.py`, which holds one for each sentence in the sources. Collected
are all that name an option or a key of a scene; where the sentence leaves a name open, each of the names it
lists is tried.
"""

import itertools
import re
import shlex

import pytest

from data_io import LogError, read_log
from data_io.values import UnitError
from tests.support.refusal_cases import CASES

MENTIONED = r"(?<!unless )(?<!where no column is the time give )"
OPTION = re.compile(
    MENTIONED + r'--(columns|units|normal-force|window|step|run|rate|channels)((?: (?:"[^"]*"|[^\s;"()]+))?)'
)
SCENE_KEY = re.compile(r"\b(window|exclude) = (\[+[^;)]*?\]+)(?=[);, ]|$)")
FEWEST = 20  # sentences with a remedy


def said(name, folder, monkeypatch, **more):
    """The sentence with which a case is refused, and the options its file was read with; None where it is read."""
    given = {}

    def remembering(path, *positional, **options):
        given.update(options, path=path)
        return read_log(path, *positional, **{**options, **more})

    monkeypatch.setattr("tests.support.refusal_cases.read_log", remembering)
    try:
        CASES[name][0](folder, monkeypatch)
    except (LogError, UnitError) as error:
        return str(error), given
    return None, given


def table(text):
    return dict(item.split("=", 1) for item in text.strip(",.").split(","))


def names_in(sentence):
    """What may stand for a name that is left open: the names listed between quotes, and paths of datasets."""
    listed = re.split(r"; a name such as|; names such as", sentence)[0]
    return [*dict.fromkeys([*re.findall(r"'([^']*)'", listed), *re.findall(r"(/[\w/]+)(?=[,; ]|$)", listed)])]


def filled(option, value, sentence, given):
    """The ways in which an option of a sentence can be given to `read_log`."""
    value = "".join(shlex.split(value)) if value.strip() else ""
    if option in ("columns", "units"):
        if "=" not in value:
            value = "friction_force=<name>" if option == "columns" else "friction_force=N"
        value = value.replace("...", "N" if option == "units" else "<name>")
        holes = value.count("<name>")
        for names in itertools.permutations([*names_in(sentence), "X", "Z"], holes):
            words = iter(names)
            yield {option: {**given.get(option, {}), **table(re.sub("<name>", lambda _: next(words), value))}}  # noqa: B023
    elif option == "normal-force":
        yield {"normal_force": value or "3 N"}
    elif option == "window":
        yield {"window": tuple(float(part.split()[0]) for part in value.split(","))}
    elif option == "channels":
        yield {"channels": []}
    elif option == "rate":
        yield {"rate": value if "Hz" in value else "4 Hz"}
    else:
        yield from ({option: number} for number in (1, 2))


def scene_value(key, text):
    numbers = [float(number) for number in re.findall(r'"([\d.eE+-]+) s"', text)]
    return {"window": tuple(numbers)} if key == "window" else {"exclude": [tuple(numbers)]}


def remedies(sentence, given):
    """Every remedy that a sentence names, each a list of ways to follow it."""
    found = [(option, value) for option, value in OPTION.findall(sentence)]
    named = {}
    for option, value in found:
        ways = list(filled(option, value, sentence, given))
        named.setdefault(option, []).extend(ways)
    if "normal-force" in named and "columns" in named and "units" in named:  # a load in place of its column
        for way in named["columns"]:
            load = dict(named["normal-force"][0])
            named["normal-force"].append({"columns": {k: v for k, v in way["columns"].items() if k != "normal_force"},
                                          "units": named["units"][0]["units"], **load})  # fmt: skip
    if "columns" in named and "units" in named:  # asked for together
        pairs = itertools.product(named.pop("columns"), named.pop("units"))
        named["columns and units"] = [one | other for one, other in pairs]
    keys = {f"{key} of a scene": [scene_value(key, text)] for key, text in SCENE_KEY.findall(sentence)}
    return {**named, **keys}


@pytest.fixture(scope="module")
def sentences(tmp_path_factory):
    """Of every case with a remedy its sentence and the remedies."""
    out = {}
    for name in CASES:
        with pytest.MonkeyPatch.context() as patch:
            sentence, given = said(name, tmp_path_factory.mktemp("said"), patch)
        if sentence and given and (ways := remedies(sentence, given)):
            out[name] = sentence, ways
    return out


def without_place(sentence):
    return re.sub(r"\S*/(?=[^/]*: )", "", sentence)


def further(name, sentence, way, folder, monkeypatch):
    """Whether a case with one more option is read, or refused for another reason."""
    after, _ = said(name, folder, monkeypatch, **way)
    return after is None or without_place(after) != without_place(sentence)


def test_remedies_are_collected(sentences):
    assert len(sentences) >= FEWEST, list(sentences)


def test_every_remedy_that_is_named_gets_further(sentences, tmp_path_factory):
    stuck = []
    for name, (sentence, ways) in sentences.items():
        for remedy, choices in ways.items():
            tried = []
            for way in choices[:200]:
                with pytest.MonkeyPatch.context() as patch:
                    tried.append(further(name, sentence, way, tmp_path_factory.mktemp("tried"), patch))
                if tried[-1]:
                    break
            if not any(tried):
                stuck.append((name, remedy, sentence))
    assert stuck == []


def test_a_remedy_that_does_not_help_would_be_noticed(sentences, tmp_path, monkeypatch):
    sentence, _ = sentences["words in a row"]
    assert not further("words in a row", sentence, {"window": (10.0, 15.0)}, tmp_path, monkeypatch)
