"""Whatever is typed, a command answers with an exit code and one message, never with a traceback."""

from __future__ import annotations

import shlex
import string
import warnings
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agents.cli import COMMANDS, _parse, main
from tools.kill_training import COMMANDS as INTERRUPTED_COMMANDS

ENV = "ConveyorTrack-v0"
ONE = f"evaluate follower --env {ENV} --episodes 1"
PLAN = "plan --arm SCARA_50CM --start 0.2 1.5"


def answer(arguments: list[str]) -> tuple[int, str]:
    """Exit code of a command line, and what it prints to stderr."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as printed:
        try:
            code = main(arguments)
        except SystemExit as end:  # of the parser
            code = int(str(end.code))
    return code, printed.getvalue()


REFUSED = [
    (f"evaluate dpct --env {ENV} --episodes 0", "episodes = 0"),
    (f"evaluate dpct --env {ENV} --episodes -1", "episodes = -1"),
    (f"evaluate dpct --env {ENV} --episodes 99999999999", "episodes = 99999999999"),
    (f"{ONE} --num-envs 0", "num_envs = 0"),
    (f"{ONE} --seed 99999999999999999999999", "seed = 99999999999999999999999"),
    (f"{ONE} --seed -1", "seed = -1"),
    (f"{ONE} --settings id=x", 'setting "id"'),
    (f"{ONE} --settings num_envs=10", 'setting "num_envs"'),
    (f"{ONE} --settings belt_speed=0.5", "--options belt_speed=0.5"),
    (f"{ONE} --options payload=0.5", "--settings payload=0.5"),
    (f"{ONE} --options belt_sped=0.5", 'did you mean "belt_speed"'),
    (f"{ONE} --settings payload=[1,2", "no YAML"),
    (f"{ONE} --settings payload=!!python/name:os.system", "no YAML"),
    (f"{ONE} --settings horizon=1e300", "less than or equal to 60"),
    (f"{ONE} --settings physics_step=1e-300", "choose a physics_step"),
    (f"{ONE} --settings arm=NOARM", 'unknown arm (a file\'s name ends in .yaml or .json) "NOARM" (known:'),
    (f"{ONE} --options belt_speed=0.2 belt_speed=0.3", 'the name "belt_speed" is given 2 times'),
    (f"{ONE} --settings payload=0.2 payload=0.3", 'the name "payload" is given 2 times'),
    (f"{ONE} --json .", "it is a folder"),
    (f"{ONE} --json {'long' * 80}", "File name too long"),
    (f"{ONE} --against follower", '"follower" is given 2 times'),
    (f"evaluate '' --env {ENV}", "name is empty"),
    ("evaluate follower --env :", "no module:name"),
    (f"evaluate model.zip --env {ENV}", "no file model.zip"),
    ("evaluate runs/mine", "no folder runs/mine"),
    ("evaluate 'mk[/b]run'", "no folder mk[/b]run"),
    ("evaluate .", "has no best.safetensors"),
    ("benchmark --tasks", "tasks"),
    ("benchmark --tasks X", 'unknown task "X"'),
    (f"benchmark --tasks {ENV} {ENV}", "is given 2 times"),
    ("benchmark --policies", "policies"),
    ("benchmark --policies dpct dpct", "is given 2 times"),
    ("benchmark --config nope.yaml", "no such file"),
    ("warmup X", 'unknown task "X"'),
    (f"rollout {ENV} --seed 99999999999999999999", "seed 99999999999999999999"),
    (f"rollout {ENV} --policy model.zip", "no file model.zip"),
    (f"rollout {ENV} --render --record x.gif", "--render shows and --record writes"),
    (f"rollout {ENV} --fps 5", "give --record too"),
    (f"rollout {ENV} --record x.avi", "(known: .gif, .mp4, .png)"),
    (f"rollout {ENV} --control-mode torque --settings control_mode=jerk", "give one of them"),
    (f"rollout {ENV} --scenario paper --options scenario=random", "give one of them"),
    ("rollout 'mk[/b]run'", 'unknown environment "mk[/b]run"'),
    (f"paths {ENV} --policies", "0 policies"),
    (f"paths {ENV} --policies dpct dpct", "is given 2 times"),
    (f"paths {ENV} --policies model.zip", "no file model.zip"),
    (f"paths {ENV} --dpi 99", "give --plot too"),
    (f"paths {ENV} --plot x.gif", "(known: .pdf, .png, .svg)"),
    (f"paths {ENV} --settings belt_speed=1", "--options belt_speed=1"),
    ("plan", "no arm"),
    ("plan --list --arm SCARA_1M", "leave the other options out"),
    (f"{PLAN}", "give either --to"),
    (f"{PLAN} --to 0.4 0.4 --to-joints 1 1", "give either --to"),
    (f"{PLAN} --to-joints 1 1 --moving 1 0", "--moving and --to-joints contradict"),
    (f"{PLAN} --to-joints 1 1 --orientation 1", "--orientation and --to-joints contradict"),
    (f"{PLAN} --to nan 0", "finite"),
    (f"{PLAN} --to 0.4 0.4 --horizon nan", "horizon nan s"),
    (f"{PLAN} --to 0.4 0.4 --planner 'x[/b]'", 'unknown planner "x[/b]"'),
    (f"{PLAN} --to 0.4 0.4 --options problem=1", "problem is no option"),
    (f"{PLAN} --to 0.4 0.4 --options variant=via", "--variant"),
    (f"{PLAN} --to 0.4 0.4 --csv same --save same", "both write to same"),
    ("list nope", 'unknown environment "nope"'),
    ("curves", "no runs"),
    ("curves 'mk[/b]run'", "mk[/b]run is no folder"),
    ("train", "name a configuration"),
    ("train ppo/ConveyorTrack-v0 hidden=[-3]", "hidden.0 = -3"),
    ("train ppo/ConveyorTrack-v0 fine.part_error=[]", "fine.part_error = []"),
    ("train ppo/ConveyorTrack-v0 optimizer=sgd", "optimizer = 'sgd'"),
    ("train nope", 'unknown configuration (a file\'s name ends in .yaml) "nope"'),
    ("paper-dpct --plot x.gif", "(known: .pdf, .png, .svg)"),
    ("paper-lagrange --dpi 9999 --plot x.png", "dpi 9999"),
    ("paper-excavator --rate 1e-9", "rate 1e-09 samples/s must be from 10"),
    ("paper-excavator --payloads nan", "payload nan %"),
    ("paper-apf --dpi 99", "give --plot too"),
    ("play Nope-v0 --no-browser", 'unknown environment "Nope-v0"'),
    ("play --policies nobody --no-browser", '"nobody"'),
    ("play --seed -1 --no-browser", "seed"),
    ("play --port 99999 --no-browser", "port 99999 cannot be used"),
    ("report", "results"),
    ("report missing.json", "cannot read missing.json: no such file"),
    ("report .", "cannot read .: it is no file"),
    ("report 'mk[/b]run.json'", "mk[/b]run.json"),
    ("dataset Nope-v0 --out mine", 'unknown environment "Nope-v0"'),
    ("sweep nope.yaml", "cannot read nope.yaml"),
    ("sweep ppo/ConveyorTrack-v0 --over nonsense", '--over "nonsense" is no key=values'),
    ("submit check", "no submission"),
    ("submit check 'mk[/b]mine'", "no folder mk[/b]mine"),
    ("submit check . --episodes 0", "episodes 0 must be at least 1"),
    ("submit check . --sealed none.secret", "cannot read none.secret"),
    ("submit claim nope", "no folder nope"),
    (f"submit export dpct mine --env {ENV}", "dpct is code"),
    ("submit export agent mine --env Nope-v0", "unknown environment"),
    (f"submit export agent mine --env {ENV} --settings control_mode=jerk", "leave --settings out"),
]


@pytest.mark.parametrize(("line", "complaint"), REFUSED, ids=[line for line, _ in REFUSED])
def test_what_cannot_be_done_is_refused_in_one_line(
    line: str, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, printed = answer(shlex.split(line))
    assert code == (1 if line.startswith("curves '") else 2)  # 1: there is nothing to show
    printed = printed.removeprefix("compiling, once; later runs load it\n")  # where an agent is read first
    assert printed.startswith(f"planarm {line.split()[0]}: ")
    assert printed.count("\n") == 1
    assert complaint in printed
    assert not list(tmp_path.iterdir())


def test_every_command_is_tried() -> None:
    assert {line.split()[0] for line, _ in REFUSED} == set(COMMANDS)


@pytest.mark.parametrize("line", INTERRUPTED_COMMANDS)
def test_the_campaign_interrupts_commands_that_there_are(line: str) -> None:
    given = shlex.split(line.format(folder="folder"))
    assert type(_parse(given, given[0])).__name__ == COMMANDS[given[0]].options  # it would exit for another line


VALUES = st.one_of(
    st.sampled_from(
        ["", "0", "-1", "nan", "inf", "1e9", "9" * 30, "[/b]", "a=b", "=", "x.zip", ".", "/dev/null/x", "\0"]
    ),
    st.text(alphabet=string.printable, max_size=12),
)
QUICK = {
    "evaluate": [ONE.split()[1:], ["seed", "num-envs", "against", "settings", "options", "json", "env"]],
    "rollout": [[ENV], ["policy", "seed", "scenario", "options", "settings", "control-mode", "record", "fps", "width"]],
    "paths": [[ENV, "--policies", "follower"], ["policies", "seed", "scenario", "options", "settings", "plot", "dpi"]],
    "plan": [
        [*PLAN.split()[1:], "--to", "0.4", "0.4", "--planner", "dpct"],
        ["arm", "start", "to", "orientation", "moving", "obstacle", "variant", "options", "planner", "csv", "plot"],
    ],
    "list": [[], ["json"]],
    "curves": [["runs/none"], ["by", "metrics", "against", "plot", "dpi"]],
    "train": [["ppo/ConveyorTrack-v0", "algorithm=none"], ["seed", "total-steps", "out", "resume"]],
}
"""Command lines that take a moment, and options of theirs, to give them any values."""


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    command = draw(st.sampled_from(sorted(QUICK)))
    given, names = QUICK[command]
    line = [command, *given]
    for name in draw(st.lists(st.sampled_from(names), min_size=1, max_size=2, unique=True)):
        line += [f"--{name}", *draw(st.lists(VALUES, max_size=2))]
    return line


@given(line=command_lines())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_values_give_an_exit_code_and_no_traceback(
    line: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        code, printed = answer(line)
    assert code in (0, 1, 2)
    assert "Traceback" not in printed
    if code:
        assert printed.strip()
