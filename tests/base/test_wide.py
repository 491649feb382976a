"""Machine code for several lanes at once: every operation, any number of lanes, and the way without it."""

import math

import casadi as ca
import numpy as np
import pytest

from identify.base import compiled as mapped
from identify.base import native, wide
from identify.base.compiled import Mapped

SAMPLES = np.array([-2.5, -1.0, -0.3, -0.0, 0.0, 0.2, 0.7, 1.0, 1.9, 30.0, math.nan])


def compiled(function: ca.Function) -> Mapped:
    """The function as its best machine code, which is made now."""
    identity = native.key(function, lanes=True)
    assert identity is not None and identity.startswith("wide-")
    native.start([(function, identity)])
    native.wait()
    return Mapped(function)


def every_operation() -> ca.Function:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    made = [
        x + y, x - y, x * y, x / y, -x, 2 * x, x**2, 1 / x, x < y, x <= y, ca.eq(x, y), ca.ne(x, y),
        ca.logic_not(x), ca.logic_and(x, y), ca.logic_or(x, y), ca.if_else(x > 0.1, y, x / 3), ca.fmin(x, y),
        ca.fmax(x, y), ca.fabs(x), ca.power(ca.fabs(x), y), ca.power(ca.fabs(x), 1.7), ca.atan2(x, y),
        ca.copysign(x, y), ca.sqrt(x), ca.exp(x), ca.expm1(x), ca.log(x), ca.log1p(x), ca.sin(x), ca.cos(x), ca.tan(x),
        ca.tanh(x), ca.sinh(x), ca.cosh(x), ca.asin(x), ca.acos(x), ca.atan(x), x, ca.SX(0.1),
    ]  # fmt: skip
    return ca.Function("every", [ca.vertcat(x, y)], [ca.vertcat(*made), ca.dot(x, y)])


def used(function: ca.Function) -> set[int]:
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def test_every_operation_that_is_written_is_tried_here():
    assert set(wide._WORDS) - used(every_operation()) <= {ca.OP_ASSIGN}


@pytest.mark.parametrize("register", [wide.register(), (2, ()), (4, ())])
@pytest.mark.parametrize("lanes", [1, 7, 121])
def test_lane_by_lane_the_numbers_are_those_of_the_virtual_machine(machine_code, monkeypatch, register, lanes):
    monkeypatch.setattr(wide, "register", lambda: register)
    f = every_operation()
    points = np.stack(np.meshgrid(SAMPLES, SAMPLES), axis=-1).reshape(-1, 2)[:lanes]
    before = [out.copy() for out in Mapped(f)([points])]
    run = compiled(f)
    after = run([points])
    assert run.native and run._runs[1] == register[0]
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_cannot_be_written_for_several_lanes_is_compiled_for_one(machine_code):
    x = ca.SX.sym("x")
    for unwritten in (ca.erf(x), x + math.inf):
        f = ca.Function("alone", [x], [unwritten])
        assert wide.code(f, 4) is None
        run = compiled(f)
        np.testing.assert_array_equal(run([SAMPLES])[0], Mapped(f)([SAMPLES])[0])
        assert run.native and run._runs[1] == 1


def test_a_small_rest_of_lanes_is_filled_up_to_a_register(machine_code, monkeypatch):
    f = every_operation()
    run = compiled(f)
    monkeypatch.setattr(run, "_few", 1)
    asked = []
    really = mapped._Bench.of

    def noted(code, lanes, chunk, room):
        asked.append(chunk)
        return really(code, lanes, chunk, room)

    monkeypatch.setattr(mapped._Bench, "of", noted)
    run([np.ones((1, 2))])
    assert asked == [wide.register()[0]]


def test_the_processor_decides_how_many_lanes(monkeypatch):
    def says(text):
        wide.register.cache_clear()
        monkeypatch.setattr(wide.Path, "read_text", lambda self, **_: text)
        return wide.register()

    monkeypatch.setattr(wide.platform, "machine", lambda: "x86_64")
    assert says("flags : sse2 avx avx2 fma") == (4, ("-mavx2",))
    assert says("flags : sse2 avx") == (2, ())
    monkeypatch.setattr(wide.platform, "machine", lambda: "aarch64")
    assert says("avx2") == (2, ())

    def missing(self, **_):
        raise FileNotFoundError

    wide.register.cache_clear()
    monkeypatch.setattr(wide.Path, "read_text", missing)
    assert wide.register() == (2, ())
    wide.register.cache_clear()
