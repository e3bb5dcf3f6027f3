import numpy as np
import pytest

from envs.observation import Entry, Layout

LAYOUT = Layout((Entry("angle", (2,), 2.0, 4.0, "rad", "of the joints"), Entry("time", (), 0.5, 1.0, "s", "left")))


def test_parse_gives_physical_values_by_name() -> None:
    seen = LAYOUT.parse(np.array([[1.0, -1.0, 0.5], [0.0, 0.25, 1.0]], dtype=np.float32))
    np.testing.assert_array_equal(seen["angle"], [[2.0, -2.0], [0.0, 0.5]])
    np.testing.assert_array_equal(seen["time"], [[0.25], [0.5]])


def test_space_has_the_declared_bounds() -> None:
    space = LAYOUT.space()
    np.testing.assert_array_equal(space.high, np.array([4.0, 4.0, 1.0], dtype=np.float32))
    np.testing.assert_array_equal(space.low, -space.high)


def test_a_wrong_size_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(2,\).*3 elements"):
        LAYOUT.parse(np.zeros(2, dtype=np.float32))


def test_table_names_every_entry() -> None:
    assert "| 0-1 | `angle` | rad | 2 | ±8 | of the joints |" in LAYOUT.table()
    assert "| 2 | `time` | s | 0.5 | ±0.5 | left |" in LAYOUT.table()


def test_the_record_holds_the_values_by_name_and_flat() -> None:
    layout = Layout((*LAYOUT.entries, Entry("disc", (2, 2), 1.0, 1.0, "m", "centres")))
    record = np.zeros(1, layout.record)
    record["angle"], record["time"], record["disc"] = [1.0, 2.0], 3.0, [[4.0, 5.0], [6.0, 7.0]]
    np.testing.assert_array_equal(record["flat"][0], np.arange(1.0, 8.0))
