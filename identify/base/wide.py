"""C code of a function for several lanes at once: every number in it is a short vector.

CasADi's own C code takes one lane at a time. What it computes is a list of instructions on scalars; here each of them
is written for lanes side by side, in the vector types of GCC and Clang. Lane by lane the arithmetic is the same, in
the same order: the numbers are the same.
"""

from __future__ import annotations

import math
import platform
from functools import cache
from pathlib import Path

import casadi as ca

VERSION = 1  # counts up when what is written changes: older machine code is not found again then
_HEAD = """#include <math.h>
typedef double V __attribute__((vector_size({bytes})));
typedef long long M __attribute__((vector_size({bytes})));
#define EACH(f, x) (V){{{each}}}
#define PAIR(f, x, y) (V){{{pair}}}
#define WHERE(m, x) ((V)((M)(m) & (M)(x)))
#define EITHER(m, x, y) ((V)(((M)(m) & (M)(x)) | (~(M)(m) & (M)(y))))
#define TRUE(m) WHERE(m, ONE)
static const V ZERO = {{0}}, ONE = {{{ones}}};
"""
# Every operation in the words of C, on vectors x and y. What is not here is not written for several lanes.
_WORDS = {
    ca.OP_ASSIGN: "{x}",
    ca.OP_ADD: "{x} + {y}",
    ca.OP_SUB: "{x} - {y}",
    ca.OP_MUL: "{x} * {y}",
    ca.OP_DIV: "{x} / {y}",
    ca.OP_NEG: "-{x}",
    ca.OP_TWICE: "{x} + {x}",
    ca.OP_SQ: "{x} * {x}",
    ca.OP_INV: "ONE / {x}",
    ca.OP_LT: "TRUE({x} < {y})",
    ca.OP_LE: "TRUE({x} <= {y})",
    ca.OP_EQ: "TRUE({x} == {y})",
    ca.OP_NE: "TRUE({x} != {y})",
    ca.OP_NOT: "TRUE({x} == ZERO)",
    ca.OP_AND: "TRUE(({x} != ZERO) & ({y} != ZERO))",
    ca.OP_OR: "TRUE(({x} != ZERO) | ({y} != ZERO))",
    ca.OP_IF_ELSE_ZERO: "WHERE({x} != ZERO, {y})",
    ca.OP_FMIN: "EITHER(({x} <= {y}) | ({y} != {y}), {x}, {y})",
    ca.OP_FMAX: "EITHER(({x} >= {y}) | ({y} != {y}), {x}, {y})",
    ca.OP_FABS: "EACH(fabs, {x})",
    ca.OP_POW: "PAIR(pow, {x}, {y})",
    ca.OP_CONSTPOW: "PAIR(pow, {x}, {y})",
    ca.OP_ATAN2: "PAIR(atan2, {x}, {y})",
    ca.OP_COPYSIGN: "PAIR(copysign, {x}, {y})",
} | {
    getattr(ca, f"OP_{name.upper()}"): f"EACH({name}, {{x}})"
    for name in (
        *("sqrt", "exp", "expm1", "log", "log1p", "sinh", "cosh", "tanh", "sin", "cos", "tan", "asin", "acos", "atan"),
    )
}


@cache
def register() -> tuple[int, tuple[str, ...]]:
    """How many lanes a register of this processor holds, and the compiler's options for it."""
    try:
        known = "avx2" in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split()
    except OSError:
        known = False
    return (4, ("-mavx2",)) if known and platform.machine() == "x86_64" else (2, ())


def code(function: ca.Function, lanes: int) -> str | None:
    """C code of a function for so many lanes, one after the other in its arguments and results, as a library that
    CasADi loads under the same name; None where the function does something that is not written here."""
    name = function.name()
    lines = [_head(lanes)]
    for kind, sizes in (
        ("in", [function.numel_in(i) for i in range(function.n_in())]),
        ("out", [function.numel_out(i) for i in range(function.n_out())]),
    ):
        lines += [f"static const long long {kind}_{i}[] = {{{size}, {lanes}, 1}};" for i, size in enumerate(sizes)]
        lines += [
            f"long long {name}_n_{kind}(void) {{ return {len(sizes)}; }}",
            f"const long long* {name}_sparsity_{kind}(long long i) {{",
            f"  static const long long* const all[] = {{{', '.join(f'{kind}_{i}' for i in range(len(sizes)))}}};",
            f"  return i < {len(sizes)} ? all[i] : 0;",
            "}",
        ]
    lines += [
        f"int {name}(const double** arg, double** res, long long* iw, double* w, int mem) {{",
        f"  V {', '.join(f'a{i}' for i in range(max(function.sz_w(), 1)))};",
    ]
    for k in range(function.n_instructions()):
        line = _instruction(function, k, lanes)
        if line is None:
            return None
        lines.append(line)
    return "\n".join([*lines, "  return 0;", "}", ""])


def _head(lanes: int) -> str:
    each = range(lanes)
    return _HEAD.format(
        bytes=8 * lanes,
        each=", ".join(f"f((x)[{i}])" for i in each),
        pair=", ".join(f"f((x)[{i}], (y)[{i}])" for i in each),
        ones=", ".join("1" for _ in each),
    )


def _instruction(function: ca.Function, k: int, lanes: int) -> str | None:
    """One instruction as a line of C."""
    kind, given, made = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
    if kind == ca.OP_INPUT:
        (i, place), size = given, function.numel_in(given[0])
        taken = ", ".join(f"arg[{i}][{lane * size + place}]" for lane in range(lanes))
        return f"  a{made[0]} = arg[{i}] ? (V){{{taken}}} : ZERO;"
    if kind == ca.OP_OUTPUT:
        (i, place), size = made, function.numel_out(made[0])
        put = " ".join(f"res[{i}][{lane * size + place}] = a{given[0]}[{lane}];" for lane in range(lanes))
        return f"  if (res[{i}]) {{ {put} }}"
    if kind == ca.OP_CONST:
        value = float(function.instruction_constant(k))
        if not math.isfinite(value):  # C has no hexadecimal words for it
            return None
        return f"  a{made[0]} = (V){{{', '.join([value.hex()] * lanes)}}};"
    words = _WORDS.get(kind)
    if words is None:
        return None
    return f"  a{made[0]} = {words.format(x=f'a{given[0]}', y=f'a{given[-1]}')};"
