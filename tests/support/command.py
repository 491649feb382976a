"""The command `stickslip` in this process: what it answers, and the sentence with which it refuses."""

import json

from identify import examples
from identify.cli import main as cli

RIG = ["--set", "rig.drive_speed=1 mm/s", "--set", "rig.normal_force=1 N"]


def stickslip(capsys, *arguments):
    """Exit code, standard output, standard error of a command run in this process."""
    code = cli.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def refused(capsys, *arguments):
    """The sentence of a command that ends with exit code 2: the same in words and as JSON."""
    code, out, err = stickslip(capsys, *arguments)
    assert (code, out) == (2, "") and err.count("\n") == 1 and "Traceback" not in err
    assert err.startswith("stickslip: ")
    sentence = err.removeprefix("stickslip: ").strip()
    code, out, _ = stickslip(capsys, *arguments, "--json")
    assert code == 2 and json.loads(out) == {"schema": 1, "status": "error", "message": sentence}
    return sentence


def simulated(capsys, path, *more):
    """What `simulate` says that writes two seconds of the example pair."""
    arguments = ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "2", "--rate", "500", "--out", path, *more]
    code, out, err = stickslip(capsys, *arguments)
    assert code == 0, err
    return out
