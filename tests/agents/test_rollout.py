"""`planarm rollout`: the episode it tells of, and the files it writes."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from PIL import Image

import agents
from agents.commands.rollout import RolloutOptions, run
from agents.figures.film import Film
from agents.policies.play import play
from envs.rendering import palette

ENV_ID = "ConveyorTrack-v0"


def test_the_episode_is_the_evaluators() -> None:
    info = play(gym.make(ENV_ID, control_mode="jerk"), "dpct", 3, {})
    evaluation = agents.evaluate("dpct", ENV_ID, [3], env_config={"control_mode": "jerk"})
    assert info["return"] == evaluation.returns[0]
    assert info["settling_time"] == evaluation.metrics["settling_time"][0]


def test_an_agent_acts_as_it_was_trained_to(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RolloutOptions(env=ENV_ID, policy="agent", seed=3)) == 0
    printed = capsys.readouterr().out
    shipped = agents.load_agent(ENV_ID)
    evaluation = agents.evaluate(shipped, ENV_ID, [3], env_config={"control_mode": "jerk"})
    assert f"{evaluation.returns[0]:.6g}" in printed
    with pytest.raises(ValueError, match="leave control_mode out"):
        run(RolloutOptions(env=ENV_ID, policy="agent", control_mode="torque"))


def test_settings_of_the_environment(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RolloutOptions(env=ENV_ID, policy="dpct+adaptive", settings=("payload=0.3", "horizon=2"))) == 0
    printed = capsys.readouterr().out
    evaluation = agents.evaluate("dpct+adaptive", ENV_ID, [0], env_config={"payload": 0.3, "horizon": 2.0})
    assert f"{evaluation.returns[0]:.6g}" in printed


def test_the_info_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RolloutOptions(env=ENV_ID, policy="follower", scenario="paper")) == 0
    out = capsys.readouterr().out
    for key in ("return", "is_success", "settling_time", "limit_ratios", "jerk"):
        assert key in out


def test_gif_lasts_as_long_as_the_episode(tmp_path: Path) -> None:
    path = tmp_path / "films" / "episode.gif"
    run(RolloutOptions(env=ENV_ID, policy="follower", scenario="paper", record=path, fps=2, width=201))
    with Image.open(path) as film:
        assert film.size == (200, 134)
        assert film.n_frames == 7  # type: ignore[attr-defined]
        durations = []
        for frame in range(7):
            film.seek(frame)
            durations.append(film.info["duration"])
    assert durations == [500] * 6 + [2000]
    assert list(path.parent.iterdir()) == [path]


def test_png_is_the_last_frame(tmp_path: Path) -> None:
    path = tmp_path / "episode.png"
    run(RolloutOptions(env=ENV_ID, policy="follower", scenario="paper", record=path, width=960))
    env = gym.make(ENV_ID, render_mode="rgb_array")
    play(env, "follower", 0, {"scenario": "paper"})
    with Image.open(path) as picture:
        np.testing.assert_array_equal(np.asarray(picture), env.render())


def test_mp4_can_be_read(tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "episode.mp4"
    run(RolloutOptions(env=ENV_ID, policy="follower", scenario="paper", record=path, fps=5, width=320))
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == 16
    assert seconds == pytest.approx(16 / 5)


def test_a_film_takes_the_frames_that_are_due() -> None:
    film = Film(fps=20, width=64)
    taken: list[float] = []

    def picture(time: float) -> Any:
        taken.append(time)
        return np.zeros((64, 64, 3), np.uint8)

    for step in range(11):
        film.take(step / 50.0, lambda now=step / 50.0: picture(now), last=step == 10)  # type: ignore[misc]
    assert taken == [0.0, 0.06, 0.1, 0.16, 0.2]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"env": "ConveyerTrack-v0"}, 'did you mean "ConveyorTrack-v0"'),
        ({"policy": "folower"}, 'did you mean "follower"'),
        ({"seed": -1}, "seed -1"),
        ({"settings": ("paylod=0.3",)}, 'did you mean "payload"'),
        ({"settings": ("payload",)}, "no key=value"),
        ({"record": Path("film.avi")}, r"\.gif, \.mp4, \.png"),
        ({"record": Path("film.gif"), "fps": 0}, "fps 0"),
        ({"record": Path("film.gif"), "width": 3}, "width 3"),
        ({"record": Path("film.gif"), "render": True}, "--render"),
    ],
)
def test_what_is_wrong_is_said(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        run(RolloutOptions(**{"env": ENV_ID, **options}))


@pytest.mark.parametrize(("suffix", "module", "extra"), [(".gif", "PIL", "viz"), (".mp4", "imageio_ffmpeg", "video")])
def test_a_missing_library_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, suffix: str, module: str, extra: str
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == module else find(name))
    with pytest.raises(DependencyNotInstalled, match=rf"planarm\[{extra}\]"):
        run(RolloutOptions(env=ENV_ID, record=Path(f"film{suffix}")))


def test_a_film_that_ffmpeg_does_not_finish_is_an_error_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    ffmpeg, path = imageio_ffmpeg.get_ffmpeg_exe(), tmp_path / "episode.mp4"
    programs = iter([ffmpeg, "false"])  # before the episode it still works
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: next(programs))
    with pytest.raises(OSError, match=r"cannot write .*episode\.mp4: ffmpeg ended with 1"):
        run(RolloutOptions(env=ENV_ID, policy="follower", record=path, fps=2, width=64))
    assert not list(tmp_path.iterdir())
    assert "wrote" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "complaint"),
    [
        ("exit 3", "ffmpeg ended with 3"),
        ("echo \"Unknown encoder 'libx264'\" >&2; exit 1", "Unknown encoder 'libx264'"),
        (None, "ffmpeg cannot be run"),
    ],
)
def test_an_ffmpeg_that_cannot_encode_is_named_before_the_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str | None, complaint: str
) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    ffmpeg = tmp_path / "ffmpeg"
    if program is not None:
        ffmpeg.write_text(f"#!/bin/sh\ncat >/dev/null\n{program}\n")
        ffmpeg.chmod(0o755)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(ffmpeg))
    monkeypatch.setattr("agents.commands.rollout.play", lambda *arguments: pytest.fail("ran an episode"))
    with pytest.raises(ValueError, match=rf"cannot write .*{complaint}.*record a \.gif"):
        run(RolloutOptions(env=ENV_ID, record=tmp_path / "episode.mp4"))


@pytest.mark.parametrize(("env_id", "scenario"), [("ExcavatorPayload-v0", "cycle"), (ENV_ID, "paper")])
def test_a_scenario_is_an_option_of_the_reset(env_id: str, scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RolloutOptions(env=env_id, scenario=scenario)) == 0
    short = capsys.readouterr().out
    assert run(RolloutOptions(env=env_id, options=(f"scenario={scenario}",))) == 0
    assert capsys.readouterr().out == short
    with pytest.raises(ValueError, match="give one of them"):
        run(RolloutOptions(env=env_id, scenario=scenario, options=("scenario=random",)))
    with pytest.raises(ValueError, match="scenario"):
        run(RolloutOptions(env=env_id, scenario="no such start"))


def test_a_gif_keeps_the_drawings_own_colours(tmp_path: Path) -> None:
    path = tmp_path / "lamp.gif"
    film = Film(fps=10, width=64)
    shades = np.linspace(0, 255, 64 * 64, dtype=np.uint8).reshape(64, 64)
    picture = np.stack([shades, shades.T, shades[::-1]], axis=2)
    own = {name: color for name, color in vars(palette).items() if isinstance(color, tuple)}
    for column, color in enumerate(own.values()):
        picture[10, column] = color  # one pixel each, among thousands of other colours
    film.take(0.0, lambda: picture)
    film.take(0.1, lambda: picture, last=True)
    film.write(path)
    with Image.open(path) as written:
        shown = np.asarray(written.convert("RGB"))
    for column, (name, color) in enumerate(own.items()):
        np.testing.assert_array_equal(shown[10, column], color, err_msg=name)
