"""The first line of every shipped agent's card: what separates it from the best planner, and how it was trained."""

from __future__ import annotations

import pytest

from agents.policies.files import load_agent
from tools.site.agent_cards import PAGE, ROOT, gap, shipped, summary, updated

TABLES = """### Swing-v0/windy: 64 episodes

|policy|success (%)|time (s)|
|---|---|---|
|random|99|1|
|field|90 (80-95)|1.2|
|agent|80 (70-90)|1.4|

|difference|success (points)|time (s)|
|---|---|---|
|agent - random|-19 (-20 to -18)|+0.4|
|agent - field|-10 (-12 to -8)|+0.2 (+0.1 to +0.3)|

### Other-v0: 8 episodes
"""


@pytest.mark.parametrize(("env_id", "variant"), shipped())
def test_a_card_begins_with_the_gap_in_the_published_tables(env_id: str, variant: str | None) -> None:
    line, document = summary(env_id, variant), load_agent(env_id, variant).document
    assert (next(iter(document)), document["summary"]) == ("summary", line), "run python -m tools.site.agent_cards"


def test_the_page_has_the_cards_and_training_seeds_of_the_shipped_agents() -> None:
    page = (ROOT / PAGE).read_text(encoding="utf-8")
    assert updated(page) == page, "run python -m tools.site.agent_cards"
    line = summary("MinTorqueMove-v0", None)
    assert f"<!-- card of MinTorqueMove-v0 -->\n{line}\n<!-- end" in page


def test_an_agent_that_ppo_did_not_improve_does_not_claim_it() -> None:
    assert "Fitted through the dynamics; PPO brought no gain" in summary("MinTorqueMove-v0", None)
    assert "768,000 steps of PPO" in summary("ConveyorTrack-v0", None)


def test_the_best_planner_is_the_first_of_the_table() -> None:
    line = (
        "Against field, the best planner, in 64 episodes of level windy: success -10 points (-12 to -8), "
        "time +0.2 s (+0.1 to +0.3)."
    )
    assert gap(TABLES, "Swing-v0", "agent") == line
    calm = TABLES.replace("windy", "calm")
    assert gap(TABLES + calm, "Swing-v0", "agent") == f"{line} {line.replace('windy', 'calm')}"
    for env_id, policy in (("Swing-v0", "agent:calm"), ("Other-v0", "agent")):
        with pytest.raises(ValueError, match=f"no table of {env_id} compares {policy} with planners"):
            gap(TABLES, env_id, policy)
