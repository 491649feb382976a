"""Two logs of the study's pair at 1 and 5 mm/s, soon fitted: records, scenes, and searches that tests share."""

import json
from functools import lru_cache

import numpy as np

from data_io import Record
from experiments.study_problem import DEMO, NOISE, RIG, SPEEDS, simulated_case
from identify import Scene
from identify.effects import MAIN
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

LOGS = (2, 3)


@lru_cache(maxsize=4)
def records(seed=3, share=0.5):
    """The first part of those that the study draws."""
    whole = [simulated_case(DEMO, seed).records[i] for i in LOGS]
    columns = ((r.time, r.normal_force, r.friction_force) for r in whole)
    return tuple(Record(*(values[: round(share * values.size)] for values in each)) for each in columns)


def drawn(logs, more=(), effects=MAIN, load=1.0, noise=NOISE, seed=0):
    """Records of the demo pair with other parameters and effects; logs: drive speed [m/s], duration [s], rate [Hz];
    load [N]: the same throughout, or from one to another."""
    (low, high), random = np.broadcast_to(load, 2).tolist(), np.random.default_rng(seed)
    model, out = assemble(tuple(effects)), []
    values = {p.name: (DEMO | RIG | dict(more)).get(p.name, p.default) for p in model.parameters}
    for speed, duration, rate in logs:
        times = np.arange(round(duration * rate) + 1) / rate
        course = low if low == high else ([0.0, duration], [low, high])
        force = run(model, values, speed, course, duration).sample(times)["force"]
        normal = np.interp(times, [0.0, duration], [low, high])
        out.append(Record(times, normal, force + noise * random.standard_normal(times.size)))
    return out


def scene(rig=RIG, times=(1.0, 1.0), effects=MAIN, **parameters):
    """Each drive speed stated so many times what it was."""
    logs = [{"path": f"log_{i}.csv", "drive_speed": f * SPEEDS[i][0]} for i, f in zip(LOGS, times, strict=True)]
    return Scene.from_document({"effects": list(effects), "rig": rig, "logs": logs, "parameters": parameters})


def prepared(stated, logs):
    """The logs as the fit takes them, and the unknowns."""
    unknowns = from_scene(stated)
    return [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, logs, strict=True)], unknowns


def searched(stated, logs=None):
    """Where the search from the data's own start ends, and the unknowns; of the study's records once for all tests."""
    if logs is None:
        return _searched(json.dumps(stated.as_document(), sort_keys=True))
    made, unknowns = prepared(stated, logs)
    return search(SearchProblem(made, unknowns, thorough=False))[0], unknowns


@lru_cache(maxsize=16)
def _searched(document):
    return searched(Scene.from_document(json.loads(document)), records())
