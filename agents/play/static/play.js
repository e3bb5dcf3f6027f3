// The page of `planarm play`: draws the frames that the server sends, and sends what the visitor does.
import { SceneView, ratioColor } from "./scene.js";

const COLORS = ["#2f80c4", "#e08a1e", "#8d5bc6"]; // of the policies, in order
const FULL_SCALE = 1.25; // ratio at the end of a bar
const AGAIN_AFTER = 1500; // from the end of an episode to the next one, ms
const NUDGE = 0.02; // of an arrow key, m

const at = (id) => document.getElementById(id);
const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

let tasks = [];
let palettes = { light: {}, dark: {} };
let palette = {};
let episode = null; // what the server plays
let frame = null; // its last frame
let views = []; // one for each policy: {view, canvas, ...elements}
let shown = 0; // the policy drawn in full where all are overlaid
let held = null; // the point that is dragged: {key, index, point}
let chosen = 0; // the point that the arrow keys move
let endedAt = null;
let bound = "";
let wanted = null; // the choice that was asked for and is not answered yet
let chosenByHand = false; // whether the visitor has said which policies play

const socket = new WebSocket(`ws://${location.host}/play`);
const send = (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));
const overlaid = () => at("ghosts").getAttribute("aria-pressed") === "true" && episode.choice.policies.length > 1;

socket.addEventListener("close", () => {
  at("wait").textContent = "";
  note("The server has ended: start planarm play again, and load this page anew.");
});
socket.addEventListener("message", ({ data }) => {
  const message = JSON.parse(data);
  if (message.kind === "welcome") welcome(message);
  else if (message.kind === "episode") begin(message);
  else if (message.kind === "error") {
    note(message.text);
    wanted = null;
    if (episode) showChoice();
  } else if (message.kind === "bound") bound = message.text;
  else if (message.kind === "wait") at("wait").textContent = message.text;
  else {
    frame = message;
    if (frame.policies.length) at("wait").textContent = "";
  }
});

function note(text) {
  at("note").textContent = text;
}

function welcome(message) {
  tasks = message.tasks;
  palettes = message.palette;
  chosenByHand = message.chosen;
  dress();
  at("task").replaceChildren(...tasks.map((task) => element("option", { value: task.env, textContent: task.env })));
  send({ do: "choose", choice: message.first });
  requestAnimationFrame(draw);
}

function dress() {
  palette = palettes[matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"];
  for (const [name, color] of Object.entries(palette)) document.documentElement.style.setProperty(`--${name}`, color);
  for (const each of views) each.view.palette = palette;
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", dress);

/** Ask for another choice; several changes add up until the server has answered. */
function choose(changes) {
  wanted = { ...(wanted ?? episode.choice), ...changes };
  send({ do: "choose", choice: wanted });
}

function begin(message) {
  const before = episode && episode.choice;
  [episode, wanted] = [message, null];
  bound = "";
  endedAt = null;
  frame = null;
  note("");
  const { choice } = message;
  const task = tasks.find((each) => each.env === choice.env);
  fill(at("arm"), task.arms, "the task's own");
  fill(at("scenario"), task.scenarios, "random");
  showChoice();
  at("arm").disabled = task.arms.length === 0;
  at("ghosts").disabled = choice.policies.length === 1;
  if (!before || before.env !== choice.env || before.policies.join() !== choice.policies.join() || before.arm !== choice.arm) {
    shown = 0;
    makePolicies(task, choice);
    makeViews();
    makeSliders();
  }
  const points = message.controls.filter((control) => !control.span).map((control) => control.title);
  at("draggable").textContent = points.length ? `Drag in the picture: ${points.join(", ")}.` : "";
}

function fill(select, names, first) {
  select.replaceChildren(new Option(first, ""), ...names.map((name) => new Option(name, name)));
}

/** The choice that is played in the fields, whatever they showed. */
function showChoice() {
  for (const [id, key] of [["task", "env"], ["seed", "seed"], ["arm", "arm"], ["scenario", "scenario"]])
    at(id).value = episode.choice[key] ?? "";
}

function makePolicies(task, choice) {
  const names = [...new Set([...task.policies, ...choice.policies])];
  const buttons = names.map((name) => {
    const position = choice.policies.indexOf(name);
    const button = element("button", { textContent: name });
    button.setAttribute("aria-pressed", String(position >= 0));
    if (position >= 0) button.style.background = button.style.borderColor = COLORS[position];
    button.addEventListener("click", () => {
      chosenByHand = true;
      const { policies } = wanted ?? choice;
      const others = policies.filter((each) => each !== name);
      const next = others.length < policies.length ? others : [...others.slice(-2), name];
      if (next.length) choose({ policies: next });
    });
    return button;
  });
  const before = at("policies").querySelector(":focus");
  at("policies").replaceChildren(...buttons);
  if (before) buttons.find((button) => button.textContent === before.textContent)?.focus();
}

function makeViews() {
  const { policies } = episode.choice;
  const count = overlaid() ? 1 : policies.length;
  at("stage").style.setProperty("--columns", count);
  at("stage").style.setProperty("--tall", ["64vh", "48vw", "32vw"][count - 1]); // a narrow picture is about as tall as it is wide
  views = policies.slice(0, count).map((_, index) => makeView(index));
  at("stage").replaceChildren(...views.map((each) => each.card));
}

function makeView(index) {
  const canvas = element("canvas", { tabIndex: 0 });
  const names = (overlaid() ? episode.choice.policies : [""]).map((_, i) => {
    const name = element(overlaid() ? "button" : "span", {}, element("span", { className: "swatch" }), element("span"));
    if (overlaid()) name.addEventListener("click", () => (shown = i));
    return name;
  });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `${episode.choice.env}: the arm, driven by ${episode.choice.policies[index]}`);
  const made = {
    index,
    canvas,
    view: new SceneView(canvas, episode.view, palette),
    names,
    verdict: element("span", { className: "verdict" }),
    gauges: element("div", { className: "gauges" }),
    status: element("ul", { className: "status" }),
  };
  made.card = element("article", { className: "card view" }, canvas, element("h2", {}, element("span", {}, ...names), made.verdict), made.gauges, made.status);
  listen(made);
  return made;
}

function makeSliders() {
  const sliders = episode.controls.filter((control) => control.span);
  const made = sliders.map((control) => {
    const output = element("output", { id: `${control.key}_shown` });
    const [low, high] = control.span;
    const input = element("input", { type: "range", id: `control_${control.key}`, min: low, max: high, step: (high - low) / 200 });
    input.addEventListener("input", () => send({ do: "change", key: control.key, number: +input.value }));
    return element("label", {}, `${control.title} `, output, input);
  });
  at("sliders").replaceChildren(...made);
}

// Drawing

function draw() {
  requestAnimationFrame(draw);
  if (!frame || !episode || frame.policies.length !== episode.choice.policies.length) return;
  const latest = frame.policies.map((played) => played.scene).reduce((one, other) => (other.time > one.time ? other : one));
  at("clock").textContent = `${latest.time.toFixed(2)} / ${latest.horizon.toFixed(2)} s`;
  at("run").textContent = frame.running ? "Pause" : "Run";
  at("run").setAttribute("aria-pressed", String(frame.running));
  for (const each of views) show(each);
  for (const [key, number] of Object.entries(frame.policies[0].numbers)) {
    const input = at(`control_${key}`);
    if (!input) continue;
    if (document.activeElement !== input) input.value = number;
    at(`${key}_shown`).textContent = number.toFixed(2);
  }
  goOn();
}

function show(each) {
  const played = frame.policies[overlaid() ? shown : each.index];
  const colors = frame.policies.length > 1;
  const index = frame.policies.indexOf(played);
  const others = overlaid() ? frame.policies.filter((other) => other !== played) : [];
  const ghosts = others.map((other) => ({ scene: other.scene, color: COLORS[frame.policies.indexOf(other)] }));
  const scene = held ? moved(played.scene) : played.scene;
  each.view.draw(scene, { ghosts, plan: played.plan, handles: handles(played), color: colors ? COLORS[index] : null });
  const names = overlaid() ? frame.policies : [played];
  each.names.forEach((name, i) => {
    name.firstChild.style.background = colors ? COLORS[frame.policies.indexOf(names[i])] : palette.accent;
    name.lastChild.textContent = names[i].name;
    name.setAttribute("aria-pressed", String(names[i] === played));
  });
  const verdicts = names.filter((other) => other.ended || other.refusal);
  each.verdict.replaceChildren(
    ...verdicts.map((other) => {
      const best = bound && !other.changed && other.success ? ` (${bound})` : "";
      const text = other.ended ? other.outcome.replaceAll("\n", " ") + best : `no motion: ${other.refusal}`;
      return element("div", { className: other.success ? "good" : "bad", textContent: (names.length > 1 ? `${other.name}: ` : "") + text });
    }),
  );
  gauge(each.gauges, played.scene);
  each.status.replaceChildren(
    ...played.scene.status.map(([label, value, good]) =>
      element("li", { className: good ? "ok" : "" }, element("span", { textContent: label }), element("span", { className: "number", textContent: value })),
    ),
  );
}

/** The scene with the point that is dragged under the pointer, before the server's answer. */
function moved(scene) {
  const change = { ...scene };
  if (held.key === "part") change.part = held.point;
  if (held.key === "goal") change.target = held.point;
  if (held.key === "disc") change.obstacles = scene.obstacles.map((disc, i) => (i === held.index ? [...held.point, disc[2]] : disc));
  return change;
}

function handles(played) {
  const all = points(played);
  return all.map(({ key, index, point }, i) => ({
    point: held && held.key === key && held.index === index ? held.point : point,
    active: Boolean(held && held.key === key && held.index === index) || (!held && views.some((each) => each.canvas === document.activeElement) && i === chosen % all.length),
    radius: key === "disc" ? played.scene.obstacles[index][2] : 0,
  }));
}

function points(played) {
  return Object.entries(played.points).flatMap(([key, all]) => all.map((point, index) => ({ key, index, point })));
}

function gauge(place, scene) {
  const torques = scene.torque_ratios.map((ratio, i) => [`torque ${i + 1}`, ratio, true]);
  const limits = scene.limit_gauges.map(([label, ratio]) => [label, ratio, false]);
  place.replaceChildren(
    ...[...torques, ...limits].flatMap(([label, ratio, signed]) => {
      const size = (Math.min(Math.abs(ratio), FULL_SCALE) / FULL_SCALE) * (signed ? 50 : 100);
      const fill = element("i");
      fill.style.background = ratioColor(ratio, palette);
      fill.style.width = `${size}%`;
      fill.style.left = signed ? `${ratio < 0 ? 50 - size : 50}%` : "0";
      const marks = (signed ? [10, 50, 90] : [80]).map((share) => {
        const mark = element("b");
        mark.style.left = `${share}%`;
        return mark;
      });
      return [
        element("span", { className: "muted", textContent: label }),
        element("div", { className: "bar" }, fill, ...marks),
        element("span", { className: "number", textContent: `${Math.round(100 * ratio)} %` }),
      ];
    }),
  );
}

/** The next seed, some time after all policies have ended. */
function goOn() {
  const over = frame.policies.every((played) => played.ended) && !held;
  if (!over || !frame.running) endedAt = null;
  else if (endedAt === null) endedAt = performance.now();
  else if (performance.now() - endedAt > AGAIN_AFTER && at("auto").checked) {
    endedAt = Infinity;
    nextSeed();
  }
}

function nextSeed() {
  send({ do: "restart", seed: episode.choice.seed + 1 });
}

// What the visitor does

function listen({ canvas, view }) {
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return view.metres([event.clientX - box.left, event.clientY - box.top]);
  };
  const played = () => frame.policies[overlaid() ? shown : views.findIndex((each) => each.canvas === canvas)];
  const near = (point) => {
    const reach = Math.max(0.12, 26 / view.scale);
    const found = points(played()).map((each) => ({ ...each, away: Math.hypot(each.point[0] - point[0], each.point[1] - point[1]) }));
    found.sort((a, b) => a.away - b.away);
    return found.length && found[0].away < reach ? found[0] : null;
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (!frame) return;
    held = near(place(event));
    if (held) canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!frame) return;
    const point = place(event);
    canvas.style.cursor = held ? "grabbing" : near(point) ? "grab" : "";
    if (held) {
      held.point = point;
      if (held.key !== "goal") move(held); // a goal counts where it is put down
    }
    if (episode.choice.policies.includes("you")) send({ do: "mouse", point });
  });
  const drop = () => {
    if (held) move(held);
    held = null;
  };
  canvas.addEventListener("pointerup", drop);
  canvas.addEventListener("pointercancel", () => (held = null));
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const all = frame ? points(played()) : [];
    if (!way || !all.length) return;
    event.preventDefault();
    const { key, index, point } = all[chosen % all.length];
    move({ key, index, point: [point[0] + NUDGE * way[0], point[1] + NUDGE * way[1]] });
  });
}

function move({ key, index, point }) {
  note("");
  send({ do: "change", key, index, point });
}

at("run").addEventListener("click", () => send({ do: frame && frame.running ? "pause" : "run" }));
at("step").addEventListener("click", () => send({ do: "step" }));
at("restart").addEventListener("click", () => send({ do: "restart" }));
at("next").addEventListener("click", nextSeed);
at("ghosts").addEventListener("click", () => {
  const pressed = at("ghosts").getAttribute("aria-pressed") !== "true";
  at("ghosts").setAttribute("aria-pressed", String(pressed));
  shown = 0;
  makeViews();
});
at("task").addEventListener("change", () => {
  const task = tasks.find((each) => each.env === at("task").value);
  const kept = episode.choice.policies.filter((name) => chosenByHand && task.policies.includes(name));
  wanted = {};
  choose({ env: task.env, policies: kept.length ? kept : [task.first], seed: episode.choice.seed });
});
at("arm").addEventListener("change", () => choose({ arm: at("arm").value || null }));
at("scenario").addEventListener("change", () => choose({ scenario: at("scenario").value || null }));
at("seed").addEventListener("change", () => {
  const seed = Number(at("seed").value);
  if (at("seed").value !== "" && Number.isSafeInteger(seed) && seed >= 0) send({ do: "restart", seed });
  else at("seed").value = episode.choice.seed;
});
at("speed").addEventListener("input", () => {
  const speed = 2 ** +at("speed").value;
  at("speed_shown").textContent = `${speed.toFixed(2)}×`;
  send({ do: "speed", number: speed });
});
document.addEventListener("keydown", (event) => {
  const written = "select, input:not([type=range], [type=checkbox])"; // elements to which every key belongs
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches(written)) return;
  if (event.key === " " && event.target.matches("button, [type=checkbox]")) return;
  if (event.key === "h") chosen += 1;
  const button = { " ": "run", ".": "step", r: "restart", n: "next", g: "ghosts" }[event.key];
  if (!button) return;
  event.preventDefault();
  at(button).click();
});
