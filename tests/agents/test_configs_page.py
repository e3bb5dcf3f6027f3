"""docs/agents/configs.md says what the settings are, and its examples are taken."""

from __future__ import annotations

import json
import re
import shlex
from typing import Any

import gymnasium as gym
import pytest
import tyro
import yaml

import envs
from agents.commands.benchmark import BenchmarkOptions
from agents.commands.train import TrainOptions
from agents.evaluation.benchmark_config import Published
from agents.yaml_config import shipped_configs
from tools import config_tables as configs_page
from tools.config_tables import PAGE, documented, own_fields, updated

TEXT = PAGE.read_text()
COMMANDS = [
    shlex.split(line, comments=True)[1:]
    for block in re.findall(r"^```sh\n(.*?)^```", TEXT, flags=re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]


def rows(name: str) -> dict[str, list[str]]:
    """The cells of a table on the page, by key."""
    _, _, after = TEXT.partition(f"<!-- settings of {name} -->\n")
    lines, _, _ = after.partition(f"\n<!-- end of {name} -->")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines.splitlines()[2:]]
    return {key.strip("`"): others for key, *others in cells}


@pytest.mark.parametrize("name", documented())
def test_every_key_is_there_with_its_default(name: str) -> None:
    kind = documented()[name]
    fields = kind.model_fields
    shown = rows(name)
    assert list(shown) == own_fields(kind)
    for key, (values, default, _, meaning) in shown.items():
        assert values
        assert meaning
        if fields[key].is_required():
            assert default == "required"
            continue
        kept = fields[key].get_default(call_default_factory=True)
        wanted = kept if isinstance(kept, str) and kept else json.dumps(kept)
        assert default == f"`{wanted}`"


def test_the_page_is_what_its_command_writes() -> None:
    assert updated(TEXT) == TEXT, "run python -m tools.config_tables"


@pytest.mark.parametrize("env_id", envs.env_ids())
def test_the_settings_of_an_environment_are_its_own(env_id: str) -> None:
    with gym.make(env_id) as env:
        config: Any = env.unwrapped.task.config  # type: ignore[attr-defined]
    assert type(config) is documented()[env_id]


@pytest.mark.parametrize("config", shipped_configs())
def test_the_page_knows_every_shipped_config(config: str) -> None:
    folder, _, _ = config.rpartition("/")
    assert f"`{folder}/`" in TEXT if folder else f"`{config}.yaml`" in TEXT


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_examples_are_taken(command: list[str], tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds: dict[str, Any] = {"benchmark": BenchmarkOptions, "train": TrainOptions}
    shipped = {"benchmark": "benchmark", "train": "ppo/ConveyorTrack-v0"}[command[0]]
    for own in ("mine.yaml", "my_tasks.yaml"):
        (tmp_path / own).write_text((PAGE.parents[2] / "configs" / f"{shipped}.yaml").read_text())
    monkeypatch.chdir(tmp_path)
    config = tyro.cli(kinds[command[0]], args=command[1:]).resolve()
    for change in (part for part in command if "=" in part):
        key, _, value = change.partition("=")
        got: Any = config.model_dump(mode="json")
        for level in key.split("."):
            got = got[level]
        assert got == yaml.safe_load(value)


def test_a_page_without_marks_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(configs_page, "documented", lambda: {"Example": Published})
    with pytest.raises(ValueError, match=r"needs a pair each for \['Example'\]"):
        updated("no marks")
    page = updated("before\n<!-- settings of Example -->\nstale\n<!-- end of Example -->\nafter\n")
    assert "stale" not in page
    assert page.startswith("before\n<!-- settings of Example -->\n| key |")
    assert page.endswith("|\n<!-- end of Example -->\nafter\n")


@pytest.mark.parametrize("name", documented())
def test_settings_within_settings_have_a_table_of_their_own(name: str) -> None:
    named = {word for values, *_ in rows(name).values() for word in re.findall(r"[A-Z]\w+", values)}
    assert named <= set(documented())
