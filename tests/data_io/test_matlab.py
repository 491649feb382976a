"""MATLAB files: the same numbers as scipy reads, and nothing but a sentence over those that are damaged."""

import io
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from data_io import LogError, matlab, read_log
from data_io.source import load
from experiments.hostile_inputs import changed, mat_matrix

CASES = Path(__file__).parents[1] / "cases"
KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def packed(variables, *, compressed=False):
    held = io.BytesIO()
    scipy.io.savemat(held, variables, do_compression=compressed)
    return held.getvalue()


def columns_of(data, folder):
    (folder / "log.mat").write_bytes(data)
    return matlab._columns(load(folder / "log.mat"))


@pytest.mark.parametrize("compressed", [False, True])
def test_columns_of_every_kind_are_those_that_were_written(tmp_path, compressed):
    draw = np.random.default_rng(3)
    written = {f"v_{kind}": (100 * draw.random((40, 1))).astype(kind) for kind in KINDS}
    inner = {"Fz": draw.normal(size=(40, 1)), "of": {"deep": np.arange(40.0)[:, None], "word": "N"}}
    cell = np.empty((1, 1), object)
    cell[0, 0] = np.arange(40.0)[:, None]
    other = {"word": "newton", "complex": np.array([1 + 2j]), "cube": np.zeros((2, 3, 4)), "wide": np.zeros((2, 9))}
    matrix = draw.normal(size=(40, 3))
    found = columns_of(
        packed({**written, **other, "log": inner, "c": cell, "m": matrix}, compressed=compressed), tmp_path
    )
    truth = {name: values[:, 0] for name, values in written.items()}
    truth |= {"log.Fz": inner["Fz"][:, 0], "log.of.deep": np.arange(40.0), "c": np.arange(40.0)}
    truth |= {f"m:{i + 1}": matrix[:, i] for i in range(3)}
    assert found.keys() == truth.keys()
    for name, values in truth.items():
        np.testing.assert_array_equal(found[name], values)


def test_drawn_files_hold_what_scipy_finds_in_them(tmp_path):
    draw = np.random.default_rng(0)
    for number in range(60):
        shapes = draw.integers(0, 6, (5, 2))
        drawn = {f"v{i}": (90 * draw.random(tuple(s))).astype(draw.choice(KINDS)) for i, s in enumerate(shapes)}
        data = packed(drawn, compressed=bool(number % 2))
        scipys = {n: v for n, v in scipy.io.loadmat(io.BytesIO(data)).items() if not n.startswith("__")}
        vectors = {n: v.reshape(-1) for n, v in scipys.items() if min(v.shape) == 1}
        found = columns_of(data, tmp_path)
        assert {n for n in found if ":" not in n} == vectors.keys()
        for name, values in vectors.items():
            np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("order", ["<", ">"])
def test_files_of_either_byte_order_hold_the_same_numbers(tmp_path, order):
    assert columns_of(mat_matrix((4, 1), order=order), tmp_path)["Fx"].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_damaged_class_is_named_with_its_variable():
    with pytest.raises(LogError, match=r"one_byte_wrong\.mat: the \.mat file is damaged in variable 4 .*class 255"):
        read_log(CASES / "one_byte_wrong.mat")


@pytest.mark.parametrize("compressed", [False, True])
def test_any_changed_byte_is_read_or_refused_in_a_sentence(tmp_path, compressed):
    columns = {"t": np.arange(9.0), "Fx_N": np.arange(9.0), "log": {"Fz": np.ones(9)}}
    whole, refused = packed(columns, compressed=compressed), 0
    draw = np.random.default_rng(1)
    for place in range(128, len(whole)):
        (tmp_path / "log.mat").write_bytes(changed(whole, place, int(draw.integers(256))))
        try:
            read_log(tmp_path / "log.mat", units={"t": "s", "log.Fz": "N"})
        except LogError as error:
            refused += 1
            assert "\n" not in str(error) and str(error).startswith(str(tmp_path))
    assert refused > 0.1 * (len(whole) - 128), "most of what was changed matters"


@pytest.mark.parametrize("kind", [1, 2, 4, 6])
def test_memory_is_taken_for_bytes_that_are_there(tmp_path, kind):
    (tmp_path / "log.mat").write_bytes(mat_matrix((60_000_000, 1), array=kind))
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match=r"promises 60000000 numbers and holds 4|no columns|separated|expected"):
            read_log(tmp_path / "log.mat")
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
