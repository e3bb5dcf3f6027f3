"""The report in a real browser: from a number to its episodes, and from a seed to its replay."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from report_cases import HOSTILE

from agents.report.page import write_report
from agents.report.results_file import Results
from agents.report.side_by_side import side_by_side

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def file(scored: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report([("results", Results.of(scored))], path)
    return path


def opened(browser: Any, file: Path, **options: Any) -> Iterator[Any]:
    """The page; it must not complain, nor ask for anything but itself."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
    page, complaints = context.new_page(), []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: complaints.append(request.url) if request.url != file.as_uri() else None)
    page.goto(file.as_uri())
    page.wait_for_selector("html.ready")
    yield page
    context.close()
    assert [each for each in complaints if not each.startswith("blob:")] == []


@pytest.fixture
def page(browser: Any, file: Path) -> Iterator[Any]:
    yield from opened(browser, file)


@pytest.fixture(params=["light", "dark"])
def phone(browser: Any, file: Path, request: pytest.FixtureRequest) -> Iterator[Any]:
    yield from opened(browser, file, viewport={"width": 390, "height": 800}, color_scheme=request.param)


def picture(page: Any) -> str:
    shown: str = page.evaluate("document.querySelector('canvas').toDataURL()")
    return shown


def column(table: Any, place: int) -> list[str]:
    cells: list[str] = table.locator(f"tbody tr td:nth-child({place})").all_text_contents()
    return cells


def test_a_click_on_a_head_sorts(page: Any) -> None:
    table = page.locator("#task-0 table").first
    before = column(table, 2)
    head = table.locator("th:nth-child(2) button")
    head.click()
    ascending = [text.split()[0] for text in column(table, 2)[:3]]
    assert ascending == sorted(ascending, key=float)
    head.click()
    assert [text.split()[0] for text in column(table, 2)[:3]] == ascending[::-1]
    assert sorted(column(table, 2)) == sorted(before)
    table.locator("th:nth-child(1) button").click()
    assert column(table, 1)[-1] == "random"


def test_a_number_opens_its_episodes_worst_first(page: Any, scored: dict[str, Any]) -> None:
    page.locator("#task-0 table tbody tr", has_text="apf").first.locator("td:nth-child(3) a").click()
    page.wait_for_selector("dialog[open]")
    assert page.locator("#episodes-title").text_content() == "ConveyorTrack-v0: settled (s) of apf"
    episodes = next(each for each in scored["results"][0]["policies"] if each["policy"] == "apf")["episodes"]
    worst = sorted(range(6), key=lambda place: -episodes["settling_time"][place])
    seeds = [int(text.split()[0]) for text in column(page.locator("dialog table"), 1)]
    settled = [float(text) for text in column(page.locator("dialog table"), 2)]
    assert settled == pytest.approx([episodes["settling_time"][place] for place in worst], abs=1e-3)
    assert seeds[0] == episodes["seed"][worst[0]]
    assert any(text.endswith("▶") for text in column(page.locator("dialog table"), 1))
    worst_recorded = next(seed for seed in seeds if seed in scored["results"][0]["replays"]["seeds"])
    assert page.locator(".replay h3").text_content() == f"Seed {worst_recorded}"
    assert page.locator("canvas").is_visible()
    page.keyboard.press("Escape")
    page.wait_for_selector("dialog:not([open])", state="attached")
    assert "#" not in page.url


def test_a_difference_of_successes_is_one_zero_or_minus_one(page: Any) -> None:
    names = page.locator("#task-0 table").first.locator("tbody td.name").all_text_contents()
    first, second = names.index("apf"), names.index("random")
    for pair, expected in (((first, second), "+1"), ((second, first), "\u22121")):
        page.goto(f"{page.url.partition('#')[0]}#/0/{pair[0]}-{pair[1]}/is_success")
        page.locator("#episodes-title", has_text=f"of {names[pair[0]]}").wait_for()
        table = page.locator("dialog table")
        both = [[text.split()[0] == "yes" for text in column(table, place)] for place in (3, 4)]
        wanted = ["0" if one == other else expected for one, other in zip(*both, strict=True)]
        assert column(table, 2) == wanted
        assert expected in wanted


def test_a_damaged_address_opens_nothing(page: Any) -> None:
    page.goto(f"{page.url}#/0/0/%E0%A4%A")
    page.wait_for_timeout(100)
    assert not page.locator("dialog[open]").count()
    page.goto(f"{page.url.partition('#')[0]}#/0/0/return")
    page.wait_for_selector("dialog[open]")


def test_a_point_of_a_chart_opens_its_episodes_by_keyboard(page: Any) -> None:
    mark = page.locator("#task-1 svg a.mark").first
    mark.focus()
    assert page.locator("#tip").is_visible()
    assert "success (%)" in (page.locator("#tip").text_content() or "")
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog[open]")
    assert "ObstacleDodge-v0: success (%)" in (page.locator("#episodes-title").text_content() or "")


def test_a_seed_replays(page: Any, scored: dict[str, Any]) -> None:
    seed = scored["results"][0]["replays"]["seeds"][0]
    page.goto(f"{page.url}#/0/0/settling_time/{seed}")
    page.wait_for_selector("dialog[open] canvas")
    first = picture(page)
    page.locator("select").select_option("2")
    page.locator("button.play").click()
    deadline = monotonic() + 20.0
    while float(page.locator("input[type=range]").input_value()) < 0.3:
        assert monotonic() < deadline
    moving = picture(page)
    page.locator("button.play").click()
    assert moving != first
    time = float(page.locator("input[type=range]").input_value())
    page.wait_for_timeout(150)
    assert float(page.locator("input[type=range]").input_value()) == time  # paused
    page.locator("input[type=range]").fill("0")
    assert picture(page) == first
    page.locator("input[type=range]").fill("1")
    assert "1.00 / 3.00 s" in (page.locator("output").text_content() or "")
    cursor = page.locator(".traces .cursor").first
    before = cursor.get_attribute("x1")
    box = page.locator(".traces svg").first.bounding_box()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    assert cursor.get_attribute("x1") != before


def test_every_policy_of_a_seed_is_a_ghost_that_can_be_hidden_or_highlighted(page: Any) -> None:
    page.goto(f"{page.url}#/0/0/settling_time/0")
    page.wait_for_selector("dialog[open] canvas")
    page.locator("input[type=range]").fill("1")
    names = page.locator(".runs button b").all_text_contents()
    assert sorted(names) == sorted(["apf", HOSTILE, "random"])
    pressed = page.locator(".runs button[aria-pressed=true] b").text_content()
    everything = picture(page)
    page.locator(".runs li", has_not=page.locator("[aria-pressed=true]")).first.locator("input").uncheck()
    assert picture(page) != everything
    page.locator(".runs button[aria-pressed=false]").first.click()
    assert page.locator(".runs button[aria-pressed=true] b").text_content() != pressed
    assert page.locator(".traces figure").count() == 2


def test_an_episode_that_was_not_recorded_says_how_to_see_it(page: Any, scored: dict[str, Any]) -> None:
    recorded = scored["results"][0]["replays"]["seeds"]
    seed = next(seed for seed in range(6) if seed not in recorded)
    page.goto(f"{page.url}#/0/0/settling_time/{seed}")
    command = page.locator("dialog pre").text_content() or ""
    assert command.startswith("planarm rollout ConveyorTrack-v0 --policy ")
    assert f"--seed {seed} --settings payload=0.1 --render" in command
    (task,) = side_by_side([("results", Results.of({**scored, "results": scored["results"][:1]}))])
    nameless = [each.source for each in task.policies].index("")
    page.goto(f"{page.url.partition('#')[0]}#/0/{nameless}/settling_time/{seed}")
    page.get_by_text("Its policy had no name that a command finds.").wait_for()
    assert page.locator("dialog pre").count() == 0
    page.goto(page.url.partition("#")[0] + "#/9/0/nothing")
    page.wait_for_selector("dialog:not([open])", state="attached")


def test_a_damaged_replay_is_said_to_be_damaged(browser: Any, scored: dict[str, Any], tmp_path: Path) -> None:
    damaged = json.loads(json.dumps({**scored, "results": scored["results"][:1]}))
    seed = damaged["results"][0]["replays"]["seeds"][0]
    for number, replay in enumerate(damaged["results"][0]["replays"]["episodes"]):
        bad = [{"numbers": {"time": "1 2"}}, {"fixed": {"__proto__.x": 1}}, {"fixed": {}, "numbers": {}}]
        replay.update(bad[number % 3])
    path = tmp_path / "report.html"
    write_report([("results", Results.of(damaged))], path)
    for page in opened(browser, path):
        page.goto(f"{page.url}#/0/0/settling_time/{seed}")
        page.wait_for_selector("dialog[open]")
        assert "cannot be read" in (page.locator(".replay").text_content() or "")


def test_tables_are_saved_as_csv_and_latex(page: Any, scored: dict[str, Any], tmp_path: Path) -> None:
    texts = {}
    for kind in ("csv", "tex"):
        with page.expect_download() as waiting:
            page.locator(f"#task-0 .exports [data-export={kind}]").first.click()
        assert waiting.value.suggested_filename == f"ConveyorTrack-v0_scores.{kind}"
        waiting.value.save_as(tmp_path / kind)
        texts[kind] = (tmp_path / kind).read_text(encoding="utf-8")
    rows = list(csv.DictReader(texts["csv"].splitlines()))
    assert [row["policy"] for row in rows][-1] == "best known (first 4)"
    assert HOSTILE in [row["policy"] for row in rows]
    apf = next(row for row in rows if row["policy"] == "apf")
    summary = next(each for each in scored["results"][0]["policies"] if each["policy"] == "apf")["summary"]
    assert float(apf["return"]) == summary["return"]["value"]
    assert float(apf["return low"]) == summary["return"]["low"]
    lines = texts["tex"].splitlines()
    assert lines[0].startswith(r"\begin{tabular}{l")
    assert r"mk[/b]\$x\_1\&" in texts["tex"]
    assert all(line.endswith(r"\\") for line in lines[2:-2] if "&" in line)


def test_hostile_names_are_only_shown(page: Any) -> None:
    assert page.title().startswith("planarm: ConveyorTrack-v0")
    assert page.evaluate("document.scripts.length") == 2
    page.goto(f"{page.url}#/0/0-1/return")
    page.wait_for_selector("dialog[open]")
    assert HOSTILE in (page.locator("#episodes-title").text_content() or "")
    assert page.evaluate("document.querySelectorAll('script').length") == 2


def test_it_fits_a_phone(phone: Any) -> None:
    assert phone.evaluate("document.documentElement.scrollWidth") == 390
    phone.goto(f"{phone.url}#/1/0/time_to_goal/0")
    phone.wait_for_selector("dialog[open] canvas")
    assert phone.evaluate("document.querySelector('dialog').scrollWidth") <= 390
    box = phone.locator("canvas").bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] < 800
    assert box["width"] > 300
    assert phone.locator(".status").bounding_box()["y"] >= box["y"] + box["height"]


def test_without_javascript_charts_and_tables_are_there(browser: Any, file: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(file.as_uri())
    assert page.locator("noscript p, p:has-text('JavaScript is off')").first.is_visible()
    assert page.locator("svg").first.is_visible()
    assert "apf" in json.dumps(page.locator("table").first.all_text_contents())
    context.close()


def test_text_is_readable_on_light_and_on_dark_ground(browser: Any, file: Path) -> None:
    measure = """() => {
      const parse = (color) => color.match(/[\\d.]+/g).map(Number);
      const light = (color) => parse(color).slice(0, 3).map((each) => each / 255)
        .map((each) => (each <= 0.04045 ? each / 12.92 : ((each + 0.055) / 1.055) ** 2.4))
        .reduce((sum, each, i) => sum + each * [0.2126, 0.7152, 0.0722][i], 0);
      const ground = (element) => {
        for (; element; element = element.parentElement) {
          const color = getComputedStyle(element).backgroundColor;
          if (parse(color)[3] !== 0) return color;
        }
        return "rgb(255, 255, 255)";
      };
      let worst = [99, ""];
      for (const each of document.querySelectorAll("p, td, th button, a:not(svg a), dt, dd, summary, svg text")) {
        const style = getComputedStyle(each);
        const [one, other] = [light(each.matches("svg *") ? style.fill : style.color), light(ground(each))].sort();
        const contrast = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
        if (contrast < worst[0]) worst = [contrast, each.outerHTML];
      }
      return worst;
    }"""
    for scheme in ("light", "dark"):
        context = browser.new_context(color_scheme=scheme)
        page = context.new_page()
        page.goto(file.as_uri())
        contrast, element = page.evaluate(measure)
        assert contrast >= 4.5, element
        context.close()
