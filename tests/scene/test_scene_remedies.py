"""Every sentence in which a scene is refused: met by a scene, and its remedy, done to that very scene, is taken."""

import re
import tomllib

import pytest

from identify.base.errors import SceneError
from identify.scene import Scene, toml
from tests.scene.test_scene import GOOD

MAIN = '["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"'
RESTING = 'effects=["contact_ageing", "velocity_weakening"]'  # without inertia
# What is set in the good scene ("-key" leaves it out), the remedy that the sentence names, and what it sets instead.
CASES = [
    (['rig.stiffnes="1 N/m"'], "did you mean 'stiffness'", ['rig.stiffness="1 N/m"']),
    (['rig.drive_speed="-1 mm/s"'], "give it without its sign", ['rig.drive_speed="1 mm/s"']),
    (["-effects"], r"expected a list: effects = \[", [f"effects={MAIN}]"]),
    ([f'effects={MAIN}, "inertia"]'], "remove one of the two", [f"effects={MAIN}]"]),
    (['effects=["inertia", "contact_ageing"]'], "add it to effects or drop a", [f"effects={MAIN}]"]),
    ([f'effects={MAIN}, "skin_compliance"]', "parameters.skin_retardation={}"], "its value alone to hold it there",
     [f'effects={MAIN}, "skin_compliance"]', 'parameters.skin_retardation="2 ms"']),
    (["parameters.a={lower=-40}"], "admits 0.001 to 1e.07 s/m: move it there", ["parameters.a={lower=0.001}"]),
    (["parameters.t_cr={fixed=0.5, start=1}"], "keep one of them", ["parameters.t_cr={fixed=0.5}"]),
    (["parameters.mu_s={start=0.3}"], "give .parameters. a start of mu_k0 below",
     ["parameters.mu_s={start=0.3}", "parameters.mu_k0={start=0.2}"]),
    (["parameters.delta_mu_k={fixed=-0.5}"], "raise one of the two", ["parameters.delta_mu_k={fixed=-0.4}"]),
    (["parameters.mass={lower=1}"], "widen them", ["parameters.mass={lower=0.1}"]),
    (["parameters.stiffness={}"], "drop one of the two", ["parameters.stiffness={}", "-logs.2.stiffness"]),
    (['parameters.D={per="volunteer"}'], r'give it labels = \{ volunteer = "…" \}',
     ['parameters.D={per="volunteer"}', 'logs.2.labels={volunteer="8"}']),
    (['parameters.D={per="volunteer"}'], 'or write per = "log"', ['parameters.D={per="log"}']),
    (["-rig.mass"], 'give mass = "0.2 kg"', ['rig.mass="0.2 kg"']),
    (["rig.mass=0"], "take inertia out of effects", ["rig.mass=0", RESTING]),
    (['rig.mass="1e308 kg"'], "between 1e-18 and .*: correct it, or its unit", ['rig.mass="0.2 kg"']),
    (['rig.stiffness="1470"'], 'write for instance "1470 N/m"', ['rig.stiffness="1470 N/m"']),
    (['rig.stiffness="1.47 mm"'], "N/m", ['rig.stiffness="1.47 N/m"']),
    (["-logs", "-rig.drive_speed"], 'give drive_speed = "… mm/s" under .rig.', ["-logs", 'rig.drive_speed="1 mm/s"']),
    (['logs.1.window=["5 min", "1 min"]'], "expected start before stop", ['logs.1.window=["1 min", "5 min"]']),
    (["logs.1.crosstalk=2"], "expected less than 1 to either side", ["logs.1.crosstalk=0.9"]),
    (['rig.mass="TODO g"'], "replace each TODO by a quantity with its unit", ['rig.mass="180 g"']),
    (['name="a/b"'], "leave out the slashes", ['name="ab"']),
    (["tolerances.stiffness=2"], "expected less than 1", ['tolerances.stiffness="2 %"']),
    (["quality.jiter=0.1"], "jitter", ["quality.jitter=0.1"]),
    (['extrapolate=["power_law"]'], "or drop it here", ["extrapolate=[]"]),
    (['effects=["inertia", "power_law"]', "-parameters", 'rig.drive_speed="5 m/s"'],
     r'use it there all the same: extrapolate = \["power_law"\]',
     ['effects=["inertia", "power_law"]', "-parameters", 'rig.drive_speed="5 m/s"', 'extrapolate=["power_law"]']),
    (["contact.area=1", "contact.area_law={coefficient=1, exponent=1}"], "keep exactly one", ["contact.area=1"]),
]  # fmt: skip


def _scene(settings):
    """The good scene with these settings."""
    document = tomllib.loads(GOOD)
    for setting in settings:
        if not setting.startswith("-"):
            toml.put(document, setting)
            continue
        *tables, last = setting[1:].split(".")
        place = document
        for key in tables:
            place = place[int(key) - 1 if isinstance(place, list) else key]
        del place[last]
    return Scene.from_document(document)


def _refused(settings):
    with pytest.raises(SceneError) as caught:
        _scene(settings)
    return str(caught.value)


@pytest.mark.parametrize(("refused", "remedy", "mended"), CASES, ids=[" ".join(case[0])[:60] for case in CASES])
def test_a_refused_scene_is_taken_with_the_remedy_that_is_named(refused, remedy, mended):
    assert re.search(remedy, _refused(refused)), _refused(refused)
    _scene(mended)


def _file_cases(folder):
    """Sentences about files, overrides and choices: what is refused and what its remedy is."""
    scene, log = folder / "pair.toml", folder / "slow.csv"
    rows = "\n".join(f"{0.01 * i:.2f},{0.1 + 0.001 * (i % 7):.4f},1.0" for i in range(60))
    log.write_text(f"Time [s],Fx [N],Fz [N]\n{rows}\n")
    (folder / "broken.toml").write_text("mass = [")
    (folder / "rig.toml").write_text('mass = "0.2 kg"\nstiffness = "1470 N/m"\nzeta = 0.05\ndrive_speed = "1 mm/s"\n')

    def written(content, *overrides):
        def act():
            scene.write_bytes(content if isinstance(content, bytes) else content.encode())
            return Scene.from_toml(scene, overrides)

        return act

    good, long = written(GOOD), "0x" + "f" * 9000
    with_rig = GOOD[: GOOD.index("[rig]")] + 'rig = "{}"\n' + GOOD[GOOD.index("[parameters]") :]
    yield lambda: Scene.from_toml(folder / "none.toml"), "give an existing one", good
    yield written(GOOD.encode("utf-16")), "save the scene file as UTF-8", good
    yield written(GOOD.replace("[rig]", "[rig")), "correct that line", good
    for name in (r"C:\Users\me\slow.csv", r"C:\new\slow.csv", r"C:\new\table.csv"):
        text = re.sub(r'path = "[^"]*"', lambda _, name=name: f'path = "{name}"', GOOD, count=1)
        yield written(text), "write paths of Windows within '", written(text.replace(f'"{name}"', f"'{name}'"))
    yield written('{"schema": 1, "status": "converged"}'), "it is a result of stickslip fit", good
    yield lambda: Scene.from_toml(log), "stickslip scene .*slow.csv --out SCENE.toml", None
    yield written(GOOD.replace("step = 2", f"step = {long}")), "shorten it", good
    for deep in ("b" + ".a" * 3_000 + " = 1", "[b" + ".a" * 3_000 + "]", "b = " + "[" * 3_000 + "]" * 3_000):
        yield written(GOOD + "\n" + deep + "\n"), "tables within each other|brackets without end", good
    yield written(GOOD, "rig" + ".a" * 99 + "=1"), "at most .* were expected", written(GOOD, "rig.mass=1")
    yield written(GOOD, "rig"), 'write for instance rig.mass="0.3 kg"', written(GOOD, 'rig.mass="0.3 kg"')
    yield written(GOOD, "logs.3.step=1"), "count them from 1", written(GOOD, "logs.2.step=1")
    yield written(GOOD, "rig.mass=180"), '"180 g"', written(GOOD, 'rig.mass="180 g"')
    yield (
        written(with_rig.replace("{}", "none.toml")),
        "relative to the scene file",
        written(with_rig.replace("{}", "rig.toml")),
    )
    yield (
        lambda: Scene.from_toml(folder / "rig.toml"),
        r'holds a rig.*rig = "RIG.toml" in place',
        written(with_rig.replace("{}", "rig.toml")),
    )
    yield lambda: good().choose(["nowhere.csv"]), "check its path", lambda: good().choose([log])
    twice = written(GOOD.replace("sub/fast.csv", "sub/slow.csv"))
    yield (
        lambda: twice().choose(["slow.csv"]),
        "as the scene has it",
        lambda: twice().choose([folder / "sub" / "slow.csv"]),
    )
    yield lambda: Scene.from_toml(folder / f"{'a' * 300}.toml"), "check its path", good


def test_a_refused_file_or_override_is_taken_with_the_remedy_that_is_named(tmp_path):
    for refused, remedy, mended in _file_cases(tmp_path):
        with pytest.raises(SceneError, match=remedy) as caught:
            refused()
        if mended is None:  # the sentence names a command
            from identify.cli.main import main

            assert main(["scene", str(tmp_path / "slow.csv"), "--out", str(tmp_path / "SCENE.toml")]) == 0
            assert "varying_normal_force" not in (tmp_path / "SCENE.toml").read_text(), (
                "its load is the same in all rows"
            )
            continue
        assert mended() is not None, caught.value
