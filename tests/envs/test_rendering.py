"""Pictures: the right colours at the right places, without a display, the same every time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pygame
import pytest
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

import envs  # noqa: F401
from envs.rendering import Belt, Renderer, Scene, palette
from planners import PLANAR_3R, SCARA_1M

Picture = NDArray[np.uint8]
VIEW = (-1.5, 1.5, -0.5, 2.3)
Q = np.array([1.2, 0.9])
HAND = SCARA_1M.forward_kinematics(Q)
BARE = Scene(joints=SCARA_1M.joint_positions(Q), torque_ratios=np.zeros(2), time=1.0, horizon=4.0)
BELT = Belt(start=np.array([-1.1, 1.732]), end=np.array([0.6, 1.732]))
FULL = replace(
    BARE,
    title="Conveyor tracking",
    torque_ratios=np.array([0.4, -1.1]),
    part=np.array([0.2, 1.732]),
    belt=BELT,
    trail=np.stack([np.linspace(-0.9, HAND[0], 300), np.full(300, HAND[1])], axis=-1),
    target=np.array([0.9, 0.4]),
    obstacles=((-0.8, 0.6, 0.2),),
    status=(("position error", "0.12 mm", True), ("a label much too long for the narrow panel", "3.4 mm/s", False)),
    limit_gauges=(("velocity", 0.83), ("jerk", 1.4)),
)


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    drawing = Renderer(VIEW)
    yield drawing
    drawing.close()


def has_color(picture: Picture, color: palette.Color) -> NDArray[np.bool_]:
    """Where the picture has a colour; scaling down moves a plain colour by a few shades."""
    return np.abs(picture.astype(int) - np.array(color)).max(axis=-1) <= 5


def at(picture: Picture, renderer: Renderer, point: object) -> Picture:
    """The 3 x 3 pixels around a point of the plane."""
    x, y = np.rint(renderer.pixels(point)).astype(int)
    return picture[y - 1 : y + 2, x - 1 : x + 2]


def panel(picture: Picture) -> Picture:
    return picture[:, int(0.72 * picture.shape[1]) :]


def workcell(picture: Picture) -> Picture:
    return picture[:, : int(0.7 * picture.shape[1])]


@pytest.mark.parametrize("size", [(960, 640), (480, 320), (301, 203)])
def test_a_picture_is_a_byte_array_of_the_size_asked_for(size: tuple[int, int]) -> None:
    picture = Renderer(VIEW, size=size).draw(FULL)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    assert picture.flags.owndata or picture.base.flags.owndata


def test_no_display_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(variable, raising=False)
    assert Renderer(VIEW).draw(FULL).std() > 10.0
    assert not pygame.display.get_init()
    assert pygame.mixer is None or pygame.mixer.get_init() is None


def test_camera_is_undistorted_centred_and_shows_the_whole_view(renderer: Renderer) -> None:
    corners = renderer.pixels([[VIEW[0], VIEW[2]], [VIEW[1], VIEW[3]]])
    assert np.all(corners > -1e-9)
    assert np.all(corners[:, 0] < 0.72 * 960)
    assert np.all(corners[:, 1] < 640 + 1e-9)
    origin, right, up = renderer.pixels([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    scale = right[0] - origin[0]
    assert scale > 100.0
    np.testing.assert_allclose(right - origin, [scale, 0.0], atol=1e-9)
    np.testing.assert_allclose(up - origin, [0.0, -scale], atol=1e-9)


def test_hand_joints_and_links_are_where_kinematics_puts_them(renderer: Renderer) -> None:
    picture = renderer.draw(BARE)
    base, elbow, hand = BARE.joints
    assert has_color(at(picture, renderer, hand), palette.HAND).all()
    for joint in (base, elbow):
        assert has_color(at(picture, renderer, joint), palette.JOINT).all()
    across = 0.044 * np.array([-(elbow - base)[1], (elbow - base)[0]])
    for side in (-across, across):
        assert has_color(at(picture, renderer, 0.5 * (base + elbow) + side), palette.LINK_BASE).all()
    assert not has_color(at(picture, renderer, 0.5 * (base + elbow) + 2 * across), palette.LINK_BASE).any()


def test_arm_follows_its_joints(renderer: Renderer) -> None:
    moved = SCARA_1M.joint_positions([0.4, 1.5])
    picture = renderer.draw(replace(BARE, joints=moved))
    assert has_color(at(picture, renderer, moved[-1]), palette.HAND).all()
    assert not has_color(at(picture, renderer, HAND), palette.HAND).any()


def test_three_link_arm_has_three_joints() -> None:
    drawing = Renderer((-0.9, 0.9, -0.9, 0.9))
    joints = PLANAR_3R.joint_positions([0.5, 0.8, -0.9])
    picture = drawing.draw(replace(BARE, joints=joints, torque_ratios=np.array([0.6, -0.4, 0.2])))
    for joint in joints[:-1]:
        assert has_color(at(picture, drawing, joint), palette.JOINT).all()
    assert has_color(at(picture, drawing, joints[-1]), palette.HAND).any()


def test_part_is_amber_until_it_is_settled(renderer: Renderer) -> None:
    part = np.array([0.2, 1.732])
    edge = part + np.array([0.0, 0.03])  # off the label in the middle
    for settled, color in ((False, palette.WAITING), (True, palette.GOOD)):
        picture = renderer.draw(replace(BARE, part=part, settled=settled))
        assert has_color(at(picture, renderer, edge), color).all()
    assert not has_color(workcell(renderer.draw(BARE)), palette.WAITING).any()


def test_belt_lies_where_it_is_and_moves_with_its_travel(renderer: Renderer) -> None:
    still = renderer.draw(replace(BARE, belt=BELT))
    x, y = np.rint(renderer.pixels([[-0.9, 1.732], [0.0, 1.732]])).astype(int).T
    strip = still[y[0] - 8 : y[0] + 8, x[0] : x[1]]
    assert has_color(strip, palette.BELT).mean() > 0.5
    moved = renderer.draw(replace(BARE, belt=replace(BELT, travel=0.03)))
    changed = np.argwhere((still != moved).any(axis=-1))
    assert len(changed) > 200
    low, high = renderer.pixels([[-1.2, 1.9], [0.7, 1.55]])
    assert np.all((changed[:, ::-1] >= low) & (changed[:, ::-1] <= high)), "something besides the belt moved"


def test_stripes_move_along_the_belt_in_any_direction(renderer: Renderer) -> None:
    def stripes(travel: float) -> Picture:
        belt = Belt(start=np.array([0.9, 0.2]), end=np.array([0.9, 1.6]), travel=travel)
        picture = renderer.draw(replace(BARE, belt=belt))
        x, y = np.rint(renderer.pixels([[0.9, 1.4], [0.9, 0.5]])).astype(int).T
        return has_color(picture[y[0] : y[1], x[0] - 10 : x[0] + 10], palette.BELT_STRIPE)

    before, after = stripes(0.0), stripes(0.04)
    pixels = round(0.04 * float(renderer.pixels([1.0, 0.0])[0] - renderer.pixels([0.0, 0.0])[0]))
    agreement = (before[pixels:] == after[:-pixels]).mean()  # upwards is towards lower rows
    assert agreement > 0.95 > (before == after).mean() + 0.1


def test_belt_of_no_length_is_refused(renderer: Renderer) -> None:
    with pytest.raises(ValueError, match="its ends must differ"):
        renderer.draw(replace(BARE, belt=Belt(np.zeros(2), np.zeros(2))))


def test_obstacle_and_target_are_where_they_are(renderer: Renderer) -> None:
    picture = renderer.draw(replace(BARE, obstacles=((-0.8, 0.6, 0.2),), target=np.array([0.9, 0.4])))
    inside = palette.mix(palette.BAD, palette.PANEL, 0.62)
    assert has_color(at(picture, renderer, [-0.8, 0.6 + 0.15]), inside).all()
    assert not has_color(at(picture, renderer, [-0.8, 0.6 + 0.25]), inside).any()
    assert has_color(at(picture, renderer, [0.9, 0.4]), palette.GOOD).all()


def test_trail_fades_with_age(renderer: Renderer) -> None:
    trail = np.stack([np.linspace(-1.3, 1.3, 400), np.full(400, 0.25)], axis=-1)
    picture = renderer.draw(replace(BARE, trail=trail)).astype(int)
    plain = renderer.draw(BARE).astype(int)
    strength = [np.abs(at(picture - plain, renderer, [x, 0.25])).max() for x in (-1.2, -0.7, 0.5, 1.2)]
    assert strength == sorted(strength)
    assert strength[0] < 60 < 120 < strength[-1]


@pytest.mark.parametrize("length", [0, 1, 2])
def test_short_trails_are_fine(renderer: Renderer, length: int) -> None:
    assert renderer.draw(replace(BARE, trail=np.full((length, 2), 0.5))).shape == (640, 960, 3)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torque_bar_grows_with_torque_and_reddens_past_the_limit(renderer: Renderer, sign: float) -> None:
    def colored(ratio: float, color: palette.Color) -> int:
        picture = renderer.draw(replace(BARE, time=0.0, torque_ratios=np.array([sign * ratio, 0.0])))
        return int(has_color(panel(picture), color).sum())

    lengths = [colored(ratio, palette.ACCENT) for ratio in (0.0, 0.2, 0.4, 0.8)]
    assert lengths[0] == 0
    assert lengths[3] == pytest.approx(2 * lengths[2], rel=0.1)
    assert lengths[2] == pytest.approx(2 * lengths[1], rel=0.15)
    assert colored(0.95, palette.BAD) == 0 == colored(1.05, palette.ACCENT)
    assert colored(1.25, palette.BAD) > colored(1.05, palette.BAD) > lengths[3]
    assert colored(50.0, palette.BAD) == colored(1.25, palette.BAD), "a bar ends with its track"


def test_sign_of_a_torque_is_a_side(renderer: Renderer) -> None:
    def columns(ratio: float) -> NDArray[np.intp]:
        picture = renderer.draw(replace(BARE, time=0.0, torque_ratios=np.array([ratio, 0.0])))
        return np.flatnonzero(has_color(panel(picture), palette.ACCENT).any(axis=0))

    assert columns(-0.5).max() <= columns(0.5).min()


def test_clock_and_limit_gauges_fill_from_the_left(renderer: Renderer) -> None:
    def colored(scene: Scene, color: palette.Color) -> int:
        return int(has_color(panel(renderer.draw(scene)), color).sum())

    start = replace(BARE, time=0.0)
    times = [colored(replace(start, time=t), palette.ACCENT) for t in (0.0, 1.0, 2.0, 4.0, 9.0)]
    assert times[0] == 0
    assert times[0] < times[1] < times[2] < times[3] == times[4]
    gauges = [colored(replace(start, limit_gauges=(("velocity", r),)), palette.ACCENT) for r in (0.0, 0.3, 0.6)]
    assert gauges[0] == 0 < gauges[1]
    assert gauges[2] == pytest.approx(2 * gauges[1], rel=0.15)
    assert colored(replace(start, limit_gauges=(("velocity", 1.01),)), palette.BAD) > 0


def test_status_lines_are_green_or_amber(renderer: Renderer) -> None:
    def dots(good: bool) -> tuple[bool, bool]:
        picture = panel(renderer.draw(replace(BARE, status=(("position error", "0.1 mm", good),))))
        return bool(has_color(picture, palette.GOOD).any()), bool(has_color(picture, palette.WAITING).any())

    assert dots(True) == (True, False)
    assert dots(False) == (False, True)


def test_long_labels_leave_room_for_their_values(renderer: Renderer) -> None:
    """The value at the right end reads the same whatever stands on its left."""

    def value(label: str) -> Picture:
        return panel(renderer.draw(replace(BARE, status=((label, "3.4 mm/s", True),))))[:, -80:]

    np.testing.assert_array_equal(value("x"), value("a label much too long for the narrow panel"))


def test_same_scene_same_pixels(renderer: Renderer) -> None:
    first = renderer.draw(FULL)
    kept = first.copy()
    renderer.draw(replace(BARE, time=3.0, torque_ratios=np.array([1.0, 0.1])))
    np.testing.assert_array_equal(renderer.draw(FULL), kept)
    np.testing.assert_array_equal(Renderer(VIEW).draw(FULL), kept)
    np.testing.assert_array_equal(first, kept, err_msg="a later picture overwrote an earlier one")


def test_things_far_outside_the_view_are_no_problem(renderer: Renderer) -> None:
    far = replace(FULL, part=np.array([1e9, -1e9]), obstacles=((1e6, 0.0, 0.1),), target=np.array([-1e7, 1e7]))
    assert renderer.draw(far).shape == (640, 960, 3)


def test_closing_twice_is_fine_and_leaves_other_renderers_alone(renderer: Renderer) -> None:
    other = Renderer(VIEW)
    other.close()
    other.close()
    assert renderer.draw(FULL).any()


def test_window_shows_the_same_picture(monkeypatch: pytest.MonkeyPatch, renderer: Renderer) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown = Renderer(VIEW, window=True, fps=500)
    try:
        picture = shown.draw(FULL)
        np.testing.assert_array_equal(picture, renderer.draw(FULL))
        screen = pygame.display.get_surface()
        assert screen is not None
        np.testing.assert_array_equal(pygame.surfarray.array3d(screen).swapaxes(0, 1), picture)
        assert pygame.display.get_caption()[0] == "Conveyor tracking"
    finally:
        shown.close()
    assert not pygame.display.get_init()
    shown.close()


def test_drawing_goes_on_after_the_user_closed_the_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown = Renderer(VIEW, window=True, fps=500)
    try:
        shown.draw(BARE)
        pygame.event.post(pygame.event.Event(pygame.QUIT))
        shown.draw(BARE)
        assert not pygame.display.get_init()
        assert shown.draw(FULL).any()
    finally:
        shown.close()


def test_missing_pygame_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    monkeypatch.delitem(sys.modules, "envs.rendering.canvas", raising=False)
    monkeypatch.delattr("envs.rendering.canvas", raising=False)
    with pytest.raises(DependencyNotInstalled, match=r'pip install "planarm\[viz\]"'):
        Renderer(VIEW)


@pytest.mark.parametrize("view", [(1.0, -1.0, 0.0, 1.0), (0.0, 1.0, 2.0, 2.0), (0.0, np.nan, 0.0, 1.0)])
def test_empty_views_are_refused(view: tuple[float, float, float, float]) -> None:
    with pytest.raises(ValueError, match="with xmin < xmax and ymin < ymax"):
        Renderer(view)


def test_tiny_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match=r"picture size \(960, 10\) must be at least 64"):
        Renderer(VIEW, size=(960, 10))


@pytest.mark.parametrize(
    ("env_id", "frames"), [("ConveyorTrack-v0", 50), ("MinTorqueMove-v0", 200), ("ObstacleDodge-v0", 50)]
)
def test_films_play_in_real_time(env_id: str, frames: int) -> None:
    assert gym.make(env_id).metadata["render_fps"] == frames
    assert gym.make_vec(env_id, num_envs=2).metadata["render_fps"] == frames
    assert gym.make(env_id, control_period=0.025, physics_step=0.0025).metadata["render_fps"] == 40
