"""Submissions: written, claimed, checked and refused, on the public list and on the sealed one."""

from __future__ import annotations

import hashlib
import hmac
import json
import math
import os
import re
import stat
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
import yaml

import agents
from agents import Agent, load_agent, save_agent
from agents.cli import main
from agents.submissions import sealed
from agents.submissions.card import Card, Claim, read_card
from agents.submissions.claims import ROUNDING, claim_of
from agents.submissions.folder import MOST_JSON_BYTES, MOST_LAYERS, MOST_WEIGHT_BYTES
from agents.submissions.sealed import SealedList, published
from envs.settings import Settings
from tools.seal.__main__ import SealOptions
from tools.seal.__main__ import main as seal

ROOT = Path(__file__).parent.parent.parent
ENV = "ConveyorTrack-v0"
FEW = ["--episodes", "3", "--against", "random"]
SECRET = "0123456789abcdef" * 4
Edit = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def claimed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A submission with the claims of three episodes."""
    folder = tmp_path_factory.mktemp("submissions") / "mine"
    about = ["--authors", "Ada Lovelace", "--licence", "MIT", "--training", "by hand"]
    assert main(["submit", "export", "agent", str(folder), "--env", ENV, *about]) == 0
    edit_card(folder, lambda card: card.update(tasks=[ENV]))
    assert main(["submit", "claim", str(folder), "--episodes", "3"]) == 0
    return folder


@pytest.fixture
def mine(claimed: Path, tmp_path: Path) -> Path:
    """A copy of it, to spoil."""
    return copytree(claimed, tmp_path / "mine")


@pytest.fixture
def lists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What is published of a sealed list whose secret is `SECRET`; the file of the secret is beside it."""
    path = tmp_path / "sealed.json"
    digest = hashlib.sha256(bytes.fromhex(SECRET)).hexdigest()
    path.write_text(json.dumps({"release": "9.9", "sha256": digest}))
    (tmp_path / "secret").write_text(f"{SECRET}\n")
    monkeypatch.setattr(sealed, "PUBLISHED", path)
    monkeypatch.delenv("PLANARM_SEALED", raising=False)
    return path


def edit_card(folder: Path, edit: Edit) -> None:
    card = yaml.safe_load((folder / "card.yaml").read_text())
    edit(card)
    (folder / "card.yaml").write_text(yaml.safe_dump(card, sort_keys=False))


def edit_agent(folder: Path, edit: Callable[[dict[str, Any], dict[str, Any]], object]) -> None:
    """Change the JSON and the tensors of the agent of a submission, whose hash stays right."""
    agent = load_agent(folder / "agent.safetensors")
    document, tensors = dict(agent.document), {name: np.array(tensor) for name, tensor in agent.tensors.items()}
    edit(document, tensors)
    save_agent(Agent(document, tensors), folder / "agent.safetensors")


def refusal(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Why a submission is refused, in one sentence."""
    capsys.readouterr()
    assert main(["submit", "check", str(folder), *FEW]) == 1
    title, empty, reason, *_ = capsys.readouterr().out.split("\n")
    assert (title, empty) == (f"{folder}: refused", "")
    return reason


def test_a_submission_is_scored_and_compared_in_pairs(
    claimed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["submit", "check", str(claimed), "--episodes", "3", "--against", "random", "follower"]
    assert main([*command, "--json", str(tmp_path / "checked.json"), "--format", "markdown"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"## {claimed}: accepted\n\nthe claimed numbers come out to the bit.")
    assert "|mine - random" in out
    assert "|mine - follower" in out
    assert "Scored on the public list only" in out
    (checked,) = json.loads((tmp_path / "checked.json").read_text())["submissions"]
    assert (checked["accepted"], checked["sealed"]) == (True, None)
    scored, (result,) = checked["scored"]["tasks"][ENV], checked["public"]["results"]
    assert checked["card"]["claims"]["tasks"][ENV] == scored
    evaluation = agents.evaluate("agent", ENV, range(3))
    assert scored["success"] == evaluation.success.sum() == 3
    assert scored["steps"] == evaluation.lengths.sum()
    assert scored["median"] == np.median(evaluation.metrics["settling_time"])
    assert result["policies"][0]["episodes"]["return"] == evaluation.returns.tolist()
    columns = [evaluation.seeds, evaluation.lengths, evaluation.returns, evaluation.metrics["settling_time"]]
    content = b"".join(column.astype(column.dtype.newbyteorder("<")).tobytes() for column in columns)
    assert scored["digest"] == hashlib.sha256(content + bytes([1, 1, 1])).hexdigest()
    assert {pair["against"] for pair in result["pairs"]} == {"random", "follower"}


def test_by_default_every_policy_of_the_leaderboard_is_compared(claimed: Path) -> None:
    from agents.submissions.check import benchmark_of
    from agents.submissions.folder import read_submission

    benchmark = benchmark_of(read_submission(claimed), None)
    (task,) = benchmark.config.tasks
    assert [named.name for named in benchmark.policies(task)] == [
        *("mine", "agent", "dpct", "lagrange", "apf", "follower", "random")
    ]
    assert task.episodes == 128


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"success": 2}, f"{ENV}: success 2 is claimed, 3 is scored"),
        ({"returns": 1.25}, f"{ENV}: returns 1.25 is claimed, 1."),
        ({"median": None}, f"{ENV}: median None is claimed, 1.2 is scored"),
        ({"digest": "0" * 64}, f"{ENV}: digest 0000"),
        ({"episodes": 128}, f"{ENV}: episodes 128 is claimed, 3 is scored"),
    ],
    ids=str,
)
def test_claims_that_do_not_come_out_to_the_bit_are_refused(
    mine: Path, changes: dict[str, Any], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    edit_card(mine, lambda card: card["claims"]["tasks"][ENV].update(changes))
    assert f"do not come out on the platform that is claimed: {reason}" in refusal(mine, capsys)


def test_the_last_bit_of_a_return_counts(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def raise_it(card: dict[str, Any]) -> None:
        claim = card["claims"]["tasks"][ENV]
        claim["returns"] = math.nextafter(claim["returns"], math.inf)

    edit_card(mine, raise_it)
    assert "returns 1." in refusal(mine, capsys)


def test_another_platform_may_round_differently_and_no_more(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def elsewhere(card: dict[str, Any], share: float) -> None:
        card["claims"]["platform"]["cpu"] = "abacus"
        claim = card["claims"]["tasks"][ENV]
        claim.update(digest="0" * 64, returns=claim["returns"] * (1.0 + share))

    edit_card(mine, lambda card: elsewhere(card, 1e-7))
    assert main(["submit", "check", str(mine), *FEW]) == 0
    assert "come out to 1e-05 on another platform than the claimed one (cpu)" in capsys.readouterr().out
    edit_card(mine, lambda card: card["claims"].update(platform={"cpu": card["claims"]["platform"]["cpu"]}))
    assert main(["submit", "check", str(mine), *FEW]) == 0
    edit_card(mine, lambda card: elsewhere(card, 1e-3))
    assert "beyond what the rounding of another platform changes (cpu)" in refusal(mine, capsys)
    edit_card(mine, lambda card: card["claims"]["tasks"][ENV].update(success=2))
    assert "success 2 is claimed" in refusal(mine, capsys)


@pytest.mark.parametrize("platform", [{}, {"abacus": "wood"}], ids=str)
def test_claims_that_do_not_say_where_they_were_computed_come_out_to_the_bit(
    mine: Path, platform: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    edit_card(mine, lambda card: card["claims"].update(platform=platform))
    assert main(["submit", "check", str(mine), *FEW]) == 0
    edit_card(mine, lambda card: card["claims"]["tasks"][ENV].update(digest="0" * 64))
    assert f"on the platform that is claimed: {ENV}: digest 0000" in refusal(mine, capsys)


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (lambda card: card.pop("claims"), "the card claims no scores: planarm submit claim writes them"),
        (lambda card: card["claims"]["tasks"].clear(), "claims scores on no task, not on ConveyorTrack-v0"),
        (lambda card: card.update(format=2), "has format 2; this version of planarm reads cards of format 1"),
        (lambda card: card.update(authors=[]), "entry: authors"),
        *(
            (lambda card, name=name: card.update(name=name), f'name "{name}" is that of a policy or of another row')
            for name in ("dpct", "DPCT", "d-p.ct", "kalman", "paper", "Best known", "bound", "lower_bound")
        ),
        *(
            (lambda card, name=name: card.update(name=name), f"entry: name = {re.escape(repr(name))}")
            for name in ("a|b", "apf.", "Apf ", " apf", "-", "")
        ),
        (lambda card: card.update(link="http://x"), "entry: link = 'http://x'"),
        (lambda card: card.update(tasks=["my_module:Task-v0"]), "unknown task of the leaderboard"),
        (lambda card: card.update(tasks=["ObstacleDodge-v0"]), "is one of ObstacleDodge-v0; the agent was trained on"),
        (lambda card: card.update(tasks=[ENV, ENV]), "is given 2 times"),
        (
            lambda card: card.update(settings={"control_mode": "torque"}),
            "settings {'control_mode': 'torque'} are not those of the agent",
        ),
        (lambda card: card.update(licens="MIT"), r'unknown .*card\.yaml entry "licens"; did you mean "licence"'),
    ],
)
def test_cards_that_do_not_fit_are_refused(
    mine: Path, edit: Edit, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    edit_card(mine, edit)
    assert re.search(reason, refusal(mine, capsys))


def overflowing(document: dict[str, Any], tensors: dict[str, Any]) -> None:
    for name in ("layer0.weight", "layer1.weight", "layer2.weight"):
        tensors[name][:] = np.float32(3e38) * (-1.0) ** np.arange(tensors[name].shape[1])


def deep(document: dict[str, Any], tensors: dict[str, Any]) -> None:
    sizes = [18 + tensors["fine.index"].size, *[4] * 9, 2]
    for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
        tensors[f"layer{layer}.weight"] = np.zeros((outputs, inputs), np.float32)
        tensors[f"layer{layer}.bias"] = np.zeros(outputs, np.float32)
    document["hidden"] = sizes[1:-1]


def wide(document: dict[str, Any], tensors: dict[str, Any]) -> None:
    tensors["unused"] = np.zeros(1 << 19, np.float32)


def three_actions(document: dict[str, Any], tensors: dict[str, Any]) -> None:
    last = f"layer{len(document['hidden'])}"
    for name in (f"{last}.weight", f"{last}.bias", "log_std"):
        tensors[name] = np.concatenate([tensors[name], tensors[name][:1]])


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (overflowing, "mine gave the action [nan, nan] in environment 0; actions are finite"),
        (deep, "has 9 hidden layers; 8 are the most"),
        (wide, "bytes; 2097152 are the most in a submission"),
        (three_actions, "mine gave actions of shape (1, 3); expected (1, 2)"),
    ],
)
def test_networks_that_cannot_act_are_refused(
    mine: Path, edit: Any, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    edit_agent(mine, edit)
    assert reason in refusal(mine, capsys)


def test_an_agent_of_another_task_is_refused_by_its_observations(
    mine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = load_agent("ObstacleDodge-v0")
    content = load_agent(mine / "agent.safetensors")
    document = {**content.document, "hidden": other.document["hidden"]}
    save_agent(Agent(document, {**other.tensors}), mine / "agent.safetensors")
    assert "takes observations of 36 elements; ConveyorTrack-v0 gives 18" in refusal(mine, capsys)


def spoil_with_link(folder: Path) -> None:
    (folder / "card.yaml").rename(folder.parent / "elsewhere.yaml")
    (folder / "card.yaml").symlink_to(folder.parent / "elsewhere.yaml")


def spoil_with_arm(folder: Path) -> None:
    document = json.loads((folder / "agent.json").read_text())
    document["env_config"]["arm"] = "/etc/passwd"
    (folder / "agent.json").write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda folder: (folder / "policy.py").write_text("print()"), "holds 'policy.py', which is no part of a"),
        (lambda folder: (folder / "card.json").write_text("{}"), "has card.yaml and card.json: keep one of them"),
        (lambda folder: (folder / "card.yaml").unlink(), "lacks card.yaml: planarm submit export writes"),
        (lambda folder: (folder / "agent.json").write_text(" " * 300_000), "has 300000 bytes; 262144 are the most"),
        (spoil_with_link, "holds 'card.yaml', which is no part of a submission: .* plain files and no links"),
        (spoil_with_arm, "names an arm in a file: write the arm itself there"),
    ],
)
def test_folders_that_hold_something_else_are_refused(
    mine: Path, spoil: Callable[[Path], object], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(mine)
    assert re.search(reason, refusal(mine, capsys))


def test_what_is_asked_for_and_impossible_ends_with_2(
    mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for more, complaint in (
        ([str(tmp_path / "none")], "no folder"),
        ([], "no submission: give the folder of one"),
        ([str(mine), "--episodes", "0"], "episodes 0 must be at least 1"),
        ([str(mine), "--sealed", str(tmp_path / "none")], "cannot read"),
        ([str(mine), "--against", "random", "apff"], 'did you mean "apf"'),
        ([str(tmp_path), str(mine), "--against", "agent:none"], 'for harder episodes "none"'),
        ([str(mine), "--against", "kalman"], "kalman"),
        ([str(mine), "--against", "apf", "apf"], '"apf" is given 2 times'),
        ([str(mine), "--against", "mine"], '"mine" is given 2 times'),
    ):
        assert main(["submit", "check", *more]) == 2
        assert complaint in capsys.readouterr().err
    for source, complaint in (("dpct", "dpct is code"), ("none.safetensors", "no file none.safetensors")):
        assert main(["submit", "export", source, str(tmp_path / "new"), "--env", ENV]) == 2
        assert complaint in capsys.readouterr().err
    assert (
        main(["submit", "export", str(mine / "agent.safetensors"), str(mine), "--env", ENV, "--settings", "x=1"]) == 2
    )


def test_a_policy_to_compare_with_that_fails_is_no_reason_to_refuse(
    mine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Failing:
        steps = 0

        def predict(self, observation: Any) -> Any:
            if self.steps == 5:
                raise ValueError("no plan for this episode")
            self.steps += 1
            return np.zeros((len(observation), 2), np.float32), None

    monkeypatch.setattr(agents, "failing", lambda env: Failing(), raising=False)
    assert main(["submit", "check", str(mine), "--episodes", "3", "--against", "agents:failing"]) == 2
    captured = capsys.readouterr()
    assert "no plan for this episode" in captured.err
    assert "refused" not in captured.out


def test_several_are_judged_one_by_one(mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoilt = copytree(mine, tmp_path / "spoilt")
    edit_card(spoilt, lambda card: card["claims"]["tasks"][ENV].update(success=1))
    out = tmp_path / "checked.json"
    assert main(["submit", "check", str(spoilt), str(mine), *FEW, "--json", str(out)]) == 1
    shown = capsys.readouterr().out
    assert f"{spoilt}: refused\n" in shown
    assert f"{mine}: accepted\n" in shown
    refused, accepted = json.loads(out.read_text())["submissions"]
    assert (refused["accepted"], refused["public"], accepted["accepted"]) == (False, None, True)
    assert "success 1 is claimed, 3 is scored" in refused["reason"]
    assert refused["scored"] == accepted["scored"]


def test_a_run_is_exported_with_its_best_agent_and_a_card_is_kept(mine: Path, tmp_path: Path) -> None:
    shipped = load_agent("ObstacleDodge-v0")
    save_agent(shipped, tmp_path / "run" / "best.safetensors")
    command = ["submit", "export", str(tmp_path / "run"), str(tmp_path / "new"), "--env", "ObstacleDodge-v0"]
    assert main(command) == 0
    card = yaml.safe_load((tmp_path / "new" / "card.yaml").read_text())
    assert (card["name"], card["tasks"], card["authors"]) == ("new", ["ObstacleDodge-v0"], [])
    assert (card["settings"], card["steps"]) == (
        {"control_mode": "velocity"},
        shipped.document["training"]["steps"],
    )
    written = load_agent(tmp_path / "new" / "agent.safetensors")
    assert all(np.array_equal(tensor, shipped.tensors[name]) for name, tensor in written.tensors.items())
    before = (mine / "card.yaml").read_text()
    assert main(["submit", "export", "agent", str(mine), "--env", ENV, "--name", "other"]) == 0
    assert (mine / "card.yaml").read_text() == before


def test_an_interrupted_check_decides_nothing(
    mine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("agents.submissions.command.run_with_bar", lambda *args, **options: 143)
    assert main(["submit", "check", str(mine), *FEW]) == 143
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "interrupted: nothing was decided" in captured.err


def test_claims_replace_those_of_the_card_and_nothing_else(mine: Path) -> None:
    card = mine / "card.yaml"
    before = read_card(card)
    text = card.read_text().replace("licence: MIT", "licence: MIT  # of the weights")
    head, _, claims = text.partition("claims:\n")
    card.write_text(f"# mine\n{head}claims:\n{claims}\nlink: https://example.org/mine\n".replace("link: null\n", ""))
    assert main(["submit", "claim", str(mine), "--episodes", "2"]) == 0
    after = read_card(card)
    assert card.read_text().startswith(f"# mine\n{head}".replace("link: null\n", ""))
    assert (after.link, after.claims and after.claims.tasks[ENV].episodes) == ("https://example.org/mine", 2)
    document = json.loads(before.model_dump_json())
    card.unlink()
    (mine / "card.json").write_text(json.dumps({**document, "claims": None}))
    assert main(["submit", "claim", str(mine), "--episodes", "3"]) == 0
    assert read_card(mine / "card.json") == before


def test_the_sealed_list_is_scored_and_stays_sealed(
    claimed: Path, lists: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "checked.json"
    secret = str(tmp_path / "secret")
    assert main(["submit", "check", str(claimed), *FEW, "--sealed", secret, "--json", str(out)]) == 0
    shown, written = capsys.readouterr().out, out.read_text()
    (checked,) = json.loads(written)["submissions"]
    seeds = []
    for number in range(3):
        code = hmac.new(bytes.fromhex(SECRET), f"planarm sealed list\n{ENV}\n{number}".encode(), "sha256").digest()
        seeds.append(int.from_bytes(code[:8], "big") // 8)
    assert not [seed for seed in seeds if str(seed) in shown + written]
    assert SECRET not in shown + written
    by_hand = agents.evaluate("agent", ENV, seeds)
    (result,) = checked["sealed"]["results"]
    scores = {each["policy"]: each["summary"] for each in result["policies"]}
    assert scores["mine"]["settling_time"]["value"] == np.median(by_hand.metrics["settling_time"])
    assert scores.keys() == {"mine", "random"}
    assert checked["sealed"]["sha256"] == json.loads(lists.read_text())["sha256"]
    assert "On the sealed list of 9.9" in shown


def test_the_secret_may_be_in_the_environment_and_must_be_the_published_one(
    claimed: Path, lists: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PLANARM_SEALED", SECRET)
    assert main(["submit", "check", str(claimed), *FEW]) == 0
    assert "On the sealed list of 9.9" in capsys.readouterr().out
    for text, complaint in ((SECRET[::-1], "its hash differs"), ("abc", "holds no secret of a sealed list")):
        monkeypatch.setenv("PLANARM_SEALED", text)
        assert main(["submit", "check", str(claimed), *FEW]) == 2
        error = capsys.readouterr().err
        assert complaint in error
        assert text not in error


def test_a_list_opens_with_the_next_release_and_is_verified(
    claimed: Path, lists: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = published().sha256
    options = SealOptions("10.0", last=tmp_path / "secret", new=tmp_path / "next")
    assert seal(options) == 0
    assert stat.S_IMODE(os.stat(tmp_path / "next").st_mode) == 0o600
    now = published()
    assert (now.release, now.opened[0].release, now.opened[0].sha256) == ("10.0", "9.9", before)
    assert hashlib.sha256(bytes.fromhex((tmp_path / "next").read_text().strip())).hexdigest() == now.sha256
    capsys.readouterr()
    assert main(["submit", "sealed"]) == 0
    assert re.findall(r"^\|([\d.]+) *\|\w+\|(\w+) *\|$", capsys.readouterr().out, flags=re.MULTILINE) == [
        ("10.0", "sealed"),
        ("9.9", "open"),
    ]
    assert main(["submit", "check", str(claimed), *FEW, "--sealed", "9.9"]) == 0
    assert "On the open list of 9.9" in capsys.readouterr().out
    with pytest.raises(ValueError, match=r"not that of the list sealed for 10\.0: its hash differs"):
        seal(SealOptions("11.0", last=tmp_path / "secret", new=tmp_path / "third"))
    lists.write_text(lists.read_text().replace(SECRET, SECRET[::-1]))
    assert main(["submit", "sealed"]) == 1
    assert main(["submit", "check", str(claimed), *FEW, "--sealed", "9.9"]) == 2


def test_a_list_whose_secret_is_lost_is_replaced_and_never_opened(lists: Path, tmp_path: Path) -> None:
    before = published()
    assert seal(SealOptions(before.release, new=tmp_path / "next")) == 0
    assert published().opened == before.opened == ()
    assert published().sha256 != before.sha256
    seal(SealOptions("10.0", last=tmp_path / "next", new=tmp_path / "third"))
    with pytest.raises(ValueError, match=rf"the list of {before.release} is open"):
        seal(SealOptions(before.release, new=tmp_path / "fourth"))


def test_sealed_seeds_are_those_of_their_task_and_more_only_append() -> None:
    one = SealedList("1", bytes(32))
    seeds = one.seeds("a", 200)
    assert len({*seeds, *one.seeds("b", 200), *SealedList("1", b"\1" * 32).seeds("a", 200)}) == 600
    assert seeds[:5].tolist() == one.seeds("a", 5).tolist()
    assert 0 <= seeds.min() <= seeds.max() < 2**61


def test_a_list_is_sealed_for_this_release() -> None:
    assert published().release == agents.__version__
    assert main(["submit", "sealed"]) == 0


@pytest.mark.parametrize("folder", sorted((ROOT / "submissions").glob("*/")), ids=lambda folder: folder.name)
def test_submissions_in_the_repository_score_what_they_claim(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["submit", "check", str(folder), "--against", "random"]) == 0
    assert "episodes of each task" not in capsys.readouterr().out


@pytest.mark.parametrize("env_id", ["MinTorqueMove-v0", "ExcavatorPayload-v0"])
def test_the_last_bit_of_observations_changes_less_than_another_platform_may(env_id: str) -> None:
    agent, generator = load_agent(env_id), np.random.default_rng(1)

    class Rounded:
        def predict(self, observation: Any, **more: Any) -> Any:
            moved = observation * (1.0 + 2.0**-24 * generator.integers(-1, 2, observation.shape))
            return agent.predict(moved.astype(np.float32), **more)

    settings = agent.action_config
    exact, rounded = (
        claim_of(agents.evaluate(each, env_id, range(12), env_config=settings)) for each in (agent, Rounded())
    )
    assert exact.digest != rounded.digest
    assert (exact.success, exact.steps) == (rounded.success, rounded.steps)
    assert rounded.returns == pytest.approx(exact.returns, rel=ROUNDING)
    assert rounded.median == pytest.approx(exact.median, rel=ROUNDING)


@pytest.mark.parametrize("kind", [Card, Claim])
def test_the_page_describes_every_entry_of_a_card(kind: type[Settings]) -> None:
    assert kind.table() in (ROOT / "docs" / "benchmark" / "submit.md").read_text()


def test_the_page_says_the_limits() -> None:
    page = (ROOT / "docs" / "benchmark" / "submit.md").read_text()
    for limit in (
        f"| {MOST_WEIGHT_BYTES >> 20} MiB |",
        f"| {MOST_JSON_BYTES >> 10} KiB, {MOST_LAYERS} hidden layers |",
    ):
        assert limit in page
