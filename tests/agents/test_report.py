"""`planarm report`: files of results in, a page and figures out."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shlex
from html.parser import HTMLParser
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import ROOT
from report_cases import HOSTILE, as_large_as_the_default

from agents.cli import main
from agents.commands.report import ReportOptions, run
from agents.evaluation.statistics import Estimate
from agents.report.bundle import bundled, script
from agents.report.page import report_page
from agents.report.pictures.figures import task_figures, write_figures
from agents.report.pictures.looks import Look, policy_looks
from agents.report.results_file import Results, TaskScores
from agents.report.side_by_side import side_by_side


class Page(HTMLParser):
    """The elements, texts and links of a page, as a browser reads them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.texts: dict[str, list[str]] = {}
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.open.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)


def data_of(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="text/plain" id="data">([^<]*)</script>', page)
    assert found is not None
    data: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(found[1])))
    return data


@pytest.fixture(scope="module")
def page(scored: dict[str, Any]) -> str:
    return report_page([("results", Results.of(scored))])


def test_the_page_holds_every_episode_and_replay(page: str, scored: dict[str, Any]) -> None:
    data = data_of(page)
    assert [task["title"] for task in data["tasks"]] == [result["task"] for result in scored["results"]]
    for task, result in zip(data["tasks"], scored["results"], strict=True):
        assert task["seeds"] == result["policies"][0]["episodes"]["seed"]
        by_name = {policy["policy"]: policy["episodes"] for policy in result["policies"]}
        for policy in task["policies"]:
            assert policy["episodes"]["return"] == pytest.approx(by_name[policy["name"]]["return"], rel=1e-6)
            assert policy["episodes"]["is_success"] == by_name[policy["name"]]["is_success"]
        assert task["replays"]["episodes"] == result["replays"]["episodes"]


def test_names_are_texts_wherever_they_stand(page: str) -> None:
    read = Page(page)
    assert read.tags.count("script") == 2
    assert any(HOSTILE in text for text in read.texts["td"])
    assert any(HOSTILE in value for name, value in read.attributes if name == "data-tip")
    assert HOSTILE not in page
    assert not [name for name, _ in read.attributes if name.startswith("on") or name == "style"]


def test_nothing_in_the_page_leads_elsewhere(page: str) -> None:
    read = Page(page)
    assert not [value for name, value in read.attributes if name in ("src", "srcset", "data", "action")]
    assert all(value.startswith("#") for name, value in read.attributes if name == "href")
    policy = next(value for _, value in read.attributes if value.startswith("default-src"))
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_every_link_to_episodes_names_some(page: str) -> None:
    tasks = data_of(page)["tasks"]
    links = {value for name, value in Page(page).attributes if name == "href" and value.startswith("#/")}
    assert len(links) > 30
    for link in links:
        _, number, policies, key = link.split("/")
        task = tasks[int(number)]
        assert all(int(place) < len(task["policies"]) for place in policies.split("-"))
        assert key in {quantity["key"] for quantity in task["quantities"]}
        assert all(key in policy["episodes"] for policy in task["policies"])


def test_without_script_there_are_charts_and_tables(page: str) -> None:
    read = Page(page)
    assert read.tags.count("svg") == 12
    assert read.tags.count("table") == 8
    assert all(read.tags.count(tag) >= 12 for tag in ("title", "desc"))
    assert "noscript" in read.tags
    assert "nan" not in {value for _, value in read.attributes}


def test_provenance_is_at_the_foot(page: str, scored: dict[str, Any]) -> None:
    facts = " ".join(Page(page).texts["dd"])
    for fact in (f"planarm {scored['versions']['planarm']}", scored["machine"]["system"], "0 to 5"):
        assert fact in facts
    assert "planarm test" in Page(page).texts["code"]


def test_the_same_results_make_the_same_page(page: str, scored: dict[str, Any]) -> None:
    assert report_page([("results", Results.of(scored))]) == page


def test_the_default_benchmark_makes_less_than_five_megabytes(scored: dict[str, Any]) -> None:
    large = Results.of(as_large_as_the_default(scored))
    assert sum(len(task.policies) * len(task.seeds) for task in large.results) > 2900
    assert len(report_page([("results", large)])) < 5_000_000


def test_what_is_never_is_infinite(scored: dict[str, Any]) -> None:
    task = scored["results"][0]
    policy = task["policies"][0]
    count = len(policy["episodes"]["seed"])
    never = {"value": None, "low": None, "high": None}
    column = {**policy["episodes"], "settling_time": [None] * count}
    lost = {**policy, "summary": {**policy["summary"], "settling_time": never}, "episodes": column}
    scores = Results.of({**scored, "results": [{**task, "policies": [lost]}]}).results[0].policies[0]
    assert scores.estimate("settling_time") == Estimate(np.inf, np.inf, np.inf)
    unknown = {**policy, "summary": {**policy["summary"], "settling_time": never}}
    scores = Results.of({**scored, "results": [{**task, "policies": [unknown]}]}).results[0].policies[0]
    estimate = scores.estimate("settling_time")
    assert estimate is not None
    assert np.isnan(estimate.value)


def test_older_files_have_no_replays(scored: dict[str, Any]) -> None:
    new = ("replays", "metrics", "bound_meaning")
    results = [{key: value for key, value in each.items() if key not in new} for each in scored["results"]]
    page = report_page([("old", Results.of({"results": results}))])
    assert [task["replays"] for task in data_of(page)["tasks"]] == [None, None]
    assert "settled (s)" in page
    assert "none recorded" in page


def test_files_stand_side_by_side(scored: dict[str, Any]) -> None:
    first, second = Results.of(scored), Results.of(scored)
    task = side_by_side([("one", first), ("two", second)])[0]
    assert {each.policy for each in task.policies} >= {"apf", "apf (two)", "random (two)"}
    assert len(task.policies) == 6
    assert task.replays is not None
    assert len(task.replays.episodes) == 18
    other = {**scored["results"][0], "env_config": {"payload": 0.2}}
    apart = side_by_side([("one", first), ("two", Results.of({**scored, "results": [other]}))])
    assert [len(each.policies) for each in apart] == [3, 3, 3]
    assert [each.task for each in apart] == ["ConveyorTrack-v0 (one)", "ObstacleDodge-v0", "ConveyorTrack-v0 (two)"]
    published = {**scored["results"][0], "published": {"source": "a paper", "settling_time": 1.0, "note": ""}}
    cited = Results.of({**scored, "results": [published]})
    for files in ([first, cited], [cited, first]):
        assert side_by_side([(str(number), file) for number, file in enumerate(files)])[0].published
    assert data_of(report_page([("one", first), ("two", second)]))["tasks"][0]["policies"][5]["name"]


def test_the_best_known_values_of_several_files_are_the_best_of_them(scored: dict[str, Any]) -> None:
    files = []
    for bound in ([1.0, None, 0.5, None], [0.75, 2.0, 0.625, None]):
        task = {**scored["results"][0], "bound": {"settling_time": bound}}
        files.append((str(bound[0]), Results.of({**scored, "results": [task]})))
    merged = side_by_side(files)[0]
    assert merged.bounds is not None
    assert list(merged.bounds[1].values()) == [0.75, 2.0, 0.5, np.inf]
    for policy in merged.policies:
        settled = policy.evaluation.metrics["settling_time"][:3]
        above = policy.estimate("above_bound")
        assert above is not None
        never = np.isnan(settled).sum() > 1
        assert np.isnan(above.value) if never else above.value == pytest.approx(np.median(settled - [0.75, 2.0, 0.5]))


def test_policies_of_several_files_look_different(scored: dict[str, Any]) -> None:
    task = scored["results"][0]
    names = [f"policy {number}" for number in range(10)]
    many = {**task, "pairs": [], "policies": [{**task["policies"][0], "policy": name} for name in names]}
    files = [(file, Results.of({**scored, "results": [many]})) for file in ("one", "two", "three", "four")]
    tasks = side_by_side(files)
    looks = policy_looks(files, tasks)
    assert [looks[name].color for name in names] == list(range(10))
    assert len(set(looks.values())) == len(looks) == 40
    assert all(looks[f"{name} ({file})"].color == looks[name].color for name in names for file in ("two", "four"))
    data = data_of(report_page(files))["tasks"][0]
    assert len({policy["look"] for policy in data["policies"]}) == 40


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "it is no JSON"),
        (b"\xff\xfe\x00", "it is no JSON"),
        (b"[" * 100_000, "it is no JSON"),
        (b"[]", "it has no results"),
        (b'{"results": 3}', "it has no results"),
        (b'{"results": []}', "results: List should have at least 1 item"),
        (b'{"results": [{"task": "a", "env": "b", "policies": [{"policy": "x"}]}]}', r"summary: Field required"),
        (b'{"results": [7]}', r"results.0"),
        (b'{"results": [1e400]}', "it holds the number 1e400, which is no result"),
        (b'{"results": [NaN]}', "it holds the number NaN"),
        (b'{"results": ["\\ud800"]}', "it is no JSON"),
    ],
)
def test_damaged_files_are_refused_in_a_sentence(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "results.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=complaint):
        run(ReportOptions(results=(path,), out=tmp_path / "report.html"))
    assert not (tmp_path / "report.html").exists()


def test_results_without_their_metric_or_with_other_seeds_are_refused(scored: dict[str, Any], tmp_path: Path) -> None:
    task, path = scored["results"][0], tmp_path / "results.json"
    policy = task["policies"][0]
    without = {name: values for name, values in policy["episodes"].items() if name != "settling_time"}
    cases = [(without, "has no settling_time of its episodes")]
    for name, value, complaint in (
        ("seed", 0.5, "seeds are whole numbers"),
        ("seed", 1e20, "seeds are whole numbers"),
        ("seed", 1, "two have the same seed"),
        ("length", None, "lengths are whole numbers"),
        ("length", 1e20, "lengths are whole numbers"),
        ("is_success", 3, "is_success is true or false"),
    ):
        cases.append(({**policy["episodes"], name: [value, *policy["episodes"][name][1:]]}, complaint))
    for episodes, complaint in cases:
        path.write_text(json.dumps({"results": [{**task, "policies": [{**policy, "episodes": episodes}]}]}))
        with pytest.raises(ValueError, match=complaint):
            Results.read(path)


def test_large_seeds_are_kept(scored: dict[str, Any], tmp_path: Path) -> None:
    task, path = scored["results"][0], tmp_path / "results.json"
    seeds = [2**62 + number for number in range(6)]
    policies = [{**each, "episodes": {**each["episodes"], "seed": seeds}} for each in task["policies"]]
    path.write_text(json.dumps({"results": [{**task, "policies": policies, "replays": None}]}))
    assert Results.read(path).results[0].seeds == seeds


def test_the_numbers_of_the_leaderboard_are_in_the_page(scored: dict[str, Any], page: str) -> None:
    assert "over best known" in Page(page).texts["button"]
    above = [each["summary"]["above_bound"]["value"] for each in scored["results"][0]["policies"]]
    cells = [value for name, value in Page(page).attributes if name == "data-v"]
    assert all(repr(value) in cells for value in above if value is not None)
    task = {**scored["results"][0], "lower_bound": {"settling_time": [1.0, 0.5, 0.625, 0.75]}}
    for bounds, shown in (([1.0, 0.5, 0.625, 0.75], True), ([1.0, None, 0.625, 0.75], False)):
        task["lower_bound"] = {"settling_time": bounds}
        read = Page(report_page([("results", Results.of({"results": [task]}))]))
        assert ("lower bound (first 4)" in read.texts["td"]) is shown
        assert (("data-v", "0.6875") in read.attributes) is shown


def test_columns_of_different_lengths_are_refused(scored: dict[str, Any], tmp_path: Path) -> None:
    task = scored["results"][0]
    policy = task["policies"][0]
    short = {**policy, "episodes": {**policy["episodes"], "return": policy["episodes"]["return"][:-1]}}
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"results": [{**task, "policies": [short]}]}))
    with pytest.raises(ValueError, match="columns of one length"):
        Results.read(path)


def test_the_command_writes_the_page(
    scored: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("results.json").write_text(json.dumps(scored))
    assert main(["report", "results.json"]) == 0
    assert "wrote report.html" in capsys.readouterr().err
    assert data_of(Path("report.html").read_text(encoding="utf-8"))["tasks"]
    assert main(["report", "missing.json"]) == 2
    assert "missing.json: no such file" in capsys.readouterr().err


@pytest.mark.docs
def test_the_page_of_the_docs_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = re.findall(
        r"^planarm (.*)$", (ROOT / "docs" / "benchmark" / "report.md").read_text(), flags=re.MULTILINE
    )
    assert len(commands) == 4
    for command in commands:
        assert main(shlex.split(command)) == 0
    assert "|apf" in capsys.readouterr().out
    assert data_of((tmp_path / "report.html").read_text(encoding="utf-8"))["tasks"][0]["replays"]
    assert data_of((tmp_path / "both.html").read_text(encoding="utf-8"))["tasks"][0]["policies"][2]["name"]
    assert len(list((tmp_path / "figures").iterdir())) == 14


def test_modules_become_one_script() -> None:
    text = script()
    assert not re.search(r"^\s*(?:import|export)\b", text, flags=re.MULTILINE)
    assert 'const { SceneView } = modules["scene.js"];' in text
    made = bundled(
        [("a.js", "export const one = 1;\n"), ("b.js", 'import { one } from "./a.js";\nexport class B {}\n')]
    )
    assert 'const { one } = modules["a.js"];' in made
    assert "return { B };" in made
    with pytest.raises(ValueError, match=r"b.js imports a.js, which is not before it"):
        bundled([("b.js", 'import { one } from "./a.js";\n')])
    with pytest.raises(ValueError, match="another form"):
        bundled([("c.js", "export default 3;\n")])


def test_figures_are_the_same_again_with_their_fonts(scored: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    files = [("results", Results.of({**scored, "results": scored["results"][:1]}))]
    contents = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        assert write_figures(files, folder) == 14
        contents.append({path.name: path.read_bytes() for path in sorted(folder.iterdir())})
    assert contents[0] == contents[1]
    assert set(contents[0]) >= {"leaderboard.svg", "ConveyorTrack-v0_profile.pdf", "ConveyorTrack-v0_settling_time.svg"}
    assert all(b"/FontFile2" in content for name, content in contents[0].items() if name.endswith(".pdf"))
    assert all(b"<text" not in content for name, content in contents[0].items() if name.endswith(".svg"))


def test_labels_of_the_cost_chart_are_apart(scored: dict[str, Any]) -> None:
    pytest.importorskip("matplotlib")
    task = json.loads(json.dumps(scored["results"][0]))
    apf = next(each for each in task["policies"] if each["policy"] == "apf")
    task["policies"] = [{**apf, "policy": name} for name in ("apf", "another", "the third")]
    charts = dict(
        task_figures(TaskScores.model_validate(task), dict.fromkeys(("apf", "another", "the third"), Look(0)))
    )
    labels = charts["cost"].axes[0].texts
    assert [text.get_text() for text in labels] == ["best known (first 4)", "apf", "another", "the third"]
    boxes = [text.get_window_extent() for text in labels]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


@pytest.mark.usefixtures("without_matplotlib")
def test_figures_without_matplotlib_say_what_to_install(scored: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match=r"planarm\[viz\]"):
        write_figures([("results", Results.of(scored))], tmp_path)
