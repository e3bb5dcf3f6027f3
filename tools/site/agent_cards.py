"""What the page of the agents says of every shipped agent: the first line of its card, and its training seeds.

The first line is the gap to the best planner and how the agent was trained. ``python -m tools.site.agent_cards`` reads
the published tables and writes the line as ``summary``, the first entry of the agent's JSON, and below its heading on
the page; and it writes the table of training seeds from the JSON. Tests compare them.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.policies.agent import Agent
from agents.policies.files import load_agent, save_agent, shipped_agents, shipped_variants
from agents.policies.lookup import SHIPPED
from planners.files import write_text
from tools.release_agent import TRAINED
from tools.site.marks import replaced
from tools.site.training_seeds import meaning, result, training_seeds

ROOT = Path(__file__).parent.parent.parent
PAGE, LEADERBOARD = "docs/agents/index.md", "docs/benchmark/leaderboard.md"
HARDER = "docs/agents/harder.md"
"""Page with the held-out results of the agents for harder episodes."""
NO_PLANNERS = ("follower", "random")


def shipped() -> list[tuple[str, str | None]]:
    """Every shipped agent: the environment, and the name of one for harder episodes."""
    return [(env_id, name) for env_id in shipped_agents() for name in (None, *shipped_variants(env_id))]


def summary(env_id: str, variant: str | None) -> str:
    """The first line of an agent's card."""
    policy = SHIPPED if variant is None else f"{SHIPPED}:{variant}"
    page = ROOT / (LEADERBOARD if variant is None else HARDER)
    return f"{gap(page.read_text(encoding='utf-8'), env_id, policy)} {training(load_agent(env_id, variant).document)}"


def gap(page: str, env_id: str, policy: str) -> str:
    """What separates a policy from the best planner, with 95 % intervals, from the tables of each level that have both.

    Raises:
        ValueError: if no table of the page has them.
    """
    sections = re.findall(
        rf"^### {re.escape(env_id)}(?:/([\w-]+))?: (\d+ episodes)\n(.*?)(?=^### |\Z)", page, re.M | re.S
    )
    sentences = []
    for level, episodes, section in sections:
        tables = [_rows(table) for table in re.findall(r"(?:^\|.*\n)+", section, re.M)]
        if len(tables) < 2 or policy not in tables[0]:
            continue
        scores, differences = tables[:2]
        best = next(name for name in scores if f"{policy} - {name}" in differences and name not in NO_PLANNERS)
        titles, cells = differences["difference"], differences[f"{policy} - {best}"]
        parts = []
        for title, cell in zip(titles[:2], cells[:2], strict=True):
            name, _, unit = title.removesuffix(")").partition(" (")
            number, _, interval = cell.partition(" ")
            parts.append(" ".join(filter(None, (name, number, unit, interval))))
        where = f"{episodes} of level {level}" if level else episodes
        sentences.append(f"Against {best}, the best planner, in {where}: {', '.join(parts)}.")
    if not sentences:
        raise ValueError(f"no table of {env_id} compares {policy} with planners")
    return " ".join(sentences)


def training(document: Mapping[str, Any]) -> str:
    """How an agent was trained, in a sentence."""
    config, steps = document["training"]["config"], int(document["training"]["steps"])
    warm_start = config.get("warm_start")
    if steps == 0 and config.get("amortise"):
        return "Fitted through the dynamics; PPO brought no gain, and none of its steps is in the weights."
    if config.get("forecasts"):
        after = (
            f" {steps:,} steps of PPO went on from there." if steps else " PPO brought no gain: none is in the weights."
        )
        return f"Fitted to the paths of discs.{after}"
    before = f"A clone of {warm_start['expert']} by DAgger, then " if warm_start else ""
    return f"{before}{steps:,} steps of PPO."


def main() -> int:
    """Write the lines; the exit code."""
    for env_id, variant in shipped():
        agent, line = load_agent(env_id, variant), summary(env_id, variant)
        document = {"summary": line} | {key: value for key, value in agent.document.items() if key != "summary"}
        save_agent(Agent(document, agent.tensors), TRAINED / f"{_name(env_id, variant)}.safetensors")
    write_text(ROOT / PAGE, updated((ROOT / PAGE).read_text(encoding="utf-8")))
    return 0


def updated(page: str) -> str:
    """The page of the agents with what the JSON of each says."""
    meanings = set()
    for env_id, variant in shipped():
        document, name = load_agent(env_id, variant).document, _name(env_id, variant)
        page = replaced(page, f"card of {name}", document["summary"])
        if len(document["seeds"]) > 1:
            page = replaced(page, f"{name} seeds", f"{training_seeds(document)}\n{result(document)}")
            meanings.add(meaning(document))
    return replaced(page, "meaning of the seeds", "\n\n".join(sorted(meanings)))


def _name(env_id: str, variant: str | None) -> str:
    """Name of an agent's files."""
    return env_id if variant is None else f"{env_id}.{variant}"


def _rows(table: str) -> dict[str, list[str]]:
    """The rows of a table by their first cell, its header among them."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    return {row[0]: row[1:] for row in rows}


if __name__ == "__main__":
    sys.exit(main())
