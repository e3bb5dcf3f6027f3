"""`planarm play` in a real browser: what a visitor sees and does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

pytestmark = pytest.mark.browser


@contextmanager
def playing(*arguments: str, **environment: str) -> Iterator[tuple[str, int]]:
    """A server: its address and process. Ctrl-C must end it without a word."""
    command = [sys.executable, "-m", "agents.cli", "play", "--no-browser", *arguments]
    environ = {**os.environ, **environment}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environ) as server:
        assert server.stdout is not None
        line = server.stdout.readline()
        assert line.startswith("playing at http://127.0.0.1:")
        yield line.split()[2], server.pid
        server.send_signal(signal.SIGINT)
        out, errors = server.communicate(timeout=10)
        assert (server.returncode, out) == (130, "")
        assert all(line.startswith("compiling, once") for line in errors.splitlines()), errors


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with playing("--policies", "dpct", "lagrange") as (address, _):
        yield address


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    yield from opened(browser, address)


def opened(browser: Any, address: str, **options: Any) -> Iterator[Any]:
    """A page that has drawn its first frame; it must not complain, nor ask for anything elsewhere."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, bypass_csp=True, **options)
    page, complaints = context.new_page(), []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: complaints.append(request.url) if not local(request.url, address) else None)
    page.goto(address)
    wait_for(page, "document.getElementById('clock').textContent.startsWith('0.')")
    yield page
    context.close()
    assert complaints == []


def wait_for(page: Any, condition: str, seconds: float = 20.0) -> None:
    """Wait until an expression of the page is true; time in which the page says that it compiles does not count."""
    found = page.evaluate(
        f"""limits => new Promise(done => {{
          let [quiet, all] = limits, last = performance.now();
          const look = () => {{
            if ({condition}) return done(true);
            const now = performance.now();
            all -= now - last;
            if (document.getElementById("wait").textContent === "") quiet -= now - last;
            last = now;
            if (Math.min(quiet, all) < 0) done(false); else setTimeout(look, 20);
          }};
          look();
        }})""",
        [1000.0 * seconds, 300_000.0],
    )
    assert found, f"{condition}; the page waits: {page.text_content('#wait')!r}"


def local(url: str, address: str) -> bool:
    return url.startswith((address, "data:"))


def colors(page: Any, canvas: int = 0) -> dict[str, int]:
    """How many pixels of a canvas have each colour."""
    counted: dict[str, int] = page.evaluate(
        """index => {
          const canvas = document.querySelectorAll("canvas")[index];
          const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          const counts = {};
          for (let i = 0; i < data.length; i += 4) {
            const key = [data[i], data[i + 1], data[i + 2]].join();
            counts[key] = (counts[key] || 0) + 1;
          }
          return counts;
        }""",
        canvas,
    )
    return counted


def drag(page: Any, point: tuple[float, float], to: tuple[float, float]) -> None:
    """Drag from one place of the first canvas to another, as shares of its width and height."""
    box = page.locator("canvas").first.bounding_box()
    page.mouse.move(box["x"] + point[0] * box["width"], box["y"] + point[1] * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + to[0] * box["width"], box["y"] + to[1] * box["height"], steps=5)
    page.mouse.up()


def test_arm_part_belt_and_gauges_are_drawn(page: Any) -> None:
    found = colors(page)
    assert min(found["47,102,153"], found["55,126,184"]) > 300  # both links, in the colour of the first policy
    assert found["235,87,87"] > 5  # the hand
    assert found["86,96,112"] > 3000  # the belt
    assert found["240,160,60"] + found.get("46,168,124", 0) > 50  # the part, waiting or settled
    assert page.locator("canvas").count() == 2
    assert page.locator(".gauges").first.locator(".bar").count() == 5  # two torques; velocity, acceleration, jerk
    assert page.locator(".view h2").all_text_contents()[0].startswith("dpct")


def test_verdicts_stand_beside_the_bound_and_the_next_seed_follows(page: Any) -> None:
    wait_for(page, "document.querySelector('.verdict').textContent.includes('best known')")
    assert "settled at 1.72 s (best known 1.70 s)" in page.locator(".verdict").first.text_content()
    wait_for(page, "document.getElementById('seed').value === '1'")


def test_a_goal_that_is_dragged_is_reached(page: Any) -> None:
    page.select_option("#task", "MinTorqueMove-v0")
    wait_for(page, "document.querySelectorAll('.gauges')[0].textContent.includes('torque 3')")
    page.uncheck("#auto")
    wait_for(page, "document.querySelector('.verdict').textContent !== ''")
    target = page.evaluate(TARGET)
    drag(page, tuple(target), (0.5, 0.3))
    wait_for(page, "document.querySelector('.verdict').textContent === ''")
    wait_for(page, "document.querySelector('.verdict').textContent.includes('torque')")
    x, y = page.evaluate(TARGET)
    assert abs(x - 0.5) < 0.02
    assert abs(y - 0.3) < 0.02


TARGET = """() => {
  const canvas = document.querySelector("canvas");
  const {data, width, height} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let [x, y, n] = [0, 0, 0];
  for (let i = 0; i < data.length; i += 4)
    if (data[i] === 46 && data[i + 1] === 168 && data[i + 2] === 124) {
      x += (i / 4) % width; y += Math.floor(i / 4 / width); n += 1;
    }
  return [x / n / width, y / n / height];
}"""
"""The middle of the cross-hair on the first canvas, as shares of its width and height."""


def test_policies_switch_and_overlay(page: Any) -> None:
    page.get_by_role("button", name="apf", exact=True).click()
    wait_for(page, "document.querySelectorAll('canvas').length === 3")
    page.keyboard.press("g")
    wait_for(page, "document.querySelectorAll('canvas').length === 1")
    wait_for(page, "document.querySelector('.view h2').textContent.includes('dpct')")
    names = page.locator(".view h2 button")
    assert names.all_text_contents() == ["dpct", "lagrange", "apf"]
    assert names.nth(0).get_attribute("aria-pressed") == "true"
    names.nth(1).focus()
    page.keyboard.press("Enter")
    wait_for(page, "document.querySelectorAll('.view h2 button')[1].getAttribute('aria-pressed') === 'true'")
    assert page.locator(".view h2 [aria-pressed=true]").all_text_contents() == ["lagrange"]
    page.keyboard.press("g")
    page.get_by_role("button", name="dpct", exact=True).click()
    wait_for(page, "document.querySelectorAll('canvas').length === 2")


def test_choices_before_the_answer_add_up(page: Any) -> None:
    pressed = "[...document.querySelectorAll('#policies [aria-pressed=true]')].map(each => each.textContent).join()"
    before = page.evaluate(pressed)
    page.evaluate(
        """() => {
          const buttons = [...document.querySelectorAll("#policies button")];
          for (const name of ["follower", "random"]) buttons.find(each => each.textContent === name).click();
        }"""
    )
    wait_for(page, f"{pressed}.includes('random')")
    assert {*page.evaluate(pressed).split(",")} == {*[*before.split(","), "follower", "random"][-3:]}


def test_keys_stop_and_step(page: Any) -> None:
    page.keyboard.press("Space")
    wait_for(page, "document.getElementById('run').textContent === 'Run'")
    page.wait_for_timeout(200)
    before = page.text_content("#clock")
    page.keyboard.press(".")
    page.wait_for_function("text => document.getElementById('clock').textContent !== text", arg=before)
    assert float(page.text_content("#clock").split()[0]) == pytest.approx(float(before.split()[0]) + 0.02)


def test_keys_work_after_a_slider_and_a_checkbox_have_been_used(page: Any) -> None:
    page.uncheck("#auto")
    page.keyboard.press("Space")
    assert page.is_checked("#auto")
    page.keyboard.press("n")
    wait_for(page, "document.getElementById('seed').value === '1'")
    page.focus("#speed")
    page.keyboard.press("ArrowRight")
    assert (page.text_content("#speed_shown") or "").startswith("1.19")
    page.keyboard.press("Space")
    wait_for(page, "document.getElementById('run').textContent === 'Run'")
    page.focus("#seed")
    page.keyboard.press("g")
    assert page.get_attribute("#ghosts", "aria-pressed") == "false"


def test_a_refused_arm_is_not_shown_as_chosen(page: Any) -> None:
    page.get_by_role("button", name="agent", exact=True).click()
    wait_for(page, "document.querySelectorAll('canvas').length === 3")
    page.select_option("#arm", "PLANAR_3R")
    wait_for(page, "document.getElementById('note').textContent !== ''")
    assert page.input_value("#arm") == ""


def test_space_presses_the_button_in_focus_and_policies_keep_it(page: Any) -> None:
    page.uncheck("#auto")
    page.focus("#next")
    page.keyboard.press("Space")
    wait_for(page, "document.getElementById('seed').value === '1'")
    assert page.text_content("#run") == "Pause"
    page.get_by_role("button", name="apf", exact=True).focus()
    page.keyboard.press("Enter")
    wait_for(page, "document.querySelectorAll('canvas').length === 3")
    assert page.evaluate("document.activeElement.textContent") == "apf"


def test_the_clock_is_of_the_last_policy_and_a_failure_is_not_compared(browser: Any) -> None:
    with playing("ObstacleDodge-v0", "--policies", "follower", "apf", "--seed", "1") as (address, _):
        for page in opened(browser, address):
            page.uncheck("#auto")
            wait_for(page, "document.querySelectorAll('.verdict')[1].textContent.includes('best known')")
            assert (page.text_content("#clock") or "").startswith("2.74 /")
            assert page.locator(".verdict").first.text_content() == "collided at 0.60 s"


def test_two_pages_do_not_disturb_each_other(page: Any, browser: Any, address: str) -> None:
    page.keyboard.press("Space")
    for other in opened(browser, address):
        other.select_option("#task", "ObstacleDodge-v0")
        wait_for(other, "document.querySelectorAll('#sliders input').length === 2")
        wait_for(other, "parseFloat(document.getElementById('clock').textContent) > 0.3")
    assert page.input_value("#task") == "ConveyorTrack-v0"
    assert page.text_content("#run") == "Run"


def test_a_telephone_shows_everything(browser: Any, address: str) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 800}, color_scheme="dark", bypass_csp=True)
    page = context.new_page()
    page.goto(address)
    wait_for(page, "document.getElementById('clock').textContent !== ''")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert colors(page)["58,68,85"] > 500  # the belt's dark colour
    context.close()


def test_other_sites_may_not_connect(browser: Any, address: str) -> None:
    page = browser.new_page()
    page.goto("about:blank")
    closed = page.evaluate(
        "address => new Promise(done => { const s = new WebSocket(address); s.onclose = e => done(e.code); })",
        address.replace("http", "ws") + "play",
    )
    assert closed in (1006, 1008)
    page.close()


def test_a_page_says_that_it_waits_for_the_compiler(browser: Any, tmp_path: Path) -> None:
    with playing("MinTorqueMove-v0", "--policies", "follower", NUMBA_CACHE_DIR=str(tmp_path)) as (address, _):
        page = browser.new_page(bypass_csp=True)
        page.goto(address)
        page.wait_for_function("document.getElementById('wait').textContent.startsWith('Compiling, once: ')")
        page.wait_for_function("document.querySelectorAll('canvas').length === 1", timeout=120_000)
        page.wait_for_function("document.getElementById('wait').textContent === ''")
        page.close()


def test_a_new_task_begins_with_the_expert_made_for_it_until_policies_are_chosen(browser: Any) -> None:
    with playing() as (address, _):
        for page in opened(browser, address):
            for env, policy in (("MinTorqueMove-v0", "lagrange"), ("ConveyorTrack-v0", "dpct")):
                page.select_option("#task", env)
                wait_for(page, f"document.querySelector('.view h2').textContent.startsWith('{policy}')")
            page.get_by_role("button", name="follower", exact=True).click()
            wait_for(page, "document.querySelectorAll('canvas').length === 2")
            page.select_option("#task", "MinTorqueMove-v0")
            wait_for(page, "document.querySelectorAll('.gauges')[0].textContent.includes('torque 3')")
            assert page.locator("#policies [aria-pressed=true]").all_text_contents() == ["dpct", "follower"]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in /proc")
def test_nothing_is_left_of_a_page_that_is_closed(browser: Any) -> None:
    with playing("MinTorqueMove-v0", "--policies", "follower") as (address, process):

        def threads() -> int:
            return len(list(Path(f"/proc/{process}/task").iterdir()))

        def visit() -> int:
            """Threads after a page was open."""
            for page in opened(browser, address):
                wait_for(page, "document.querySelector('.verdict').textContent.includes('best known')")
                while_open = threads()  # with the one that has computed the best known value, which is used again
            deadline = monotonic() + 10.0
            while threads() >= while_open and monotonic() < deadline:
                sleep(0.05)
            return threads()

        first = visit()
        assert [visit() for _ in range(3)] == [first] * 3
