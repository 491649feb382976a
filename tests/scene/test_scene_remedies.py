"""Every sentence in which a scene is refused: met by a scene, and its remedy, done to that very scene, is taken."""

import math
import re
import tomllib

import pytest

from identify.base.errors import SceneError
from identify.scene import LogEntry, Scene, toml
from identify.scene.values import Initial
from tests.scene.test_scene import GOOD

MAIN = '["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"'
RESTING = 'effects=["contact_ageing", "velocity_weakening"]'  # without inertia
# What is set in the good scene ("-key" leaves it out), the remedy that the sentence names, and what it sets instead.
CASES = [
    (['rig.stiffnes="1 N/m"'], "did you mean 'stiffness'", ['rig.stiffness="1 N/m"']),
    (['effects=["inertai"]'], "did you mean 'inertia'", ['effects=["inertia"]', "-parameters"]),
    (['rig.drive_speed="-1 mm/s"'], "give it without its sign", ['rig.drive_speed="1 mm/s"']),
    (["-effects"], r"expected a list: effects = \[", [f"effects={MAIN}]"]),
    ([f'effects={MAIN}, "inertia"]'], "remove one of the two", [f"effects={MAIN}]"]),
    (['effects=["inertia", "contact_ageing"]'], "add it to effects or drop a", [f"effects={MAIN}]"]),
    ([f'effects={MAIN}, "skin_compliance"]', "parameters.skin_retardation={}"], "its value alone to hold it there",
     [f'effects={MAIN}, "skin_compliance"]', 'parameters.skin_retardation="2 ms"']),
    ([f'effects={MAIN}, "skin_compliance"]', "parameters.skin_retardation={lower=1e-3}"], "write a start or a prior",
     [f'effects={MAIN}, "skin_compliance"]', "parameters.skin_retardation={lower=1e-3, start=2e-3}"]),
    (['effects=["inertia", "driven_damping"]', "-parameters", "rig.damping_frequency=2",
      "parameters.damping_frequency=3"], "keep one of them",
     ['effects=["inertia", "driven_damping"]', "-parameters", "rig.damping_frequency=2"]),
    (['effects=["inertia", "driven_damping"]', "-parameters", "rig.damping_frequency=1e9"],
     "admits 1e-06 to 1e.06 1/s: move it there",
     ['effects=["inertia", "driven_damping"]', "-parameters", "rig.damping_frequency=1e6"]),
    (["rig.damping_frequency=2"], "drop damping_frequency", []),
    (["parameters.mass={fixed=1}"], "drop the line to keep it there", []),
    (['parameters.D={prior={sd="25 %"}}'], "give both mean and sd", ['parameters.D={prior={mean="40 um", sd="25 %"}}']),
    (["parameters.mu_s={tie={factor=2}}"], r'give tie = \{ to = "mu_s" \}', ['parameters.a={tie={to="D"}}']),
    (['parameters.a={tie={to="D", offset=2}}'], "give factor instead", ['parameters.a={tie={to="D", factor=2}}']),
    (['parameters.a={tie={to="D", factor=-2}}'], "expected a positive number: correct it",
     ['parameters.a={tie={to="D", factor=2}}']),
    (['parameters.a={tie={to="d"}}'], "expected one of .*D", ['parameters.a={tie={to="D"}}']),
    (['parameters.a={tie={to="t_cr"}}'], "tie it to one that is", ['parameters.a={tie={to="D"}}']),
    (['parameters.delta_mu_k={tie={to="D"}}'], "tie parameters of one kind", ['parameters.a={tie={to="D"}}']),
    (["parameters.a={lower=-40}"], "admits 0.001 to 1e.07 s/m: move it there", ["parameters.a={lower=0.001}"]),
    (["parameters.a={lower=3000, upper=2000}"], "swap or widen them", ["parameters.a={lower=2000, upper=3000}"]),
    (["parameters.mu_s={start=30}"], "move it inside or widen the bounds", ["parameters.mu_s={start=20}"]),
    (["parameters.t_cr={fixed=0.5, start=1}"], "keep one of them", ["parameters.t_cr={fixed=0.5}"]),
    (['parameters.t_cr={fixed=0.5, per="log"}'], "keep one of them", ["parameters.t_cr={fixed=0.5}"]),
    (['parameters.a={start=300, tie={to="D"}}'], "keep one of them", ["parameters.a={start=300}"]),
    (['parameters.D.prior={mean="40 um", sd=-1}'], "expected a positive number: correct it",
     ['parameters.D.prior={mean="40 um", sd=1e-5}']),
    (["parameters.mu_s=0.6"], r"expected a table such as mu_s = \{ start", ["parameters.mu_s={start=0.6}"]),
    (["parameters.mu_s={start=0.3}"], "give .parameters. a start of mu_k0 below",
     ["parameters.mu_s={start=0.3}", "parameters.mu_k0={start=0.2}"]),
    (["parameters.delta_mu_k={fixed=-0.5}"], "raise one of the two", ["parameters.delta_mu_k={fixed=-0.4}"]),
    (["parameters.mass={lower=1}"], "widen them", ["parameters.mass={lower=0.1}"]),
    (["parameters.stiffness={}"], "drop one of the two", ["parameters.stiffness={}", "-logs.2.stiffness"]),
    (['parameters.D={per="volunteer"}'], r'give it labels = \{ volunteer = "…" \}',
     ['parameters.D={per="volunteer"}', 'logs.2.labels={volunteer="8"}']),
    (['parameters.D={per="volunteer"}'], 'or write per = "log"', ['parameters.D={per="log"}']),
    (["parameters.D={per=7}"], "expected a text in quotes", ['parameters.D={per="log"}']),
    (["rig.mass={tolerance=0.1}"], r"write \{ value = …, tolerance", ['rig.mass={value="200 g", tolerance=0.01}']),
    (['rig.mass={value="200 g", tolerance="2 % or so"}'], "a share such as 2 % does",
     ['rig.mass={value="200 g", tolerance="2 %"}']),
    (['rig.drive_speed={value=[[0, 1e-3]], tolerance="1 mm/s"}'], "expected a share such as 2 %",
     ['rig.drive_speed={value=[[0, 1e-3]], tolerance="2 %"}']),
    (["rig.noise={value=1, tolerance=1}"], "give the value alone", ["rig.noise=1"]),
    (['rig.mass={value="200 g", tolerance=-1}'], "expected zero or a positive",
     ['rig.mass={value="200 g", tolerance=0}']),
    (["rig.drive_speed=[1e-3, 2e-3]"], r"expected pairs of start and speed: \[\[0,",
     ['rig.drive_speed=[[0, "0.1 mm/s"]]']),
    (["rig.drive_speed=[[1, 1e-3]]"], r"begin it with \[0, speed\]", ["rig.drive_speed=[[0, 1e-3]]"]),
    (['rig.drive_speed="1e999 m/s"'], "write a finite number", ['rig.drive_speed="1e-3 m/s"']),
    (["rig.zeta=0.05"], "keep one of them", ["rig.zeta=0.05", "-rig.damping"]),
    (["rig.zeta=1.5", "-rig.damping"], "expected a ratio such as 0.05", ["rig.zeta=0.05", "-rig.damping"]),
    (["-rig.damping"], "give one of damping, zeta", ["-rig.damping", "rig.zeta=0.05"]),
    (["-rig.mass"], 'give mass = "0.2 kg"', ['rig.mass="0.2 kg"']),
    (["-rig.stiffness"], 'give stiffness = "1470 N/m"', ['rig.stiffness="1470 N/m"']),
    ([RESTING, "-rig.mass", 'rig.damping="1 N s/m"'], "give the mass, or h in N/m",
     [RESTING, "-rig.mass", 'rig.damping="1 N/m"']),
    (["rig.mass=0"], "take inertia out of effects", ["rig.mass=0", RESTING]),
    (["logs.1.columns={time=[7]}"], "expected a text in quotes", ["logs.1.columns={time=7}"]),
    (["rig.stiffness=-1"], "expected a positive number: correct it", ["rig.stiffness=1"]),
    (['rig.mass="1e308 kg"'], "between 1e-18 and .*: correct it, or its unit", ['rig.mass="0.2 kg"']),
    (['rig.drive_speed="1e308 m/s"'], "correct it, or its unit", ['rig.drive_speed="1 mm/s"']),
    (['logs.1.noise="1e308 N"'], "correct it, or its unit", ['logs.1.noise="1 mN"']),
    (['logs.1.drive_speed=[[0, "1 mm/s"], ["1e308 s", "2 mm/s"]]'], "correct it, or its unit",
     ['logs.1.drive_speed=[[0, "1 mm/s"], ["1 s", "2 mm/s"]]']),
    (['initial.elongation="1e308 m"'], "correct it, or its unit", ['initial.elongation="1 mm"']),
    (["rig.stiffness=true"], "expected a quantity such as .*or a bare SI number", ["rig.stiffness=1470"]),
    (['rig.stiffness="1470"'], 'write for instance "1470 N/m"', ['rig.stiffness="1470 N/m"']),
    (['rig.stiffness="1.47 mm"'], "N/m", ['rig.stiffness="1.47 N/m"']),
    (["rig.stiffness=inf"], "expected a finite number", ["rig.stiffness=1470"]),
    (["-logs", "-rig.drive_speed"], 'give drive_speed = "… mm/s" under .rig.', ["-logs", 'rig.drive_speed="1 mm/s"']),
    (["-logs.1.path"], 'give path = "slow.csv"', ['logs.1.path="slow.csv"']),
    (["logs=3"], "expected one ..logs.. table per log", ['logs=[{path="slow.csv"}]']),
    (["logs.1.exclude=3"], r'expected pairs of times \[\["5 s", "6 s"\]\]', ['logs.1.exclude=[["5 s", "6 s"]]']),
    (['logs.1.window=["5 s"]'], r'expected two times such as \["5 s", "20 s"\]', ['logs.1.window=["5 s", "20 s"]']),
    (['logs.1.window=["5 min", "1 min"]'], "expected start before stop", ['logs.1.window=["1 min", "5 min"]']),
    (["logs.1.step=1.5"], "expected a whole number", ["logs.1.step=1"]),
    (["logs.1.flip_sign=1"], "expected true or false", ["logs.1.flip_sign=true"]),
    (["logs.1.path=7"], "expected a text in quotes", ['logs.1.path="7"']),
    (["logs.1.columns=7"], "expected a table such as", ['logs.1.columns={time="T"}']),
    (["logs.1.crosstalk=2"], "expected less than 1 to either side", ["logs.1.crosstalk=0.9"]),
    (["logs.1.skip_cycles=-1"], "expected zero or a positive", ["logs.1.skip_cycles=0"]),
    (['rig.mass="TODO g"'], "replace each TODO by a quantity with its unit", ['rig.mass="180 g"']),
    (['name="a/b"'], "leave out the slashes", ['name="ab"']),
    (["fit.time_limit=0"], 'expected a positive time, such as "60 s"', ['fit.time_limit="60 s"']),
    (["tolerances.stiffness=2"], 'expected a share from 0 to below 1, such as "2 %"', ['tolerances.stiffness="2 %"']),
    (["quality.jiter=0.1"], "jitter", ["quality.jitter=0.1"]),
    (["extrapolate=3"], r'expected a list of effects: extrapolate = \["power_law"\]',
     [f'effects={MAIN}, "power_law"]'.replace('"velocity_weakening", ', ""),
      "-parameters", 'extrapolate=["power_law"]']),
    (['extrapolate=["power_law"]'], "or drop it here", ["extrapolate=[]"]),
    (['effects=["inertia", "power_law"]', "-parameters", 'rig.drive_speed="5 m/s"'],
     r'use it there all the same: extrapolate = \["power_law"\]',
     ['effects=["inertia", "power_law"]', "-parameters", 'rig.drive_speed="5 m/s"', 'extrapolate=["power_law"]']),
    (["contact.area=1", "contact.area_law={coefficient=1, exponent=1}"], "keep exactly one", ["contact.area=1"]),
    (["initial.gamma=2"], "expected a share between 0 and 1", ["initial.gamma=1"]),
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
    yield written(GOOD.replace("[rig]", "[rig")), "mend that line", good
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
    yield written(GOOD, "rig.mass.value.x=1"), "shorten the key", written(GOOD, "rig.mass.value=1")
    yield written(GOOD, "logs.3.step=1"), "count them from 1", written(GOOD, "logs.2.step=1")
    yield written(GOOD, "rig.mass=180"), '"180 g"', written(GOOD, 'rig.mass="180 g"')
    yield written(GOOD, "rig.mass=180"), 'or "180 kg" if so meant', written(GOOD, 'rig.mass="180 kg"')
    yield (
        written(with_rig.replace("{}", "none.toml")),
        "relative to the scene file",
        written(with_rig.replace("{}", "rig.toml")),
    )
    yield written(with_rig.replace("{}", "broken.toml")), "mend that line", written(with_rig.replace("{}", "rig.toml"))
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
    auto = written(GOOD.replace(MAIN + "]", '"auto"'))
    yield lambda: auto().model, "list them by name", lambda: good().model
    yield lambda: Scene.from_toml(folder / f"{'a' * 300}.toml"), "check its path", good
    yield (
        lambda: LogEntry(log, drive_speed=math.nan),
        "correct it, or its unit",
        lambda: LogEntry(log, drive_speed=1e-3),
    )
    yield lambda: Initial(gamma=2.0), "between 0 and 1", lambda: Initial(gamma=1.0)
    yield lambda: Scene.of(3), "expected a Scene, the path of a scene file, or its tables", lambda: Scene.of(scene)


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
