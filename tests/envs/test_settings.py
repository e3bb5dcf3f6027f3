import pytest

from envs.settings import Settings, refuse_unknown


class Example(Settings):
    speed: float = 1.0
    name: str = "a"


def test_defaults_and_values() -> None:
    assert Example.parse({"speed": 2}, "example").speed == 2.0


def test_a_typo_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ValueError, match=r'unknown example "sped"; did you mean "speed"\? \(known: name, speed\)'):
        Example.parse({"sped": 2.0}, "example")


@pytest.mark.parametrize("value", ["fast", float("nan"), float("inf"), None])
def test_a_bad_value_is_named(value: object) -> None:
    with pytest.raises(ValueError, match=r"^example: speed = "):
        Example.parse({"speed": value}, "example")


def test_a_name_like_no_other_gets_no_hint() -> None:
    with pytest.raises(ValueError, match=r'unknown thing "zzz" \(known: a, b\)'):
        refuse_unknown(["zzz"], ["b", "a"], "thing")


class Described(Settings):
    """Settings of a test.

    Attributes:
        speed, other_speed: of the hand, m/s; never negative.
        length: how long it is,
            and how far, m.
    """

    speed: float = 1.0
    other_speed: float = 2.0
    length: float | None = None


def test_a_docstring_becomes_a_table() -> None:
    assert Described.descriptions()["length"] == "how long it is, and how far, m."
    assert Described.table().splitlines()[2:] == [
        "| `speed` | number | `1.0` | m/s | of the hand; never negative |",
        "| `other_speed` | number | `2.0` | m/s | of the hand; never negative |",
        "| `length` | number or null | `null` | m | how long it is, and how far |",
    ]


def test_a_field_without_description_is_named() -> None:
    class Undescribed(Described):
        """Settings without their attributes."""

        weight: float = 1.0

    with pytest.raises(ValueError, match="Undescribed does not describe weight"):
        Undescribed.table()


def test_compiled_code_reads_numbers_and_bools() -> None:
    class Mixed(Example):
        count: int = 1
        gravity: bool = False
        pair: tuple[float, float] | None = None

    assert Mixed(speed=2.0).numbers() == {"speed": 2.0, "count": 1, "gravity": False}
