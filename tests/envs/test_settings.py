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
