"""Opening: whatever the bytes, the answer is a record or one sentence."""

from hypothesis import HealthCheck, given, settings

from data_io import LogError, Record, read_log
from experiments.drawn_logs import broken, tables
from experiments.run_reader_fuzz import difference


def put(tmp_path, content):
    path = tmp_path / "log.txt"
    path.write_bytes(content)
    return path


@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(broken())
def test_mutated_logs_are_records_or_sentences(tmp_path, data):
    try:
        record = read_log(put(tmp_path, data))
    except LogError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(record, Record) and len(record) >= 2


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tables())
def test_a_sound_table_is_read_to_the_last_digit_in_whatever_layout(tmp_path, drawn):
    record = read_log(put(tmp_path, drawn.data))
    assert difference(record, drawn, whole=True) == "" and not [f for f in record.findings if f.severity != "info"]
