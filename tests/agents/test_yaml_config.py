"""Configurations: the shipped ones are valid, and what is wrong in others is said."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from agents.commands.benchmark import BenchmarkOptions
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.yaml_config import assigned, load_config, shipped_configs

GOOD = "episodes: 3\nbound_episodes: 1\npolicies: [follower]\ntasks:\n  - env: ConveyorTrack-v0\n"


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    return tmp_path / "mine.yaml"


def test_the_shipped_benchmark_is_valid() -> None:
    assert "benchmark" in shipped_configs()
    config = load_config("benchmark", BenchmarkConfig)
    assert config.policies == ("agent", "dpct", "lagrange", "apf", "follower", "random")
    paper = config.tasks[1]
    assert paper.options == {"scenario": "paper"}
    assert paper.published is not None
    assert paper.published.settling_time == 1.10


def test_a_path_is_read(config_file: Path) -> None:
    config_file.write_text(GOOD)
    config = load_config(str(config_file), BenchmarkConfig)
    assert (config.episodes, config.seed, config.tasks[0].title) == (3, 0, "ConveyorTrack-v0")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (GOOD + "sede: 3\n", 'unknown .* "sede"; did you mean "seed"'),
        (GOOD + "    optoins: {}\n", 'tasks.0: unknown setting "optoins"; did you mean "options"'),
        (GOOD + "    published: {sourc: x, settling_time: 1}\n", '"sourc"; did you mean "source"'),
        (GOOD.replace("episodes: 3", "episodes: 0"), "episodes = 0"),
        (GOOD.replace("policies: [follower]", "policies: []"), "policies"),
        ("episodes: [", "is no YAML"),
        ("- 3", "must hold names and values"),
    ],
)
def test_what_is_wrong_in_a_file_is_said(config_file: Path, text: str, complaint: str) -> None:
    config_file.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        load_config(str(config_file), BenchmarkConfig)


@pytest.mark.parametrize("number", ["1e-4", "5E-05", "[0.0, 1e-4]", "2e0", ".5e-2", "-1.e+3", "1.5e3"])
def test_powers_of_ten_are_numbers(number: str) -> None:
    assert assigned({}, [f"encoder_noise={number}"]) == {"encoder_noise": ast.literal_eval(number)}
    for text in ("e5", "1e3x"):
        assert assigned({}, [f"name={text}"]) == {"name": text}


@pytest.mark.parametrize(("written", "read"), [("1_000_000", 1_000_000), ("010", 10), ("1_0", "1_0"), ("0b11", "0b11")])
def test_whole_numbers_are_those_of_yaml_1_2_or_have_thousands_apart(written: str, read: object) -> None:
    assert assigned({}, [f"total_steps={written}"]) == {"total_steps": read}


def test_missing_files_and_unknown_names(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="cannot read"):
        load_config(str(tmp_path / "none.yaml"), BenchmarkConfig)
    with pytest.raises(ValueError, match='did you mean "benchmark"'):
        load_config("benchmrak", BenchmarkConfig)


def test_the_command_line_changes_the_configuration() -> None:
    options = BenchmarkOptions(episodes=2, seed=9, policies=("random",), tasks=("ConveyorTrack-v0/paper",), num_envs=1)
    config = options.resolve()
    assert (config.episodes, config.seed, config.policies, config.num_envs) == (2, 9, ("random",), 1)
    assert [task.title for task in config.tasks] == ["ConveyorTrack-v0/paper"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (BenchmarkOptions(tasks=("ConveyorTrack",)), 'did you mean "ConveyorTrack-v0"'),
        (BenchmarkOptions(episodes=0), "episodes = 0"),
        (BenchmarkOptions(seed=-1), "seed = -1"),
        (BenchmarkOptions(policies=()), "policies"),
    ],
)
def test_what_is_wrong_on_the_command_line_is_said(options: BenchmarkOptions, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        options.resolve()
